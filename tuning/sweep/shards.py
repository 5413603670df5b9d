"""The folder of a sweep: a manifest and numbered shards."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import ArrayLike

from agvjax.metric_table import OLD_NAMES

from ..compute.packages import versions
from ..config.old import difference
from ..io import files, plain

MANIFEST = "manifest.json"
FORMAT = 1
LARGEST_MANIFEST = 1_000_000_000  # bytes
OLD_ARRAYS = {f"result/{old}": f"result/{new}" for old, new in OLD_NAMES.items()}  # in shards of earlier releases


class Manifest(NamedTuple):
    """What a sweep is: whoever goes on with it, and every worker, must agree on it."""

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
    digest = _digest(config, laws.items())
    names, texts = tuple(laws), tuple(laws.values())
    return Manifest(digest, size, shard, names, texts, config=config, seed=seed, versions=versions(), **units)


def _digest(config: str, laws: Iterable[tuple[str, str]]) -> str:
    return hashlib.sha256(json.dumps([FORMAT, config, list(laws)]).encode()).hexdigest()[:32]


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """`manifest.json`."""
    table = _table(manifest)
    files.write_json(folder / MANIFEST, {**table, "sha256": _sum(table)})


def _table(manifest: Manifest) -> files.Json:
    spans = [manifest.span(i) for i in range(manifest.shards)]
    return {"format": FORMAT, **manifest._asdict(), "shards": spans}


def _sum(table: files.Json) -> str:
    return hashlib.sha256(json.dumps(table, sort_keys=True).encode()).hexdigest()


def read_manifest(folder: Path) -> Manifest:
    """The manifest of a folder.

    Raises:
        ValueError: there is none, or it is damaged, or no manifest of this release; the message says which.
    """
    try:
        table: files.Json = plain.from_json(files.text(folder / MANIFEST, LARGEST_MANIFEST))
        if not isinstance(table, dict) or table.get("format") != FORMAT:
            raise ValueError(f"its format is not {FORMAT}")
        if table.pop("sha256", None) not in (None, _sum(table)):  # None: of an earlier release
            raise ValueError("its content is not what its sha256 is of: damaged or edited")
        spans = [tuple(span) for span in table.pop("shards")]
        del table["format"]
        table["metrics"] = {OLD_NAMES.get(name, name): unit for name, unit in table["metrics"].items()}
        table |= {name: tuple(table[name]) for name in ("names", "controllers")}
        manifest = Manifest(**table)
        _checked(manifest, spans)
        return manifest
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(
            f"{folder / MANIFEST} holds no sweep of this release ({type(error).__name__}: {error})"
        ) from error


def _checked(manifest: Manifest, spans: list[tuple[int, int]]) -> None:
    """Refuse what no sweep could have written."""
    texts = (manifest.digest, manifest.config, *manifest.names, *manifest.controllers)
    tables = (manifest.metrics, manifest.leaves, manifest.versions)
    texts += tuple(text for table in tables for pair in table.items() for text in pair)
    counts = (manifest.size, manifest.shard)
    if not all(isinstance(text, str) for text in texts) or not all(type(n) is int and n > 0 for n in counts):
        raise ValueError("damaged: texts must be texts, size and shard whole numbers > 0")
    if type(manifest.seed) is not int or not manifest.names or len(set(manifest.names)) < len(manifest.controllers):
        raise ValueError("damaged: seed must be a whole number, every controller must have a name of its own")
    if manifest.digest != _digest(manifest.config, zip(manifest.names, manifest.controllers, strict=True)):
        raise ValueError("damaged or edited: its digest is not that of its names, config and controllers")
    if len(spans) != manifest.shards or spans != [manifest.span(i) for i in range(len(spans))]:
        raise ValueError("damaged: its shards are not those of size and shard")


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


def packed(
    manifest: Manifest, shard: int, results: Mapping[str, np.ndarray], leaves: Mapping[str, np.ndarray]
) -> bytes:
    """The file of one shard: `ok` and every metric (controllers, n), and the leaves that vary (n, ...)."""
    first, count = manifest.span(shard)
    arrays: dict[str, ArrayLike] = {"digest": np.asarray(manifest.digest), "first": first, "count": count}
    arrays |= {f"result/{name}": value for name, value in results.items()}
    arrays |= {f"leaf/{name}": value for name, value in leaves.items()}
    return files.npz(arrays)


def read_shard(
    folder: Path, manifest: Manifest, shard: int, leaves: Mapping[str, tuple[int, ...]] | None = None
) -> dict[str, np.ndarray] | None:
    """The arrays of a shard, every byte of it checked; None if it is absent, cut short, damaged or of another sweep.

    Args:
        folder: of the sweep.
        manifest: of the sweep.
        shard: its number.
        leaves: the shape of one value of each leaf that varies, where that is to be checked too.
    """
    try:
        arrays = {OLD_ARRAYS.get(name, name): array for name, array in files.read_npz(path_of(folder, shard)).items()}
        about = tuple(arrays.pop(name).item() for name in ("digest", "first", "count"))
        names = {"result/ok", *(f"result/{n}" for n in manifest.metrics), *(f"leaf/{n}" for n in manifest.leaves)}
        whole = about == (manifest.digest, *manifest.span(shard)) and names == set(arrays)
        return arrays if whole and _fitting(manifest, shard, arrays, leaves) else None
    except (OSError, ValueError, KeyError):
        return None


def missing(
    folder: Path, manifest: Manifest, leaves: Mapping[str, tuple[int, ...]], note: Callable[[str], None]
) -> list[int]:
    """The shards that are to be computed, those among them that are there and damaged said in a `note`."""
    left = [i for i in range(manifest.shards) if read_shard(folder, manifest, i, leaves) is None]
    if damaged := [i for i in left if path_of(folder, i).exists()]:
        shown = ", ".join(map(str, damaged[:5])) + (", ..." if len(damaged) > 5 else "")
        note(f"{len(damaged)} of {manifest.shards} shards are damaged or cut short ({shown}): they are computed again")
    return left


def _fitting(
    manifest: Manifest, shard: int, arrays: Mapping[str, np.ndarray], leaves: Mapping[str, tuple[int, ...]] | None
) -> bool:
    """Whether arrays have the shapes and dtypes that the sweep writes."""
    _, count = manifest.span(shard)
    for name, array in arrays.items():
        kind = "b" if name == "result/ok" else "f"
        shape: tuple[int, ...] = (len(manifest.names), count)
        if name.startswith("leaf/"):
            leaf = name.removeprefix("leaf/")
            shape = (count, *(array.shape[1:] if leaves is None else leaves[leaf]))
        if array.dtype.kind != kind or array.shape != shape:
            return False
    return True


def begun(folder: Path, manifest: Manifest) -> bool:
    """Whether this sweep was begun in a folder without a manifest: it was lost, or not written yet."""
    if any(read_shard(folder, manifest, i) is not None for i in range(manifest.shards)):
        return True
    return files.bare(folder)


def sweep_up(folder: Path) -> None:
    """Remove what processes that are gone left lying; of earlier releases also the claims by which they shared work."""
    files.sweep_up(folder)
    for path in folder.glob("*.claim"):
        if path.is_file() and not path.is_symlink():
            path.unlink(missing_ok=True)
