"""What the last log says of the vehicle: identified now, or before, in a folder of `agvjax identify`."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from agvjax import Fault, InputError

from ..config.settings import Config
from ..identify.fit import Task
from ..identify.posterior import ESTIMATES, SCENARIO, posterior
from ..identify.run import Tick, identified
from ..io import files


class Known(NamedTuple):
    """A vehicle by its last log."""

    config: Config  # its scenario and its ensemble are what the log leaves possible
    text: str  # what its numbers are good for
    against: tuple[str, ...]  # why nothing should be decided by them; none where it may
    logs: tuple[str, ...]


def of_log(config: Config, posed: Task, tick: Tick) -> Known:
    """By logs that are fitted now.

    Raises:
        agvjax.InputError: the commands do not explain the log, but would with another sign, unit or order.
    """
    asked = dataclasses.replace(config, identify=dataclasses.replace(config.identify, drives=0))
    found = identified(asked, posed, (), tick)
    left = posterior(config, found.fit, found.verdict)
    change = found.verdict.left.change
    said = against(found.conclusion.good, found.conclusion.text, None if change is None else change.t)
    there = dataclasses.replace(config, scenario=left.scenario, ensemble=left.ensemble)
    return Known(there, found.conclusion.text, said, tuple(log.name for log in posed.logs))


def of_folder(config: Config, folder: str) -> Known:
    """By a run of `agvjax identify`, whose scenario the configuration has.

    Raises:
        agvjax.InputError: the folder does not say what was found.
    """
    try:
        told = json.loads(files.text(Path(folder) / ESTIMATES))
        good, text, change = bool(told["good"]), str(told["conclusion"]), told["change"]
        logs: Sequence[str] = [str(name) for name in told["logs"]]
        when = None if change is None else float(change["t"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        rule = f"a folder of agvjax identify, with {SCENARIO} and {ESTIMATES} ({error})"
        raise InputError([Fault("--identified", folder, rule)]) from error
    return Known(config, text, against(good, text, when), tuple(logs))


def against(good: bool, text: str, change: float | None) -> tuple[str, ...]:
    """Why nothing should be decided by what a log says: good for nothing, or of a vehicle that changed on the way."""
    if not good:
        return (f"the log does not tell the vehicle: {text}",)
    if change is not None:
        return (f"from t = {change:.0f} s on the log is of a vehicle that behaves differently: give what is behind",)
    return ()
