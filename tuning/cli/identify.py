"""`agvjax identify`: what the actuators of a vehicle really do, from recorded drives."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import numpy as np

from agvjax import Fault, InputError

from .. import config as configuration
from ..config.settings import Config
from ..identify import page, task
from ..identify.excitation import Designer, Drive, Room
from ..identify.fit import ROUNDS, Task
from ..identify.log import POSE, Log, commands_of, same_channels
from ..identify.parameters import parameters, values
from ..identify.predict import predict, windows
from ..identify.verdict import identify
from ..io import files
from .folders import new_folder
from .prepare import configure

ASSUMED = {"x": 2e-3, "y": 2e-3, "heading": 1e-3, "vx": 4e-3, "vy": 4e-3}  # noise where no log tells it


def run(arguments: argparse.Namespace) -> int:
    """Fit the logs, judge, predict, suggest a drive; write report, estimates and the scenario to tune for."""
    more = {"identify.fit": arguments.fit.split(",")} if arguments.fit is not None else None
    config, console = configure(arguments, more=more)
    task.check(config)
    if arguments.unseen and not arguments.logs:
        raise InputError([Fault("--unseen", arguments.unseen[0], "left out where no log is given to learn from")])
    if not arguments.logs and not config.identify.drives:
        raise InputError([Fault("LOG.csv", "none", "given, or identify.drives above 0 for a drive to be suggested")])
    posed = task.task(arguments.logs, config) if arguments.logs else None
    unseen = _unseen(arguments, config, posed) if posed and arguments.unseen else ()
    out = new_folder(arguments.out, arguments.command)
    settings = config.identify
    total = settings.drives + (settings.starts + ROUNDS if posed else 0)
    with console.parts(total) as tick:
        if posed is None:
            drive = first_drive(config, tick)
            page.write_drive(drive, out)
            text = page.suggestion(drive)
        else:
            try:
                found = _found(config, posed, unseen, tick)
            except InputError:
                out.rmdir()  # nothing was written yet
                raise
            text = page.write(config, found, out)
    files.write(out / "config.toml", configuration.dump(config))
    more = f"; begin with {out}/report.html, go on with agvjax tune --config {out}/scenario.toml" if posed else ""
    console.say(text, f"written to {out}{more}")
    return 0


def _unseen(arguments: argparse.Namespace, config: Config, posed: Task) -> tuple[Log, ...]:
    """The logs to predict, which must measure the same and be long enough."""
    logs, settings = task.read(arguments.unseen, config)[0], config.identify
    found = same_channels([posed.logs[0], *logs])
    for log in logs:
        if not windows(log, settings.horizon, settings.memory, settings.gap):
            rule = f"long enough to predict identify.horizon, {settings.horizon:g} s of it, without a gap"
            found.append(Fault("--unseen", log.name, rule))
    if found:
        raise InputError(found)
    return logs


def _found(config: Config, posed: Task, unseen: tuple[Log, ...], tick: Callable[[str], None]) -> page.Found:
    settings = config.identify
    fitted, verdict = identify(posed, settings, config.seed, tick)
    seen = predict(fitted, unseen, settings.horizon, settings.memory, settings.gap) if unseen else []
    first = posed.logs[0]
    known = np.where([e.identified for e in verdict.estimates], fitted.p, values(posed.parameters))
    drive = _drive(config, fitted.model, posed.parameters, known, fitted.sigma, first.step, tick)
    return page.Found(posed, fitted, verdict, seen, drive)


def first_drive(config: Config, tick: Callable[[str], None]) -> Drive:
    """A drive for a vehicle of which there is no log yet."""
    period = config.controller.control_period()
    step = 0.02 if period is None else float(period)
    commands = commands_of(config.scenario.plant)
    model = task.of(config, (*POSE, "vx", "vy"), commands, step)
    limits = np.array(_limits(config))
    ends = np.where(np.isfinite(limits), limits, 1.0)
    nothing = Log("none", 0.0, np.arange(2) * step, np.stack([ends, -ends]), commands, {})
    wanted = parameters(model.scenario, model.names, [nothing], step / model.substeps)
    sigma = np.array([ASSUMED[name] for name in model.channels])
    drive = _drive(config, model, wanted, values(wanted), sigma, step, tick)
    assert drive is not None
    return drive


def _limits(config: Config) -> tuple[float, ...]:
    """How large a command may be: what the computer's anti-windup says, where there is one."""
    limits = config.controller.input_limits()
    count = len(config.scenario.plant.actuators)
    return tuple(np.asarray(limits, float).tolist()) if limits is not None else (np.inf,) * count


def _drive(
    config: Config, model: Any, wanted: Any, p: np.ndarray, sigma: np.ndarray, step: float, tick: Callable[[str], None]
) -> Drive | None:
    settings = config.identify
    if not settings.drives:
        return None
    room = Room(settings.speed, settings.yaw_rate, _limits(config), settings.extent, settings.duration, step)
    designer = Designer(model, wanted, p, sigma, room, settings.segment, settings.memory)
    return designer.suggest(settings.drives, config.seed, tick)
