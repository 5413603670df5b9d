"""`agvjax margins`: how far a loop is from losing its stability."""

from __future__ import annotations

import argparse

from ..studies.margins.rules import faults
from .console import RunFailed
from .folders import new_folder
from .prepare import configure, warn


def run(arguments: argparse.Namespace) -> int:
    """Linearise the configured loop along its run, for many vehicles; write margins, limit cycles and a report."""
    config, console = configure(arguments, faults)
    from ..studies.margins import page  # late: python-control is an extra
    from ..studies.margins.cycles import predict
    from ..studies.margins.study import study

    out = new_folder(arguments.out, arguments.command, config)
    warn(console, config, "tune")
    with console.parts("linearising", 3) as tick:
        found = study(config, tick)
        predicted = predict(config, found, tick)
    told = page.write(config, found, predicted, out)
    console.conclude(told.text, f"written to {out}; begin with {out}/report.html")
    if told.failure:
        raise RunFailed(told.failure)
    return 0
