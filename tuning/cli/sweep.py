"""`agvjax sweep`: a robustness sweep, in this process or by workers, and its report."""

from __future__ import annotations

import argparse
import contextlib
import itertools
from collections.abc import Sequence
from pathlib import Path

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
    if arguments.rare:
        return rare.run(arguments)
    config, console = configure(arguments, faults, swept(arguments), moving)
    plan, laws = work.planned(config), named(config, arguments.imports)
    manifest = work.manifest_of(config, plan, laws)
    with contextlib.ExitStack() as ours:
        ours.enter_context(failing((WorkFailed,)))
        before = begun(arguments, console, manifest, ours)
        warn(console, config, "sweep", moving=moving(config))
        if arguments.process_id is not None or arguments.num_processes is not None:
            console.warn(
                "--num-processes and --process-id do nothing here any more; workers share a sweep: --scheduler"
            )
        engine = ours.enter_context(schedule.opened(arguments.scheduler, console.note))
        console.say(f"{plan.size} scenarios, {len(laws)} controller(s), {manifest.shards} shards; compiling ...")
        alike = None if arguments.scheduler is None else 1  # then workers of this machine find it compiled
        judges = work.judges(config, plan, list(laws.values()), manifest.block, alike)
        verdict.bounds_of(config, plan, judges[0], manifest.block)  # before all the work, and before a file is written
        out, manifest = before or begin(arguments, console, manifest, configuration.dump(config), ours)
        made = jobs(parcel(manifest, arguments.imports), plan, judges)
        _fill(out, manifest, shards.missing(out, manifest, plan.leaf_shapes, console.note), made, engine, console)
        conclude(config, out, manifest, plan, laws, judges, console.say)
    return 0


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
