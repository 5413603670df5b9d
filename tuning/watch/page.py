"""The report of `agvjax watch`: still tuned, no longer, or not to be told; and which number seems to have moved."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .. import config as configuration
from ..config.settings import Config
from ..identify.left import against, left
from ..identify.log import Log
from ..identify.verdict import advice
from ..io import files
from ..io.csv_file import KINDS
from ..io.files import Json
from ..io.pages import grid, picture, publish
from ..io.pictures import write_figures
from . import figures
from .run import Number, Watched, critical

CAPTION = (
    "Left how far this log is from the model that the gains were tuned for, among logs that were simulated of vehicles"
    " they were tuned for, with the same commands; right how much of that each number alone explains."
)
STEPS, METHOD = "One step ahead", "How this is told"
HOW = (
    "The log is cut into stretches; in each the model that the gains were tuned for is given the commands and begins"
    " where it fits best. What is left has slopes by every number that is watched. How far these say that the numbers"
    " have moved, in units of how far they seem to in a hundred simulated logs, is the distance. The same is done with"
    " {logs} logs that are simulated of vehicles drawn from the ensemble, their numbers up to {allowed:.0%} off, under"
    " the same commands, with what the log's own best fit leaves as noise, of every stretch with a random sign. An"
    " alarm is raised where no more than {alarms:.3g} of all these logs are as far: that is how often it is false for"
    " such a robot, if its noise is alike upside down and differs from stretch to stretch."
)


def write(config: Config, found: Watched, logs: Sequence[Log], out: Path) -> str:
    """Everything into a folder; returns what is printed."""
    limit = critical(found.others, config.watch.false_alarms)
    files.write(out / "config.toml", configuration.dump(config))
    files.write_json(out / "watch.json", told(found))
    lost = write_figures(out, {"distance": lambda: figures.distance(found, limit)})
    doubts = against(left(found.fit, logs, config.seed))
    publish(out, page(config, found, [log.name for log in logs], doubts), (STEPS, METHOD))
    return "\n\n".join([verdict(config, found), *lost])


def told(found: Watched) -> Json:
    """The numbers, for scripts."""
    names = ("unit", "tuned", "seems", "explains", "seen", "wanted", "told")
    return {
        "verdict": "no longer tuned" if found.alarm else "still tuned" if found.told else "cannot be told",
        "rank": found.rank,
        "moved": [one.name for one in found.moved],
        "numbers": {one.name: {key: getattr(one, key) for key in names} for one in found.numbers},
    }


def verdict(config: Config, found: Watched) -> str:
    """Plain sentences."""
    rate, lost = config.watch.false_alarms, [one for one in found.numbers if not one.told]
    chance = f"{found.rank:.1%} of logs of vehicles that the gains were tuned for are as far from the model"
    if found.alarm:
        best, *others = found.moved
        more = f"; {', '.join(map(_seems, others))} would explain nearly as much" if others else ""
        return (
            f"**No longer tuned for this robot.** Only {chance}; for an unchanged robot an alarm like this is raised by"
            f" {rate:.1%} of the logs. What seems to have moved: {_seems(best)}{more}. Identify the log, tune, and ask"
            " `agvjax apply`."
        )
    if not found.told:
        drives = dict.fromkeys(advice(one.name) for one in lost)
        text = f"This log would not show a change of {config.watch.seen:.0%} of any number."
        return f"**Cannot be told.** {text} Not driven: {'; '.join(drives)}."
    text = f"**Still tuned for this robot.** {chance[0].upper()}{chance[1:]}; an alarm is raised below {rate:.1%}."
    if lost:
        drives = dict.fromkeys(advice(one.name) for one in lost)
        text += (
            f" Of {len(lost)} of {len(found.numbers)} numbers this log would not show a change of"
            f" {config.watch.seen:.0%}: {', '.join(one.name for one in lost)}. What would tell: {'; '.join(drives)}."
        )
    return text


def _seems(one: Number) -> str:
    unit = "" if one.unit == "1" else f" {one.unit}"
    return f"{one.name} (tuned for {one.tuned:.4g}, now about {one.seems:.4g}{unit})"


def _least(one: Number) -> str:
    """The least change that a log shows of a number, in words where it is none."""
    if not np.isfinite(one.seen):
        return "none: the log says nothing of it"
    return f"{one.seen:.2g}" + ("" if one.told else ", more than it should")


def page(config: Config, found: Watched, logs: list[str], doubts: list[str]) -> str:
    """The text of `report.md`."""
    names = f"{', '.join(logs[:3])}{' and others' if len(logs) > 3 else ''}"
    rows = [
        [
            one.name,
            f"{one.tuned:.4g}",
            f"{one.spread:.2g}",
            f"{one.seems:.4g}" if np.isfinite(one.seen) else "",
            f"{one.explains:.0%}" if np.isfinite(one.seen) else "",
            _least(one),
            one.unit,
        ]
        for one in sorted(found.numbers, key=lambda one: -one.explains)
    ]
    header = ["number", "tuned for", "+-", "seems now, alone", "explains", "least change seen", "unit"]
    low, high = np.quantile(found.others_steps, [0.025, 0.975], axis=0)
    ahead = [
        [c, f"{own:.3g}", f"{a:.3g} to {b:.3g}", KINDS[c].split()[0]]
        for c, own, a, b in zip(found.fit.model.channels, found.steps, low, high, strict=True)
    ]
    method = HOW.format(logs=config.watch.logs, alarms=config.watch.false_alarms, allowed=config.watch.allowed)
    least = "The least change seen raises the alarm in 9 of 10 such logs, were it the only one."
    parts = [f"# {names}: are the gains still tuned?", verdict(config, found), picture("distance.png", CAPTION)]
    parts += [grid(header, rows), least, *doubts]
    parts += [f"## {STEPS}", grid(["channel", "rms here", "95 % of vehicles tuned for", "unit"], ahead)]
    return "\n\n".join([*parts, f"## {METHOD}", method]) + "\n"
