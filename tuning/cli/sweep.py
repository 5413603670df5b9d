"""`agvjax sweep`: a robustness sweep by any number of processes, and its report."""

from __future__ import annotations

import argparse
import itertools
import os
from pathlib import Path

from agvjax import Fault, InputError

from .. import config as configuration
from ..config.old import counts_first_command
from ..io import files
from ..io.numbers import INTEGER
from ..sweep import shards, verdict, work
from ..sweep.conclude import conclude
from ..sweep.laws import named
from ..sweep.rules import faults, moving
from . import rare
from .axes import swept
from .console import Console, RunFailed
from .folders import new_folder, not_empty
from .prepare import configure, rank_and_count, warn

PLACES = ("SLURM_ARRAY_TASK_ID", "SLURM_PROCID", "JOB_COMPLETION_INDEX")


def run(arguments: argparse.Namespace) -> int:
    """Take shards until none is missing; whoever finishes last writes the report."""
    if arguments.rare:
        return rare.run(arguments)
    config, console = configure(arguments, faults, swept(arguments), moving)
    plan, laws = work.planned(config), named(config, arguments.imports)
    place = _place(arguments)
    manifest = work.manifest_of(config, plan, laws)
    begun = _begun(arguments, console, manifest)
    warn(console, config, "sweep", moving=moving(config))
    console.say(f"{plan.size} scenarios, {len(laws)} controller(s), {manifest.shards} shards; compiling ...")
    judges = work.judges(config, plan, list(laws.values()), manifest.block)
    verdict.bounds_of(config, plan, judges[0], manifest.block)  # before all the work, and before a file is written
    out, manifest = begun or _begin(arguments, console, manifest, configuration.dump(config))
    ticks = itertools.count()
    with console.phases() as phases:
        phase = phases.begin("rolling out", plan.size, "scenarios", scale=True)

        def tick(scenarios: int) -> None:
            phase.advance(scenarios, before=next(ticks) == 0)

        try:
            work.run(out, manifest, plan, judges, int(place * manifest.shards), tick)
        except OSError as error:
            done = sum(shards.path_of(out, i).exists() for i in range(manifest.shards))
            text = f"a shard could not be written to {out} ({error}); {done} of {manifest.shards} are kept"
            raise RunFailed(f"{text}: fix that and repeat the same command, it continues") from error
    conclude(config, out, manifest, plan, laws, judges, console.say)
    return 0


def _place(arguments: argparse.Namespace) -> float:
    """Where among the shards this process begins, from 0 to 1, by its options or what SLURM and Kubernetes say."""
    given = rank_and_count(arguments.process_id, arguments.num_processes)
    if given is None:
        numbers = [os.environ[name] for name in PLACES if INTEGER.fullmatch(os.environ.get(name, ""))]
        return int(numbers[0]) * (5**0.5 - 1) / 2 % 1 if numbers else 0.0  # spread evenly, however many there are
    rank, count = given
    if count > 1 and not arguments.out:
        raise InputError([Fault("--out", "none", "the folder that the processes share")])
    return rank / count


def _begin(
    arguments: argparse.Namespace, console: Console, manifest: shards.Manifest, text: str
) -> tuple[Path, shards.Manifest]:
    """A new folder with the manifest and the settings, unless another process has begun in it meanwhile."""
    out = Path(arguments.out or os.devnull)
    try:
        out = new_folder(arguments.out, arguments.command)
    except InputError:
        if not out.is_dir() or not shards.just_begun(out, manifest):
            raise
    if begun := _begun(arguments, console, manifest, out):
        return begun
    files.write(out / "config.toml", text)
    shards.write_manifest(out, manifest)
    return out, manifest


def _begun(
    arguments: argparse.Namespace, console: Console, manifest: shards.Manifest, out: Path | None = None
) -> tuple[Path, shards.Manifest] | None:
    """The folder in which this very sweep has begun, with its own manifest; None where none has."""
    out = out or Path(arguments.out or os.devnull)
    if not (out / shards.MANIFEST).exists():
        if arguments.resume:
            rule = "used with --out, the folder of a sweep that has begun"
            raise InputError([Fault("--resume", arguments.out, rule)])
        if arguments.out and out.is_dir() and not files.empty(out) and not shards.just_begun(out, manifest):
            raise not_empty(out, arguments.command)
        return None
    try:
        before = shards.read_manifest(out)
    except ValueError as error:
        raise InputError([Fault("--out", out, f"a new folder, or that of this sweep ({error})")]) from error
    try:
        manifest = shards.taken_up(before, manifest)
    except ValueError as error:
        raise InputError([Fault("--out", out, f"a new folder, or that of the same sweep; changed: {error}")]) from error
    if before.versions != manifest.versions:
        console.note(f"this sweep was begun with {before.versions}, here are {manifest.versions}")
    if counts_first_command(before.config):
        console.note("in its finished shards the variation of commands and of what is delivered counts the first, too")
    return out, manifest
