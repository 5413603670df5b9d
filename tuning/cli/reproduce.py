"""`agvjax reproduce`: the paper, rebuilt."""

from __future__ import annotations

import argparse

from agvjax import InputError

from ..studies.paper import page, report
from ..studies.paper import reproduce as paper
from ..tune.rules import faults
from .folders import new_folder
from .prepare import configure


def run(arguments: argparse.Namespace) -> int:
    """Rebuild the paper; write figures, tables, report."""
    config, console = configure(arguments, faults)
    if bad := paper.faults(config):
        raise InputError(bad)
    out = new_folder(arguments.out, arguments.command, config)
    options = [f"--config {name}" for name in arguments.config] + [f"--set {text}" for text in arguments.set]
    with console.parts("rebuilding the paper", paper.steps(config)) as tick:
        rebuilt = paper.Reproduction(config, tick)
        lost = report.write(rebuilt, out, " ".join(["agvjax reproduce", *options]), tick)
    told = f"report, tables and figures written to {out}; begin with {out}/report.html"
    console.conclude("\n\n".join([page.summary(rebuilt), *lost]), told)
    return 0
