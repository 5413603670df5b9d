"""`agvjax identify`: what the actuators of a vehicle really do, from recorded drives."""

from __future__ import annotations

import argparse

from agvjax import Fault, InputError

from .. import config as configuration
from ..identify import page
from ..identify import run as room
from ..identify.fit import ROUNDS
from ..identify.overlay import overlay
from ..identify.posterior import SCENARIO
from ..identify.rules import faults
from ..identify.task import task
from ..io import files, viewers
from ..io.logs import is_recording
from .folders import begun_in
from .log import reading
from .prepare import configure


def run(arguments: argparse.Namespace) -> int:
    """Fit the logs, judge, predict, suggest a drive; write report, estimates and the scenario to tune for."""
    config, console = configure(arguments, faults, reading(arguments))
    settings = config.identify
    if arguments.unseen and not arguments.logs:
        raise InputError([Fault("--unseen", arguments.unseen[0], "left out where no log is given to learn from")])
    if not arguments.logs and not settings.drives:
        raise InputError([Fault("LOG.csv", "none", "given, or identify.drives above 0 for a drive to be suggested")])
    asked = viewers.asked(arguments)
    for kind, file in asked._asdict().items():
        if file is not None and not arguments.logs:
            raise InputError([Fault(f"--{kind}", file, "left out where no log is given to learn from")])
    posed, unseen = None, ()
    if arguments.logs:
        with console.phases() as phases:
            bags = any(map(is_recording, (*arguments.logs, *arguments.unseen)))
            phase = phases.begin("reading", unit="messages" if bags else "rows")
            posed = task(arguments.logs, config, phase.advance)
            unseen = room.to_predict(arguments.unseen, config, posed, phase.advance)
    more, good, result = "", True, None
    with begun_in(arguments.out, arguments.command) as out:
        with console.parts("fitting", settings.drives + (settings.starts + ROUNDS + 1 if posed else 0)) as tick:
            if posed is None:
                text = page.write_drive(room.first_drive(config, tick), out)
            else:
                result = room.identified(config, posed, unseen, tick)
                text, more = page.write(config, result, out), f"; begin with {out}/report.html"
                good = result.conclusion.good
                more += f", go on with agvjax tune --config {out}/{SCENARIO}" if good else ""
        files.write(out / "config.toml", configuration.dump(config))
        if posed is not None and result is not None and any(asked):
            viewers.write_tracks(asked, overlay(posed.logs, result.fit))
    console.conclude(text, f"written to {out}{more}")
    return 0 if good else 1
