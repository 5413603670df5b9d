"""`agvjax compare`: every law, tuned to one command budget."""

from __future__ import annotations

import argparse

from agvjax import InputError

from ..config.complete import by_whole_error
from ..studies.laws import page, study
from ..studies.paper import cases
from ..tune.rules import faults, moving
from .folders import new_folder
from .prepare import configure


def run(arguments: argparse.Namespace) -> int:
    """Tune every law to one command budget; write table, figure and report."""
    config, console = configure(arguments, faults, moving=moving)
    config = by_whole_error(config)
    if bad := cases.faults(config.controller, config.scenario):
        raise InputError(bad)
    out = new_folder(arguments.out, arguments.command, config)
    with console.parts(len(study.laws(config.controller)) + 1, "law", (RuntimeError, ValueError)) as tick:
        comparison, tuned = study.compare(config, tick)
    console.say(page.write(comparison, tuned, out), f"written to {out}; begin with {out}/report.html")
    return 0
