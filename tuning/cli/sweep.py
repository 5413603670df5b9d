"""`agvjax sweep`: a robustness sweep, in this process or by workers, and its report."""

from __future__ import annotations

import argparse
import contextlib
import itertools
from collections.abc import Sequence
from pathlib import Path

from agvjax import Fault, InputError

from .. import config as configuration
from ..compute import schedule
from ..compute.jobs import Engine, Jobs, WorkFailed
from ..sweep import shards, verdict, work
from ..sweep.conclude import conclude
from ..sweep.laws import named
from ..sweep.rules import faults, moving
from ..sweep.run import Parcel, fill, jobs, parcel
from . import rare
from .axes import swept
from .console import Console, RunFailed, failing
from .prepare import configure, warn
from .sweep_folder import begin, begun


def run(arguments: argparse.Namespace) -> int:
    """Compute the shards that are missing, and write the report."""
    _of_earlier_releases(arguments)
    if arguments.scheduler is not None:
        schedule.checked(arguments.scheduler)
    if arguments.rare:
        return rare.run(arguments)
    config, console = configure(arguments, faults, swept(arguments), moving)
    plan, laws = work.planned(config), named(config, arguments.imports)
    manifest = work.manifest_of(config, plan, laws)
    with contextlib.ExitStack() as ours:
        ours.enter_context(failing((WorkFailed,)))
        before = begun(arguments, console, manifest, ours)
        warn(console, config, "sweep", moving=moving(config))
        missing = shards.missing(*before, plan.leaf_shapes, console.note) if before else None
        alike = None if arguments.scheduler is None else 1  # then workers of this machine find it compiled
        with schedule.opened(arguments.scheduler if missing != [] else None, console.note) as engine:
            console.say(f"{plan.size} scenarios, {len(laws)} controller(s), {manifest.shards} shards; compiling ...")
            judges = work.judges(config, plan, list(laws.values()), manifest.block, alike)
            verdict.bounds_of(config, plan, judges[0], manifest.block)  # before all the work, and a file is written
            out, manifest = before or begin(arguments, console, manifest, configuration.dump(config), ours)
            if missing is None:
                missing = shards.missing(out, manifest, plan.leaf_shapes, console.note)
            _fill(out, manifest, missing, jobs(parcel(manifest, arguments.imports), plan, judges), engine, console)
        conclude(config, out, manifest, plan, laws, judges, console.say)
    return 0


def _of_earlier_releases(arguments: argparse.Namespace) -> None:
    """Refuse the options by which processes once shared a sweep: what they ask for would not be done."""
    given = {"--num-processes": arguments.num_processes, "--process-id": arguments.process_id}
    rule = "left out: workers share a sweep, --scheduler"
    if wrong := [Fault(name, value, rule) for name, value in given.items() if value is not None]:
        raise InputError(wrong)


def _fill(
    out: Path,
    manifest: shards.Manifest,
    missing: Sequence[int],
    made: Jobs[Parcel],
    engine: Engine,
    console: Console,
) -> None:
    """Compute the missing shards, and say how far that is."""
    with console.phases() as phases:
        phase, ticks = phases.begin("rolling out", manifest.size, "scenarios", scale=True), itertools.count()
        try:
            fill(out, manifest, missing, made, engine, lambda n: phase.advance(n, before=next(ticks) == 0))
        except (OSError, WorkFailed) as error:
            why = f"a shard could not be written ({error})" if isinstance(error, OSError) else str(error)
            done = f"{sum(shards.path_of(out, i).exists() for i in range(manifest.shards))} of {manifest.shards}"
            raise RunFailed(f"{why}; {done} are kept in {out}: repeat the same command, it continues") from error
