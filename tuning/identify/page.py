"""The report of `agvjax identify`: what is known and how surely, what is not and what drive would tell."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from .. import config as configuration
from ..config.settings import Config
from ..io import files
from ..io.pages import grid, html
from . import figures
from .excitation import Drive
from .posterior import posterior
from .run import Identified
from .verdict import Estimate, FitVerdict

UNKNOWN = "not identifiable"
COLOURED = 0.3  # correlation from row to row above which the model lacks something
MANY = 0.03  # share of outliers beyond which something else is wrong
FEW = 10  # stretches below which the bootstrap says little


METHOD = (
    "Each window begins in the state that fits one second of measurements before it; then only the commands are known."
    " A sinusoid in the disturbance is left out, its phase in another drive being unknown."
)


def write(config: Config, found: Identified, out: Path) -> str:
    """Everything into a folder; returns what is printed."""
    drawn = {"deadzones": figures.deadzones(found.task, found.fit, found.verdict)}
    drawn |= {"residuals": figures.residuals(found.fit, found.verdict), "paths": figures.paths(found.task, found.fit)}
    if found.predictions:
        drawn["predictions"] = figures.predictions(found.predictions)
    for name, figure in drawn.items():
        if figure is not None:
            files.write_figure(out / f"{name}.png", figure)
    if found.drive is not None:
        write_drive(found.drive, out)
    files.write(out / "scenario.toml", configuration.dump(posterior(config, found.fit, found.verdict)))
    files.write_json(out / "estimates.json", estimates(found))
    text = page(found, [name for name, figure in drawn.items() if figure is not None])
    files.write(out / "report.md", text)
    files.write(out / "report.html", html(text, out, "What the log says"))
    return "\n\n".join([table(found.verdict), *_warnings(found), *([predicted(found)] if found.predictions else [])])


def write_first(drive: Drive, out: Path) -> str:
    """A drive where there is no log yet, into a folder; returns what is printed."""
    write_drive(drive, out)
    return suggestion(drive)


def write_drive(drive: Drive, out: Path) -> None:
    """`excitation.csv` and its picture."""
    header = ["t", *drive.commands, "expected_x", "expected_y", "expected_heading"]
    rows = np.column_stack([drive.t, drive.inputs, drive.path, drive.heading]).round(6).tolist()
    files.write_csv(out / "excitation.csv", header, rows)
    files.write_figure(out / "excitation.png", figures.drive(drive))


def estimates(found: Identified) -> dict[str, Any]:
    """The numbers, for scripts; of what is not identifiable none but its reason."""

    def told(e: Estimate) -> dict[str, Any]:
        if not e.identified:
            return {"identified": False, "reason": e.reason, "drive": e.drive}
        return {key: value for key, value in e._asdict().items() if key not in ("name", "reason", "drive")}

    fit = found.fit
    return {
        "logs": [log.name for log in found.task.logs],
        "counts": fit.counts._asdict(),
        "noise": dict(zip(fit.model.channels, fit.sigma.tolist(), strict=True)),
        "correlation_with_the_next_row": found.verdict.white,
        "starts": {"at_the_best": fit.arrived[0], "of": fit.arrived[1]},
        "parameters": {e.name: told(e) for e in found.verdict.estimates},
        "correlation": {
            "names": [e.name for e in found.verdict.estimates],
            "matrix": found.verdict.correlation.tolist(),
        },
        "predictions": [
            {"log": p.log, "horizon": p.horizon, "windows": p.windows, "worst": p.worst, "rms": p.rms}
            for p in found.predictions
        ],
    }


def table(verdict: FitVerdict) -> str:
    """A row for each parameter; no number where the log does not tell."""
    rows = []
    for e in verdict.estimates:
        if not (e.identified or e.drive):
            continue
        unit = "" if e.unit == "1" else e.unit.replace("unit of the command", "command")
        if e.identified:
            rows.append(
                [
                    e.name,
                    f"{e.value:.4g}",
                    f"{e.low:.4g} to {e.high:.4g}",
                    unit,
                    f"{e.gauss_newton:.2g}",
                    f"{e.bootstrap:.2g}",
                ]
            )
        else:
            rows.append([e.name, UNKNOWN, "", unit, "", ""])
    return grid(["parameter", "value", "95 % interval", "unit", "deviation", "by bootstrap"], rows)


def missing(verdict: FitVerdict) -> str:
    """What is not identifiable, why, and what drive would tell it."""
    rows = [[e.name, e.reason, e.drive] for e in verdict.estimates if not e.identified and e.drive]
    return grid(["parameter", "why", "what would tell it"], rows)


def absent(verdict: FitVerdict) -> str:
    """What was looked for and is not there."""
    return grid(["parameter", ""], [[e.name, e.reason] for e in verdict.estimates if not e.identified and not e.drive])


def predicted(found: Identified) -> str:
    """How well other drives are predicted."""
    rows = [[p.log, p.windows, f"{1e3 * p.worst:.1f}", f"{1e3 * p.rms:.1f}"] for p in found.predictions]
    horizon = found.predictions[0].horizon
    return grid(["unseen log", "windows", f"largest error within {horizon:g} s [mm]", "rms [mm]"], rows)


def _warnings(found: Identified) -> list[str]:
    fit, verdict, told = found.fit, found.verdict, []
    lost = [e.name for e in verdict.estimates if not e.identified and e.drive]
    if lost:
        told.append(f"{UNKNOWN.capitalize()} from this drive, of {len(fit.p)} parameters: {', '.join(lost)}.")
    rows = int((fit.segments.weight > 0).sum()) + fit.counts.outliers
    if fit.counts.outliers > MANY * rows:
        told.append(
            f"{fit.counts.outliers} of {rows} measurements were left out as outliers: too many for a sound log."
        )
    coloured = [name for name, x in verdict.white.items() if x > COLOURED]
    if coloured:
        told.append(
            f"What is left of {', '.join(coloured)} is no white noise: the model lacks something there, and values may"
            " be off by more than their intervals say, which take the bootstrap's deviations where those are wider."
            " Fit more (--fit), or another kind of vehicle."
        )
    if fit.arrived[0] == 1 < fit.arrived[1]:
        told.append(f"Only 1 of {fit.arrived[1]} starts ended at the best fit: try more, identify.starts.")
    if fit.counts.segments < FEW:
        told.append(f"Only {fit.counts.segments} stretches: the bootstrap says little; record a longer drive.")
    if not found.task.one_clock and any(not free for free in fit.free):
        told.append("The logs have no clock in common: no sinusoid in the disturbance was looked for.")
    return told


def page(found: Identified, drawn: list[str]) -> str:
    """`report.md`."""
    fit, counts = found.fit, found.fit.counts
    logs = ", ".join(log.name for log in found.task.logs)
    known = sum(e.identified for e in found.verdict.estimates)
    parts = [
        f"# What {logs} says\n\n{known} of {len(fit.p)} parameters are identified.",
        *_warnings(found),
        table(found.verdict),
        "Deviations are standard: Gauss and Newton's covariance, and beside it a bootstrap over stretches of the log."
        " Intervals take the wider of the two.",
    ]
    if "deadzones" in drawn:
        parts.append("![deadzones](deadzones.png)")
    if any(not e.identified and e.drive for e in found.verdict.estimates):
        parts += ["## What this drive does not tell", missing(found.verdict)]
    if any(not e.identified and not e.drive for e in found.verdict.estimates):
        parts += ["## What was looked for and is not there", absent(found.verdict)]
    if found.drive is not None:
        parts += ["## A drive that would tell the deadzones", suggestion(found.drive), "![drive](excitation.png)"]
    if found.predictions:
        parts += ["## Drives it has not seen", predicted(found), METHOD, "![predictions](predictions.png)"]
    parts += [
        "## What was read",
        _read(counts),
        "## What is left",
        "![residuals](residuals.png)",
        "![paths](paths.png)",
    ]
    parts += [
        "## Tune for it",
        "`scenario.toml` holds the identified scenario and, as its ensemble, the uncertainty above with its"
        " correlations; what is not identifiable keeps the range that was assumed:"
        " `agvjax tune --config scenario.toml`.",
    ]
    return "\n\n".join(parts) + "\n"


def _read(counts: Any) -> str:
    words = {
        "rows": "rows",
        "segments": "stretches",
        "gaps": "gaps",
        "warm_up": "rows from which only commands are taken (beginning, after gaps)",
        "left_over": "rows that fill no stretch",
        "blank": "measurements that are not there",
        "outliers": "measurements left out as outliers",
    }
    return grid(["", "count"], [[words[name], value] for name, value in counts._asdict().items()])


def suggestion(drive: Drive) -> str:
    """What a suggested drive would tell."""
    own = {name: half for name, half in drive.expected.items() if name.startswith("deadzone.")} or drive.expected
    rows = [[name, f"{half:.2g}"] for name, half in own.items()]
    wide = np.ptp(drive.path, axis=0)
    return (
        f"`excitation.csv`: commands to give open loop, {drive.t[-1]:g} s in about {wide[0]:.1f} by {wide[1]:.1f} m,"
        f" the best of {drive.candidates} for what is known now. Leave room, and a hand on the switch: errors of the"
        f" model let it drift.\n\n{grid(['parameter', '95 % interval would be +-'], rows)}"
    )
