"""The draws of a search for rare failures, chunk by chunk: made here or by workers, each kept in a file of its own."""

from __future__ import annotations

import dataclasses
import functools
import tomllib
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import ArrayLike

from ...compute.jobs import Engine, Jobs, Make
from ...config.load import resolve
from ...config.settings import Config
from ...io import files
from .. import sent
from ..design import design
from ..laws import law_of
from . import loop
from .estimate import Drawn, drawn
from .mixture import Mixture
from .prepare import Prepared
from .problem import Problem
from .rules import faults

DRAWS = "rare-draws"  # how their files begin
REAL = ("cut", "probability", "variance", "pilot", "covered")  # numbers of what was prepared
Arrays = dict[str, np.ndarray]


class Parcel(NamedTuple):
    """All that a chunk depends on besides its number, as it is sent to another process.

    Attributes:
        config: the configuration, TOML.
        gains: the controller, TOML.
        bounds: beyond which a run has failed, by metric.
        found: what was prepared.
        seed: of the draws.
        size: draws in a chunk.
        digest: of all that.
        files: those of classes of one's own.
    """

    config: str
    gains: str
    bounds: dict[str, float]
    found: Arrays
    seed: int
    size: int
    digest: str
    files: sent.Files

    def span(self, number: int) -> tuple[int, int]:
        """The first draw of a chunk, and how many it has."""
        first = number * self.size
        return first, min(self.size, int(self.found["draws"]) - first)


def parcel(
    config: Config, bounds: Mapping[str, float], prepared: Prepared, digest: str, imports: Sequence[str]
) -> Parcel:
    """Of a search, with the files that its classes of one's own are in."""
    text, gains = sent.texts(config, [config.controller])
    found = {name: np.asarray(value) for name, value in arrays(prepared).items()}
    return Parcel(text, gains, dict(bounds), found, config.seed, config.sweep.shard, digest, sent.packed(imports))


def jobs(parcel: Parcel, problem: Problem) -> Jobs[Parcel]:
    """The chunks as jobs; `problem` is what this process rolls out with."""
    return Jobs("chunk", functools.partial(_chunk, parcel, problem), prepare, parcel)


def prepare(parcel: Parcel) -> Make:
    """What makes the chunks in a process that was sent them.

    Raises:
        agvjax.InputError: the configuration names a class that no file has.
        ValueError: it is read to something else than it was written of.
    """
    table = tomllib.loads(parcel.config)
    with sent.unpacked(parcel.files) as imports:
        config = resolve(table, faults, imports)
        law = law_of(tomllib.loads(parcel.gains), table, imports)
    config = dataclasses.replace(config, controller=law)
    sent.same(config, [law], (parcel.config, parcel.gains))
    return functools.partial(_chunk, parcel, loop.problem(config, design(config), law, parcel.bounds, devices=1))


def _chunk(parcel: Parcel, problem: Problem, number: int) -> bytes:
    """The file of one chunk: which of its draws failed."""
    made = drawn(problem, prepared_of(parcel.found), parcel.seed, *parcel.span(number))
    return packed(parcel.digest, {"failed": made.failed})


def drawn_in(
    folder: Path,
    jobs: Jobs[Parcel],
    opened: Callable[[], AbstractContextManager[Engine]],
    tick: Callable[[int], None],
    note: Callable[[str], None],
) -> Drawn:
    """All draws; what the folder does not hold is made and kept there.

    Args:
        folder: where to keep them.
        jobs: what makes them.
        opened: who does, called if some are missing.
        tick: called with the number of draws that are there.
        note: told of files that are made again.

    Raises:
        WorkFailed: workers failed; what is written is whole.
    """
    parcel, prepared = jobs.about, prepared_of(jobs.about.found)
    paths = [folder / f"{DRAWS}-{i:05d}.npz" for i in range(-(-prepared.draws // parcel.size))]
    missing = [i for i, path in enumerate(paths) if _failed(path, parcel, i) is None]
    tick(prepared.draws - sum(parcel.span(i)[1] for i in missing))
    if spoilt := [paths[i].name for i in missing if paths[i].exists()]:
        note(f"{len(spoilt)} files of draws are damaged, or of another search ({spoilt[0]} first): made again")
    if missing:
        with opened() as engine:
            for i, data in engine.each(jobs, missing):
                files.write(paths[i], data)
                tick(parcel.span(i)[1])
    return _drawn(paths, parcel, prepared)


def _drawn(paths: Sequence[Path], parcel: Parcel, prepared: Prepared) -> Drawn:
    """All draws, their files being there."""
    parts = []
    for i, path in enumerate(paths):
        u, plain = prepared.mixture.draw(parcel.seed, "estimate", *parcel.span(i))
        failed = _failed(path, parcel, i)
        if failed is None:
            raise OSError(f"{path} is not what was written there a moment ago")
        parts.append(Drawn(u, prepared.mixture.weights(u), failed, plain))
    return Drawn(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _failed(path: Path, parcel: Parcel, number: int) -> np.ndarray | None:
    found = read(path, parcel.digest)
    whole = found is not None and set(found) == {"failed"} and found["failed"].shape == (parcel.span(number)[1],)
    return found["failed"] if found is not None and whole else None


def arrays(prepared: Prepared) -> dict[str, ArrayLike]:
    """What was prepared, by name, for a file or another process."""
    mixture = {f"mixture/{name}": value for name, value in prepared.mixture._asdict().items()}
    return mixture | {name: value for name, value in prepared._asdict().items() if name != "mixture"}


def prepared_of(arrays: Arrays) -> Prepared:
    """The same again."""
    mixture = Mixture(arrays["mixture/points"], arrays["mixture/shares"], float(arrays["mixture/wide"]))
    tried, draws, spent = (int(arrays[name]) for name in ("tried", "draws", "spent"))
    cut, mean, variance, pilot, covered = (float(arrays[name]) for name in REAL)
    return Prepared(mixture, cut, mean, variance, tried, pilot, covered, draws, spent)


def packed(digest: str, arrays: Mapping[str, ArrayLike]) -> bytes:
    """The bytes of a file of arrays that belong to some settings."""
    return files.npz({"digest": np.asarray(digest), **arrays})


def read(path: Path, digest: str) -> Arrays | None:
    """What a file holds, every byte of it checked; None if it is absent, cut short, damaged or of other settings."""
    try:
        arrays = files.read_npz(path)
        return arrays if str(arrays.pop("digest")) == digest else None
    except (OSError, ValueError, KeyError):
        return None
