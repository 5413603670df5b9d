"""From logs and a configuration to all that is identified; and a first drive where there is no log yet."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from agvjax import Fault, InputError

from .. import config as configuration
from ..config.settings import Config
from .conclusion import Conclusion, conclude
from .coverage import Covered, covered
from .excitation import Designer, Drive, Room, motion
from .fit import Fit, Task
from .load import Count, uncounted
from .log import Log, commands_of, same_channels, same_drive
from .model import Model
from .parameters import Parameter, parameters, values
from .plain import plain_models
from .predict import Prediction, predict, windows
from .rules import faults
from .task import model_of, read, task
from .verdict import FitVerdict, settled

Tick = Callable[[str], object]  # is told the name of each part of the work as it ends
ASSUMED = {"x": 2e-3, "y": 2e-3, "heading": 1e-3, "vx": 4e-3, "vy": 4e-3}  # channels and noise where no log tells them


class Identified(NamedTuple):
    """All that logs tell."""

    task: Task
    fit: Fit
    verdict: FitVerdict
    predictions: list[Prediction]  # none where nothing is identified
    conclusion: Conclusion
    covered: Covered  # what the logs have driven
    drive: Drive | None  # a suggestion; None where none was asked for, or the plant does not say what a motion needs


def identify(
    logs: Sequence[str], config: Config, unseen: Sequence[str] = (), tick: Tick = lambda text: None
) -> Identified:
    """What the actuators of a vehicle really do, from recorded drives.

    Args:
        logs: CSV files.
        config: the vehicle as it is assumed, and in `identify` what is to be found.
        unseen: CSV files of other drives, to be predicted.
        tick: is told the name of each part of the work as it ends.

    Raises:
        agvjax.InputError: lists every bad setting, or names the log and what is wrong with it.
    """
    config = configuration.check(config, faults)
    posed = task(logs, config)
    return identified(config, posed, to_predict(unseen, config, posed), tick)


def to_predict(files: Sequence[str], config: Config, posed: Task, count: Count = uncounted) -> tuple[Log, ...]:
    """The logs of other drives, which must measure the same and be long enough; `count` is told how much was read.

    Raises:
        agvjax.InputError: names the log and what is wrong with it.
    """
    if not files:
        return ()
    logs, settings = read(files, config, count)[0], config.identify
    wrong = same_channels([posed.logs[0], *logs])
    rule = "a drive that was not learned from: what the fit has seen is no prediction"
    wrong += [Fault("--unseen", log.name, rule) for log in logs if any(same_drive(log, own) for own in posed.logs)]
    rule = f"long enough to predict identify.horizon, {settings.horizon:g} s of it, without a gap"
    short = [log for log in logs if not windows(log, settings.horizon, settings.memory, settings.gap)]
    if wrong := wrong + [Fault("--unseen", log.name, rule) for log in short]:
        raise InputError(wrong)
    return logs


def identified(config: Config, posed: Task, unseen: Sequence[Log], tick: Tick) -> Identified:
    """Fit, judge, predict and suggest, of a configuration that has been checked.

    Raises:
        agvjax.InputError: the commands do not explain the log, but would with another sign, unit or order.
    """
    settings, drive = config.identify, None
    fitted, verdict = settled(posed, settings, config.seed, tick)
    predictions: list[Prediction] = []
    ahead: list[Prediction] = []
    if verdict.identified:  # or it would be the assumed vehicle that predicts
        pace = settings.horizon, settings.memory, settings.gap
        long = [log for log in posed.logs if windows(log, *pace)]  # the logs themselves, where there is no other
        ahead = predict(fitted, unseen or long, *pace, plain_models(config.scenario.plant, posed.logs))
        predictions = ahead if unseen else []
    tick("predicted")
    said = conclude(posed.logs, fitted, verdict, ahead, not unseen)
    if settings.drives and _says_needs(config):
        p = np.where([e.identified for e in verdict.estimates], fitted.p, values(posed.parameters))
        drive = _suggested(config, fitted.model, posed.parameters, p, fitted.sigma, posed.logs[0].step, tick)
    return Identified(posed, fitted, verdict, predictions, said, covered(config.scenario, posed.logs), drive)


def first_drive(config: Config, tick: Tick = lambda text: None) -> Drive:
    """A drive for a vehicle of which there is no log yet.

    Raises:
        agvjax.InputError: the plant does not say what a motion needs.
    """
    plant = config.scenario.plant
    if not _says_needs(config):
        rule = "a plant with `needs(motion)` where no log is given, so that a drive can be suggested"
        raise InputError([Fault("scenario.plant", type(plant).__name__, rule)])
    period = config.controller.control_period()
    step = 0.02 if period is None else float(period)
    model, limits = model_of(config, tuple(ASSUMED), commands_of(plant), step), np.array(_limits(config))
    ends = np.where(np.isfinite(limits), limits, 1.0)
    nothing = Log("none", 0.0, np.arange(2) * step, np.stack([ends, -ends]), model.commands, {})
    wanted = parameters(model.scenario, model.names, [nothing], step / model.substeps, config.identify.memory)
    return _suggested(config, model, wanted, values(wanted), np.array([*ASSUMED.values()]), step, tick)


def _says_needs(config: Config) -> bool:
    """Whether the plant says what a motion needs."""
    return bool(config.scenario.plant.needs(motion(*np.zeros((5, 1)))))


def _limits(config: Config) -> tuple[float, ...]:
    """How large each command may be: what the law says, where it says so."""
    limits = config.controller.input_limits()
    if limits is None:
        return (np.inf,) * len(commands_of(config.scenario.plant))
    return tuple(np.asarray(limits, float).tolist())


def _suggested(
    config: Config,
    model: Model,
    wanted: Sequence[Parameter],
    p: np.ndarray,
    sigma: np.ndarray,
    step: float,
    tick: Tick,
) -> Drive:
    settings = config.identify
    room = Room(settings.speed, settings.yaw_rate, _limits(config), settings.extent, settings.duration, step)
    designer = Designer(model, wanted, p, sigma, room, settings.segment, settings.memory)
    return designer.suggest(settings.drives, config.seed, tick)
