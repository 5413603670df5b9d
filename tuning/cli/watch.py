"""`agvjax watch`: are gains still tuned for the robot that a log is of?"""

from __future__ import annotations

import argparse

from ..identify.fit import ROUNDS
from ..identify.task import task
from ..io.logs import is_recording
from ..watch import page, watch
from ..watch.rules import faults
from ..watch.run import STARTS, asked
from .folders import begun_in, of_run
from .log import reading
from .prepare import configure


def run(arguments: argparse.Namespace) -> int:
    """Read the logs, hold them against what the gains were tuned for, say what comes of it; 1 unless still tuned."""
    files = [of_run(name, "config.toml") for name in arguments.config]
    given = argparse.Namespace(**{**vars(arguments), "config": files})
    config, console = configure(given, faults, reading(arguments))
    with console.phases() as phases:
        phase = phases.begin("reading", unit="messages" if any(map(is_recording, arguments.logs)) else "rows")
        posed = task(arguments.logs, asked(config), phase.advance)
    with begun_in(arguments.out, arguments.command) as out:
        with console.parts("comparing", STARTS + ROUNDS + 2) as tick:
            found = watch(config, posed, tick)
        text = page.write(config, found, posed.logs, out)
    console.conclude(text, f"written to {out}; begin with {out}/report.html")
    return 0 if found.told and not found.alarm else 1
