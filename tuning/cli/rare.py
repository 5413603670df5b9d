"""`agvjax sweep --rare`: how likely a failure is, where plain samples meet none."""

from __future__ import annotations

import argparse
import contextlib
import itertools
import os
from pathlib import Path

from agvjax import Fault, InputError

from ..compute import schedule
from ..compute.jobs import WorkFailed
from ..config import Config
from ..io.alone import alone
from ..sweep import shards
from ..sweep.rare import page, rules, study
from ..sweep.rules import moving
from .axes import swept
from .console import RunFailed, failing
from .folders import new_folder, not_empty, same_folder
from .prepare import configure, warn


def run(arguments: argparse.Namespace) -> int:
    """Search, draw and estimate; write the report. The same command continues what was stopped."""
    left_out = {"--samples": arguments.samples, "--process-id": arguments.process_id}
    left_out |= {"--num-processes": arguments.num_processes}
    rules_of = {"--samples": "left out with --rare: --set sweep.rollouts=N"}
    wrong = [
        Fault(name, value, rules_of.get(name, "left out with --rare: workers share it, --scheduler"))
        for name, value in left_out.items()
        if value is not None
    ]
    if wrong:
        raise InputError(wrong)
    config, console = configure(arguments, rules.faults, swept(arguments), moving)
    warn(console, config, "sweep", moving=moving(config))
    ticks = itertools.count()
    with contextlib.ExitStack() as ours:
        ours.enter_context(failing((WorkFailed,)))
        engine = ours.enter_context(schedule.opened(arguments.scheduler, console.note))
        phases = ours.enter_context(console.phases())
        phase = phases.begin("rolling out", config.sweep.rollouts, "vehicles", scale=True)
        asked = study.posed(config, lambda vehicles: phase.advance(vehicles, before=next(ticks) == 0))
        out = _folder(arguments, config)
        ours.enter_context(alone(out))
        outcome = study.run(asked, out, phase.note, phase.advance, engine, arguments.imports or ())
    told = page.write(asked, outcome, out)
    console.conclude(told.text, f"written to {out}; begin with {out}/report.html")
    if told.failure:
        raise RunFailed(f"no estimate is stated: {told.failure}")
    return 0


def _folder(arguments: argparse.Namespace, config: Config) -> Path:
    """A new folder, or that of the same search."""
    out = Path(arguments.out or os.devnull)
    begun = (out / "config.toml").exists()
    if begun and (out / shards.MANIFEST).exists():
        raise not_empty(out, arguments.command)
    make = same_folder if arguments.resume or begun else new_folder
    return make(arguments.out, arguments.command, config)
