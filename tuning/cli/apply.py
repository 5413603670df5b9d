"""`agvjax apply`: may new gains replace those on the robot? By what its last log leaves possible."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

from agvjax import Fault, InputError
from agvjax.protocols import Law

from .. import config as configuration
from ..apply import apply, page
from ..apply.known import Known, of_folder, of_log
from ..apply.rules import faults
from ..config import Config
from ..identify import rules as of_logs
from ..identify.fit import ROUNDS
from ..identify.posterior import SCENARIO
from ..identify.task import task
from ..io import files
from ..io.logs import is_recording
from .console import Console
from .folders import begun_in, of_run
from .log import reading
from .prepare import configure, overrides


def run(arguments: argparse.Namespace) -> int:
    """Read both files, know the vehicle, compare, decide; write report, and if accepted the files for the robot."""
    if wrong := _asked(arguments):
        raise InputError(wrong)
    new, current = of_run(arguments.new, page.ROBOT), of_run(arguments.over, page.ROBOT)
    contents = _bytes("--over", current), _bytes("NEW.toml", new)
    around = [*arguments.config, *([str(Path(arguments.identified) / SCENARIO)] if arguments.identified else [])]
    given = argparse.Namespace(**{**vars(arguments), "config": [*around, new]})
    config, console = configure(given, _rules if arguments.log else faults, reading(arguments))
    if arguments.identified:  # the vehicle is that of the log, whatever else the file of the new gains says
        there = configuration.load(around, overrides(arguments), imports=arguments.imports, note=lambda text: None)
        if (its := type(there.scenario.plant)) is not (mine := type(config.scenario.plant)):
            rule = f"of a log of the vehicle of the new gains, {mine.__name__}: this one is of {its.__name__}"
            raise InputError([Fault("--identified", arguments.identified, rule)])
        config = dataclasses.replace(config, scenario=there.scenario, ensemble=there.ensemble)
    law = _current([*around, current], arguments, config)
    named = Path(current).name, Path(new).name
    named = named if named[0] != named[1] else (current, new)
    with begun_in(arguments.out, arguments.command) as out:
        known = _known(console, arguments, config)
        with console.parts("comparing", 4) as tick:
            result = apply(known, law, config.controller, tick)
        text = page.write(config, result, named, contents, out)
    where = f"written to {out}: " + (f"{page.ROBOT} for the robot, {page.BACK}, " if result.decision.accepted else "")
    console.conclude(text, f"{where}{out}/report.html")
    return 0 if result.decision.accepted else 1


def _asked(arguments: argparse.Namespace) -> list[Fault]:
    """Options that do not go together."""
    wrong = []
    if arguments.over is None:
        wrong.append(Fault("--over", "none", "given: the file of the gains that are on the robot"))
    if bool(arguments.log) == bool(arguments.identified):
        value = arguments.identified if arguments.log else "none"
        wrong.append(Fault("--log", value, "given, or --identified with the folder of a log's identification"))
    if own := [text for text in arguments.set if text.split("=")[0].split(".")[0].strip() == "controller"]:
        wrong.append(Fault("--set", own[0], "no gain: these are compared as they stand in their files"))
    return wrong


def _rules(config: Config) -> list[Fault]:
    return faults(config) or of_logs.faults(config)


def _bytes(key: str, name: str) -> bytes:
    try:
        return files.content(Path(name))
    except (OSError, ValueError) as error:
        raise InputError([Fault(key, name, f"a file of gains that can be read ({error})")]) from error


def _current(names: list[str], arguments: argparse.Namespace, config: Config) -> Law:
    """The law on the robot, whose file must be for the vehicle of the new one."""
    read = configuration.load(names, overrides(arguments), imports=arguments.imports, note=lambda text: None)
    if (mine := type(read.scenario.plant)) is not (other := type(config.scenario.plant)):
        rule = f"gains for the same vehicle: these are for {mine.__name__}, the new ones for {other.__name__}"
        raise InputError([Fault("--over", arguments.over, rule)])
    return read.controller


def _known(console: Console, arguments: argparse.Namespace, config: Config) -> Known:
    """The vehicle, by its logs."""
    if arguments.identified:
        return of_folder(config, arguments.identified)
    with console.phases() as phases:
        phase = phases.begin("reading", unit="messages" if any(map(is_recording, arguments.log)) else "rows")
        posed = task(arguments.log, config, phase.advance)
    with console.parts("fitting", config.identify.starts + ROUNDS + 1) as tick:
        return of_log(config, posed, tick)
