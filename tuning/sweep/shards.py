"""The folder of a sweep: a manifest, numbered shards, and claims by which processes keep out of each other's way.

Processes need nothing but this folder. A claim only saves work: two that compute the same shard write the same bytes.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import importlib.metadata
import io
import json
import os
import stat
import threading
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np
from jaxtyping import ArrayLike

import agvjax
from agvjax.metric_table import OLD_NAMES

from ..config.old import difference
from ..io import files
from ..io.marks import lives, mark, silent

MANIFEST, CLAIM = "manifest.json", "claim"
FORMAT = 1
BEAT = 20.0  # s between signs of life of a claim
BEGINNING = 50  # tenths of a second that the first process of a sweep is given to write its manifest
PACKAGES = ("jax", "jaxlib", "numpy", "scipy")
OLD_ARRAYS = {f"result/{old}": f"result/{new}" for old, new in OLD_NAMES.items()}  # in shards of earlier releases


class Manifest(NamedTuple):
    """What every process of a sweep must agree on."""

    digest: str  # of the configuration and of every controller
    size: int
    shard: int
    names: tuple[str, ...]  # of the controllers, the configured one first
    controllers: tuple[str, ...]  # as TOML
    metrics: dict[str, str]  # name -> unit
    leaves: dict[str, str]  # name -> unit
    config: str  # as TOML
    seed: int
    versions: dict[str, str]

    @property
    def shards(self) -> int:
        """Number of shards."""
        return -(-self.size // self.shard)

    @property
    def block(self) -> int:
        """Number of scenarios that are rolled out at once."""
        return min(self.shard, self.size)

    def span(self, shard: int) -> tuple[int, int]:
        """First scenario and number of scenarios of a shard."""
        first = shard * self.shard
        return first, min(self.shard, self.size - first)


def manifest(
    config: str, seed: int, laws: Mapping[str, str], size: int, shard: int, **units: dict[str, str]
) -> Manifest:
    """The manifest of a sweep; `units` are those of its `metrics` and `leaves`."""
    digest = hashlib.sha256(json.dumps([FORMAT, config, list(laws.items())]).encode()).hexdigest()[:32]
    versions = {name: importlib.metadata.version(name) for name in PACKAGES} | {"agvjax": agvjax.__version__}
    return Manifest(
        digest, size, shard, tuple(laws), tuple(laws.values()), config=config, seed=seed, versions=versions, **units
    )


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """`manifest.json`; processes that begin at once write the same."""
    spans = [manifest.span(i) for i in range(manifest.shards)]
    files.write_json(folder / MANIFEST, {"format": FORMAT, **manifest._asdict(), "shards": spans})


def read_manifest(folder: Path) -> Manifest:
    """The manifest of a folder.

    Raises:
        ValueError: there is none, or it is no manifest of this release; the message says which.
    """
    try:
        table = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        if table.pop("format") != FORMAT:
            raise ValueError(f"its format is not {FORMAT}")
        del table["shards"]
        table["metrics"] = {OLD_NAMES.get(name, name): unit for name, unit in table["metrics"].items()}
        return Manifest(**table | {name: tuple(table[name]) for name in ("names", "controllers")})
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{folder} holds no sweep of this release ({type(error).__name__}: {error})") from error


def taken_up(before: Manifest, asked: Manifest) -> Manifest:
    """The manifest to go on with where one lies already, perhaps of an earlier release, whose shards have its digest.

    Raises:
        ValueError: it is that of another sweep; the message says what differs.
    """
    if before.digest != asked.digest:
        laws = before.names != asked.names or any(map(difference, before.controllers, asked.controllers))
        if changed := difference(before.config, asked.config) or ("a controller's gains" if laws else ""):
            raise ValueError(changed)
    return asked._replace(digest=before.digest)


def path_of(folder: Path, shard: int) -> Path:
    """Where a shard lies."""
    return folder / f"shard-{shard:05d}.npz"


def write_shard(
    folder: Path, manifest: Manifest, shard: int, results: Mapping[str, np.ndarray], leaves: Mapping[str, np.ndarray]
) -> None:
    """One shard: `ok` and every metric (controllers, n), and the leaves that vary (n, ...)."""
    first, count = manifest.span(shard)
    arrays: dict[str, ArrayLike] = {"digest": np.asarray(manifest.digest), "first": first, "count": count}
    arrays |= {f"result/{name}": value for name, value in results.items()}
    arrays |= {f"leaf/{name}": value for name, value in leaves.items()}
    files.write_npz(path_of(folder, shard), arrays)


def read_shard(folder: Path, manifest: Manifest, shard: int) -> dict[str, np.ndarray] | None:
    """The arrays of a shard, every byte of it checked; None if it is absent, cut short, damaged or of another sweep."""
    try:
        with np.load(io.BytesIO(path_of(folder, shard).read_bytes()), allow_pickle=False) as file:
            arrays = {OLD_ARRAYS.get(name, str(name)): file[name] for name in file}  # zip knows a checksum of each
        about = tuple(arrays.pop(name) for name in ("digest", "first", "count"))
        names = {"result/ok", *(f"result/{n}" for n in manifest.metrics), *(f"leaf/{n}" for n in manifest.leaves)}
        return arrays if about == (manifest.digest, *manifest.span(shard)) and names == set(arrays) else None
    except Exception:  # NumPy and zipfile raise half a dozen kinds for a damaged file
        return None


class Claim:
    """The right to compute one shard, or to write the report: a file that a thread touches as long as it is ours.

    Attributes:
        held: the marks of all claims of this process that are taken and not given back.
    """

    held: ClassVar[set[str]] = set()

    def __init__(self, folder: Path, name: str):
        self.path = folder / f"{name}.{CLAIM}"
        self.mark = mark()
        self._done = threading.Event()

    def take(self) -> bool:
        """Whether it is ours now; one that is held by a process that is gone is taken over.

        Raises:
            OSError: it cannot be written, or what lies in its place is no file.
        """
        if self.abandoned():
            self.path.unlink(missing_ok=True)
        try:
            with self.path.open("x") as file:
                file.write(self.mark)
        except FileExistsError:
            return False
        self.held.add(self.mark)
        threading.Thread(target=self._live, daemon=True).start()
        return True

    def release(self) -> None:
        """Give the claim back, unless another has taken it over."""
        self._done.set()
        self.held.discard(self.mark)
        with contextlib.suppress(OSError):
            if self.holder() == self.mark:
                self.path.unlink(missing_ok=True)

    def _live(self) -> None:
        while not self._done.wait(BEAT):
            with contextlib.suppress(OSError):
                if self.holder() == self.mark:
                    os.utime(self.path)

    def holder(self) -> str:
        """The mark that stands in it; anything may stand there."""
        with self.path.open("rb") as file:
            return file.read(100).decode(errors="replace")

    def abandoned(self) -> bool:
        """Whether its holder is gone, or has been silent for long.

        Raises:
            OSError: it is no file, and so nobody's claim.
        """
        try:
            if not stat.S_ISREG(self.path.lstat().st_mode):
                raise OSError(errno.EEXIST, "lies in the place of a claim and is no file: remove it", str(self.path))
            return lives(self.holder(), self.held) is False or silent(self.path)
        except FileNotFoundError:
            return False  # given back just now


@contextlib.contextmanager
def locked(folder: Path, name: str) -> Iterator[bool]:
    """Whether this process has the claim now; it is given back in the end."""
    claim = Claim(folder, name)
    ours = claim.take()
    try:
        yield ours
    finally:
        if ours:
            claim.release()


def just_begun(folder: Path, manifest: Manifest) -> bool:
    """Whether another process begins this sweep in the folder now, or began it and its manifest is lost."""
    if any(read_shard(folder, manifest, i) is not None for i in range(manifest.shards)):
        return True
    for _ in range(BEGINNING):
        if (folder / MANIFEST).exists():
            return True
        if any(path.name != "config.toml" and path.suffix != ".part" for path in folder.iterdir()):
            return False
        time.sleep(0.1)
    return True


def sweep_up(folder: Path) -> None:
    """Remove what processes that are gone left lying."""
    files.sweep_up(folder)
    for path in folder.glob(f"*.{CLAIM}"):
        with contextlib.suppress(OSError):
            if Claim(folder, path.stem).abandoned():
                path.unlink(missing_ok=True)
