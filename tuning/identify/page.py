"""The report of `agvjax identify`: what is known and how surely, what is not and what drive would tell."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from agvjax.leaves import leaves

from .. import config as configuration
from ..config.settings import Config
from ..io import files, statements
from ..io.files import Json
from ..io.pages import grid, look_at_logs, picture, publish
from ..io.pictures import Drawing, write_figures
from . import figures
from .coverage import Covered, beyond
from .excitation import Drive
from .left import against
from .log import Log, in_files
from .overlay import compared
from .posterior import ESTIMATES, SCENARIO, posterior
from .run import Identified
from .verdict import FitVerdict

UNKNOWN = "not identifiable"
MANY = 0.03  # share of outliers beyond which something else is wrong
CAPTIONS = {
    "deadzones": "What every actuator delivers over what it is told, with the 95 % interval; and how often each"
    " command came.",
    "excitation": "Commands of the suggested drive, and where it leads.",
    "predictions": "How the error of the prediction grows with time, on drives not fitted; of many the largest.",
    "residuals": "What the model leaves unexplained, in standard deviations, over time; and its distribution beside the"
    " normal.",
    "coverage": "What was driven: speed and yaw rate, by half seconds.",
    "paths": "Where the vehicle was, and where the fitted model has it in every stretch; of many logs the farthest.",
}
ABSENT, READ = "What was looked for and is not there", "What was read"
MOST, SOME = 6, 3  # parameters, and unseen logs, that a terminal is told
FEW = 10  # stretches below which the bootstrap says little
COUNTED = {  # the fields of `Counts` in words
    "rows": "rows",
    "segments": "stretches",
    "gaps": "gaps",
    "warm_up": "rows from which only commands are taken (beginning, after gaps)",
    "left_over": "rows that fill no stretch",
    "blank": "measurements that are not there",
    "outliers": "measurements left out as outliers",
}
COMPLETE = "Five minutes of these, levels held for a second or two and half a minute of each, would complete it."
METHOD = (
    "Each window begins in the state that fits one second of measurements before it; then only the commands are known."
    " Plain models, learned from the same logs, see the same."
    " A sinusoid in the disturbance is left out, its phase in another drive being unknown."
)
TUNE = (
    "`scenario.toml` holds the identified scenario and, as its ensemble, the uncertainty above with its correlations;"
    " what is not identifiable keeps the range that was assumed: `agvjax tune --config scenario.toml`."
)


def write(config: Config, result: Identified, out: Path) -> str:
    """Everything into a folder; returns what is printed."""
    fit, verdict, logs = result.fit, result.verdict, result.task.logs
    tuned = posterior(config, fit, verdict)
    files.write(out / SCENARIO, configuration.dump(tuned))
    files.write_json(out / ESTIMATES, estimates(result))
    drawn: dict[str, Drawing] = {
        "residuals": lambda: figures.residuals(fit, verdict),
        "paths": lambda: figures.paths(result.task, fit),
        "coverage": lambda: figures.coverage(result.task.logs),
    }
    if figures.fitted(result.task, verdict):
        drawn["deadzones"] = lambda: figures.deadzones(result.task, fit, verdict)
    if result.predictions:
        drawn["predictions"] = lambda: figures.predictions(result.predictions)
    lost = write_figures(out, drawn)
    if result.drive is not None:
        lost += _write_drive(result.drive, out)
    tracks, picked = compared(logs, fit), figures.worst(figures.left_of(result.task, fit))
    both = [(logs[i].name, *tracks[i]) for i in picked]
    text = page(result, tuned, "deadzones" in drawn, look_at_logs(out, both))
    publish(out, text, (ABSENT, READ))
    return "\n\n".join([brief(result), *lost])


def write_drive(drive: Drive, out: Path) -> str:
    """`excitation.csv` and its picture; returns what the drive would tell."""
    return "\n\n".join([suggestion(drive), *_write_drive(drive, out)])


def _write_drive(drive: Drive, out: Path) -> list[str]:
    """The same; returns what could not be drawn."""
    header = ["t", *in_files(drive.commands), "expected_x", "expected_y", "expected_heading"]
    rows = np.column_stack([drive.t, drive.inputs, drive.path, drive.heading]).round(6).tolist()
    files.write_csv(out / "excitation.csv", header, rows)
    return write_figures(out, {"excitation": lambda: figures.drive(drive)})


def estimates(result: Identified) -> Json:
    """The numbers, for scripts; of what is not identifiable none but its reason."""
    fit, verdict = result.fit, result.verdict
    numbers = ("unit", "value", "deviation", "gauss_newton", "bootstrap", "low", "high", "identified")
    shown = {e.name: numbers if e.identified else ("identified", "reason", "drive") for e in verdict.estimates}
    errors = ("log", "horizon", "windows", "worst", "rms", "plain")
    return {
        "good": result.conclusion.good,
        "lacks": list(result.covered.lacks),
        "conclusion": result.conclusion.text,
        "logs": [log.name for log in result.task.logs],
        "counts": fit.counts._asdict(),
        "noise": dict(zip(fit.model.channels, fit.sigma.tolist(), strict=True)),
        "correlation_with_the_next_row": dict(verdict.left.white),
        "lacks_in_the_model": verdict.left.lacks,
        "follows_the_commands": dict(verdict.left.follows),
        "uneven": {kind: {"from": t, "times": many} for kind, (t, many) in verdict.left.uneven.items()},
        "change": verdict.left.change._asdict() if verdict.left.change else None,
        "starts": {"at_the_best": fit.arrived[0], "of": fit.arrived[1]},
        "parameters": {e.name: {key: getattr(e, key) for key in shown[e.name]} for e in verdict.estimates},
        "correlation": {"names": list(shown), "matrix": verdict.correlation.tolist()},
        "predictions": [{key: getattr(p, key) for key in errors} for p in result.predictions],
    }


def table(verdict: FitVerdict) -> str:
    """A row for each parameter; no number where the log does not tell."""
    rows = []
    for e in verdict.estimates:
        unit = "" if e.unit == "1" else e.unit.replace("unit of the command", "command")
        if e.identified:
            interval, deviations = f"{e.low:.4g} to {e.high:.4g}", (f"{e.gauss_newton:.2g}", f"{e.bootstrap:.2g}")
            rows.append([e.name, f"{e.value:.4g}", interval, unit, *deviations])
        elif e.drive:
            rows.append([e.name, UNKNOWN, "", unit, "", ""])
    return grid(["parameter", "value", "95 % interval", "unit", "deviation", "by bootstrap"], rows)


def brief(result: Identified) -> str:
    """For a terminal: how much is known, what speaks against it, the first values, how well other drives come out."""
    everything = result.verdict.estimates
    known = [e for e in everything if e.identified]
    rows = [[e.name, f"{e.value:.4g}", f"{e.low:.4g} to {e.high:.4g}", e.unit] for e in known[:MOST]]
    head = f"{result.verdict.identified} of {len(everything)} parameters are identified."
    lacks = [lacking(result.covered)] if result.covered.lacks else []
    parts = [result.conclusion.text, head, *lacks, *_warnings(result)]
    if rows:
        more = f"\nand {len(known) - MOST} more, in the report" if len(known) > MOST else ""
        parts.append(grid(["parameter", "value", "95 % interval", "unit"], rows) + more)
    return "\n\n".join([*parts, *([predicted(result, SOME)] if result.predictions else [])])


def driven(covered: Covered) -> str:
    """What logs have driven, before anything is made of it, and what a drive that completes them has."""
    shares = [[name, f"{share:.0%}"] for name, share in covered.shares.items()]
    rows = [[c, f"{low:.3g} to {high:.3g}", f"{small:.0%}", turns] for c, low, high, small, turns in covered.commands]
    return "\n\n".join(
        [
            grid(["the vehicle goes", "share of the time"], shares),
            grid(["command", "from least to most", "small ones", "times up or down"], rows),
            lacking(covered) or "It has something of everything.",
            _picture("coverage"),
        ]
    )


def lacking(covered: Covered) -> str:
    """What a log lacks, as the drive that would complete it; empty where that is nothing."""
    if not covered.lacks:
        return ""
    return f"It lacks, or has hardly any: {', '.join(covered.lacks)}. {COMPLETE}"


def predicted(result: Identified, most: int | None = None) -> str:
    """How well other drives are predicted, beside plain models; of many `most`, the worst."""
    logs = result.predictions if most is None else sorted(result.predictions, key=lambda p: -p.rms)[:most]
    names = list(dict.fromkeys(name for p in logs for name in p.plain))
    errors = [[p.worst, p.rms, *(p.plain.get(name, np.nan) for name in names)] for p in logs]
    rows = [[p.log, p.windows, *(f"{1e3 * x:.1f}" for x in own)] for p, own in zip(logs, errors, strict=True)]
    horizon, others = logs[0].horizon, [f"rms with {name} [mm]" for name in names]
    text = grid(["unseen log", "windows", f"largest error within {horizon:g} s [mm]", "rms [mm]", *others], rows)
    left = len(result.predictions) - len(logs)
    return text + (f"\nand {left} more, which are predicted better, in the report" if left else "")


def _warnings(result: Identified) -> list[str]:
    fit, verdict = result.fit, result.verdict
    outliers, stretches, (best, starts) = fit.counts.outliers, fit.counts.segments, fit.arrived
    rows = int((fit.segments.weight > 0).sum()) + outliers
    lost = ", ".join(e.name for e in verdict.estimates if e.drive)
    warnings = {
        "Nothing is identified: scenario.toml holds what was assumed, and no other drive is predicted.": (
            not verdict.identified
        ),
        f"{UNKNOWN.capitalize()} from this drive, of {len(fit.p)} parameters: {lost}.": lost,
        f"{outliers} of {rows} measurements were left out as outliers: too many for a sound log.": (
            outliers > MANY * rows
        ),
        **dict.fromkeys([*beyond(result.task.model.scenario, result.covered), *against(verdict.left)], True),
        f"Only 1 of {starts} starts ended at the best fit: try more, identify.starts.": best == 1 < starts,
        f"Only {stretches} stretches: the bootstrap says little; record a longer drive.": stretches < FEW,
        "The logs have no clock in common: no sinusoid in the disturbance was looked for.": (
            not result.task.one_clock and not all(fit.free)
        ),
    }
    return [text for text, holds in warnings.items() if holds]


# long: one part of the page after the other
def page(result: Identified, tuned: Config, deadzones: bool, closer: str = "") -> str:
    """The text of `report.md`: the problem to tune for, whether there is a figure of deadzones, a link to others."""
    everything, drive, predictions = result.verdict.estimates, result.drive, result.predictions
    lost = [[e.name, e.reason, e.drive, _instead(tuned, e.name)] for e in everything if e.drive]
    absent = [[e.name, e.reason] for e in everything if e.absent]
    counts = result.fit.counts._asdict()
    parts = [
        f"# {_title(result)}",
        result.conclusion.text,
        f"{result.verdict.identified} of {len(everything)} parameters are identified.",
        *_warnings(result),
        table(result.verdict),
        "Deviations are standard: Gauss and Newton's covariance, and beside it a bootstrap over stretches of the log."
        " Intervals take the wider of the two, and Student's quantile for as many stretches as tell the number.",
        statements.said(statements.of_kind(statements.INTERVAL)),
    ]
    if deadzones:
        parts.append(_picture("deadzones"))
    if lost:
        parts += [
            "## What this drive does not tell",
            grid(["parameter", "why", "what would tell it", "in scenario.toml"], lost),
        ]
    parts += ["## What was driven", driven(result.covered)]
    if absent:
        parts += [f"## {ABSENT}", grid(["parameter", ""], absent)]
    if drive is not None:
        parts += [
            "## A drive that would tell the deadzones",
            suggestion(drive),
            _picture("excitation"),
        ]
    if predictions:
        parts += [
            "## Drives it has not seen",
            predicted(result),
            METHOD,
            _picture("predictions"),
        ]
    parts += [f"## {READ}", _logs(result.task.logs)]
    parts += [grid(["", "count"], [[COUNTED[name], n] for name, n in counts.items()])]
    parts += [
        "## Residuals",
        _picture("residuals"),
        _picture("paths"),
        *([closer] if closer else []),
    ]
    parts += ["## Tune for it", TUNE] if result.verdict.identified else []
    return "\n\n".join(parts) + "\n"


def _logs(logs: Sequence[Log]) -> str:
    """The logs, and below each how it was read."""
    return "\n".join("\n".join([f"- {log.name}", *(f"    - {note}" for note in log.notes)]) for log in logs)


def _picture(name: str) -> str:
    return picture(f"{name}.png", CAPTIONS[name])


def _title(result: Identified) -> str:
    names = [log.name for log in result.task.logs]
    return f"What {names[0] if len(names) == 1 else f'{len(names)} logs'} say{'s' if len(names) == 1 else ''}"


def _instead(tuned: Config, name: str) -> str:
    """What the problem to tune for has of a number that is not identifiable."""
    there = leaves(tuned.scenario)
    if name not in there:
        return "not there, as assumed"
    if (draw := tuned.ensemble.draws.get(name)) is None:
        return f"{float(there[name]):.4g}, as assumed"
    low, high = (float(end) for end in draw.box(np.asarray(there[name], float)))
    return f"drawn from {low:.4g} to {high:.4g}, as assumed"


def suggestion(drive: Drive) -> str:
    """What a suggested drive would tell."""
    deadzones = {name: half for name, half in drive.expected.items() if name.startswith("deadzone.")}
    rows = [[name, f"{half:.2g}"] for name, half in (deadzones or drive.expected).items()]
    wide = np.ptp(drive.path, axis=0)
    return (
        f"`excitation.csv`: commands to give open loop, {drive.t[-1]:g} s in about {wide[0]:.1f} by {wide[1]:.1f} m,"
        f" the best of {drive.candidates} for what is known now. Leave room, and a hand on the switch: errors of the"
        f" model let it drift.\n\n{grid(['parameter', '95 % interval would be +-'], rows)}"
    )
