"""`agvjax sweep --rare`: how likely a failure is, where plain samples meet none."""

from __future__ import annotations

import argparse
import contextlib
import functools
import itertools
import os
from pathlib import Path

from agvjax import Fault, InputError

from ..compute import schedule
from ..compute.jobs import WorkFailed
from ..config import Config
from ..io import files
from ..io.alone import alone
from ..sweep.rare import page, rules, study
from ..sweep.rules import moving
from .axes import swept
from .console import RunFailed, failing
from .folders import new_folder, same_settings, usable
from .prepare import configure, warn


def run(arguments: argparse.Namespace) -> int:
    """Search, draw and estimate; write the report. The same command continues what was stopped."""
    if arguments.samples is not None:
        rule = "left out with --rare: --set sweep.rollouts=N"
        raise InputError([Fault("--samples", arguments.samples, rule)])
    config, console = configure(arguments, rules.faults, swept(arguments), moving)
    with contextlib.ExitStack() as ours:
        ours.enter_context(failing((WorkFailed,)))
        out = _begun(arguments, config)  # before anything is compiled
        if out is not None:
            ours.enter_context(alone(out))
            files.sweep_up(out)
        warn(console, config, "sweep", moving=moving(config))
        phases = ours.enter_context(console.phases())
        phase, ticks = phases.begin("rolling out", config.sweep.rollouts, "vehicles", scale=True), itertools.count()

        def tick(vehicles: int) -> None:
            phase.advance(vehicles, before=next(ticks) == 0)

        asked = study.posed(config, tick)
        if out is None:
            out = new_folder(arguments.out, arguments.command, config)
            ours.enter_context(alone(out))
        opened = functools.partial(schedule.opened, arguments.scheduler, console.note)
        outcome = study.run(asked, out, phase.note, tick, opened, arguments.imports or (), console.note)
    told = page.write(asked, outcome, out)
    console.conclude(told.text, f"written to {out}; begin with {out}/report.html")
    if told.failure:
        raise RunFailed(f"no estimate is stated: {told.failure}")
    return 0


def _begun(arguments: argparse.Namespace, config: Config) -> Path | None:
    """The folder in which this very search has begun; None where it may begin. Nothing is written."""
    out = Path(arguments.out or os.devnull)
    if os.path.isdir(out) and study.begun(out):
        same_settings(out, config, "--out")
        return out
    if arguments.resume:
        rule = "used with --out, the folder of a search that has begun"
        raise InputError([Fault("--resume", arguments.out or "without --out", rule)])
    usable(arguments.out, arguments.command)
    return None
