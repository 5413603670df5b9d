"""Computing the shards that a folder lacks, here or by workers, and taking up what lies there."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from agvjax.protocols import Law

from .. import config as configuration
from ..compute import schedule
from ..compute.jobs import Engine, Jobs, Make
from ..config.load import said
from ..config.settings import Config
from ..io import files
from ..io.alone import alone
from . import results, sent, shards, work
from .design import Design
from .laws import CONFIGURED
from .results import Results
from .rules import faults
from .shards import Manifest


def run_sweep(
    config: Config,
    folder: str | Path,
    laws: Mapping[str, Law] | None = None,
    scheduler: str | None = None,
    imports: Sequence[str] = (),
) -> Results:
    """Roll out what is missing in a folder, and return all of it; laws of one's own are welcome.

    Args:
        config: the scenarios are those of its `sweep`.
        folder: new, or with what an interrupted call left.
        laws: controllers by name, the first also the one whose gains are swept; None for the configured one.
        scheduler: who computes; None: this process, else as `--scheduler` of the command line has it. Classes of one's
            own reach workers in files alone.
        imports: files of classes of one's own, for workers.

    Raises:
        agvjax.InputError: lists every bad setting; or another process is at work in the folder.
        ValueError: the folder holds another sweep.
        tuning.compute.jobs.WorkFailed: workers failed; the same call goes on.
    """
    laws = {CONFIGURED: config.controller} if laws is None else dict(laws)
    config = configuration.check(config, faults)
    folder, plan = Path(folder), work.planned(config)
    manifest = work.manifest_of(config, plan, laws)
    if scheduler is not None:
        schedule.checked(scheduler, "scheduler")
        _read(parcel(manifest, imports))  # before anything is written, what workers could not read
    _taken_up(folder, manifest)  # another sweep is refused before anything is written
    folder.mkdir(parents=True, exist_ok=True)
    with alone(folder, "folder"), schedule.opened(scheduler, said, "scheduler") as engine:
        before = _taken_up(folder, manifest)
        if before is None:
            shards.write_manifest(folder, manifest)
        manifest = before or manifest
        every = work.judges(config, plan, list(laws.values()), manifest.block, None if scheduler is None else 1)
        missing = shards.missing(folder, manifest, plan.leaf_shapes, said)
        fill(folder, manifest, missing, jobs(parcel(manifest, imports), plan, every), engine)
    return results.collect(folder, manifest, config, plan)


def _taken_up(folder: Path, manifest: Manifest) -> Manifest | None:
    """The manifest to go on with; None where none is there."""
    if not (folder / shards.MANIFEST).exists():
        return None
    try:
        return shards.taken_up(shards.read_manifest(folder), manifest)
    except ValueError as error:
        raise ValueError(f"{folder} holds another sweep: {error}") from error


def fill(
    folder: Path,
    manifest: Manifest,
    missing: Sequence[int],
    jobs: Jobs[Parcel],
    engine: Engine,
    tick: Callable[[int], None] = lambda scenarios: None,
) -> None:
    """Compute shards and write them; this process alone writes in the folder.

    Args:
        folder: of the sweep, with its manifest.
        manifest: of the sweep.
        missing: the shards; see `shards.missing`.
        jobs: what makes them; see `jobs`.
        engine: who does.
        tick: called with the number of scenarios that are done, first with those of before.

    Raises:
        WorkFailed: workers failed; what is written is whole.
    """
    tick(manifest.size - sum(manifest.span(i)[1] for i in missing))
    for i, data in engine.each(jobs, missing):
        files.write(shards.path_of(folder, i), data)
        tick(manifest.span(i)[1])


class Parcel(NamedTuple):
    """A sweep as it is sent to another process.

    Attributes:
        manifest: of it.
        files: those of classes of one's own.
    """

    manifest: Manifest
    files: sent.Files


def parcel(manifest: Manifest, imports: Sequence[str] = ()) -> Parcel:
    """A sweep with the files that its classes of one's own are in."""
    return Parcel(manifest, sent.packed(imports))


def jobs(parcel: Parcel, plan: Design, every: Sequence[work.Judge]) -> Jobs[Parcel]:
    """The shards of a sweep as jobs.

    Args:
        parcel: of the sweep, for other processes.
        plan: its scenarios.
        every: what judges them in this process, one for each controller.
    """
    return Jobs("shard", functools.partial(work.shard, parcel.manifest, plan, every), prepare, parcel)


def prepare(parcel: Parcel) -> Make:
    """What makes the shards of a sweep in a process that was sent it."""
    manifest, (config, laws) = parcel.manifest, _read(parcel)
    plan = results.plan_of(manifest, config)
    return functools.partial(work.shard, manifest, plan, work.judges(config, plan, laws, manifest.block, 1))


def _read(parcel: Parcel) -> tuple[Config, list[Law]]:
    """The configuration and the controllers of a parcel.

    Raises:
        agvjax.InputError: they name a class that no file has.
        ValueError: they are read to something else than they were written of.
    """
    manifest = parcel.manifest
    with sent.unpacked(parcel.files) as imports:
        config = results.config_of(manifest, imports)
        laws = [results.controller_of(manifest, i, imports) for i in range(len(manifest.names))]
    sent.same(config, laws, (manifest.config, *manifest.controllers))
    return config, laws
