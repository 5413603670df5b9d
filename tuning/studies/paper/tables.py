"""Tables 1 and 2: our figure beside the printed one in every cell, with a verdict that follows from a rule."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

import agvjax

from ...io.files import Json
from .cases import LABELS, Judged
from .published import CHANNELS, TABLE1, TABLE2, Printed

SAME = 0.05  # a figure counts as reproduced within this share of the printed one, which has two digits
APART = 0.01  # two figures stand in an order if they differ by more than this share

RULES = (
    f"**Reproduced**: within {SAME:.0%} of the print, or unsettled in both. **Ordering**: not that, but against"
    f" every other controller of the table the figure stands as in the print, apart by more than {APART:.0%}."
    " **Not**: neither."
)


class Cell(NamedTuple):
    """One figure: ours, the printed one (None where the paper prints none), the verdict and the reason for it."""

    ours: float
    paper: float | None = None
    verdict: str | None = None
    why: str | None = None


Table = dict[str, dict[str, dict[str, Cell]]]  # controller -> channel -> metric -> cell


def table(runs: Judged, printed: Mapping[str, Printed], names: tuple[str, ...] = ()) -> Table:
    """A table of the paper, or of `names` that it does not have, from rolled-out cases."""
    made: Table = {}
    for name in names or printed:
        trajectory, metrics = runs[name]
        made[name] = {channel: _ours(trajectory, metrics, i) for i, channel in enumerate(CHANNELS)}
        if name in printed:
            for i, channel in enumerate(CHANNELS):
                for metric in ("settling_time", "rmse"):
                    made[name][channel][metric] = _judged(runs, printed, name, i, metric)
    return made


def _ours(trajectory: agvjax.Trajectory, metrics: Mapping[str, Any], i: int) -> dict[str, Cell]:
    first = metrics["0.05"]
    values = {
        "settling_time": first.settling_time[i],
        "rmse": first.rmse[i],
        "rmse_after_4s": first.rmse_late[i],
        "rms_command": first.rms_command[i],
        "peak_command": first.peak_command[i],
        "chatter": first.chatter[i],
        "settling_time_5_percent": metrics["5 % of the first error"].settling_time[i],
        "settling_time_2_percent": metrics["2 % of the first error"].settling_time[i],
        "last_outside_0.05": last_outside(trajectory)[i],
    }
    return {name: Cell(float(value)) for name, value in values.items()}


def last_outside(trajectory: agvjax.Trajectory, band: float = 0.05) -> np.ndarray:
    """Last time outside the band [s], (3,), settled or not."""
    outside = np.abs(np.asarray(agvjax.tracking_error(trajectory))) > band
    return np.max(np.where(outside, np.asarray(trajectory.t)[:, None], 0.0), axis=0)


def _value(runs: Judged, name: str, i: int, metric: str) -> float:
    return float(getattr(runs[name].judged, metric)[i])


def _judged(runs: Judged, printed: Mapping[str, Printed], name: str, i: int, metric: str) -> Cell:
    ours, paper = _value(runs, name, i, metric), float(getattr(printed[name], metric)[i])
    wrong = []
    for other in printed:
        theirs = _order(paper, float(getattr(printed[other], metric)[i]))
        if other != name and _order(ours, _value(runs, other, i, metric)) != theirs:
            wrong.append(f"{LABELS[other]} ({_IN_PRINT[theirs]})")
    same = np.isinf(ours) if np.isinf(paper) else abs(ours - paper) <= SAME * paper
    if same:
        verdict, why = "reproduced", "unsettled in both" if np.isinf(ours) else f"{ours / paper - 1:+.1%}"
    else:
        verdict = "not" if wrong else "ordering"
        why = (
            "settled here" if np.isinf(paper) else "unsettled here" if np.isinf(ours) else f"{ours / paper:.2f} x print"
        )
        why += f"; differs against {', '.join(wrong)}" if wrong else "; stands as printed against every other"
        if metric == "rmse":
            why += f"; {horizon_of(runs[name][0], i, paper)}"
        elif np.isfinite(paper) and verdict == "not":
            why += f"; last outside 0.05 at {last_outside(runs[name][0])[i]:.2f} s"
    return Cell(ours, paper, verdict, why)


_IN_PRINT = {-1: "the print has it larger", 0: "the print has them alike", 1: "the print has it smaller"}


def _order(a: float, b: float) -> int:
    if np.isinf(a) or np.isinf(b):
        return int(np.isinf(a)) - int(np.isinf(b))
    return 0 if abs(a - b) <= APART * max(a, b) else (1 if a > b else -1)


def horizon(trajectory: agvjax.Trajectory, i: int, rmse: float) -> float:
    """The longest horizon [s] over which the RMSE of channel i is still as large as the given one; NaN if none is."""
    t, e2 = np.asarray(trajectory.t), np.asarray(agvjax.tracking_error(trajectory))[:, i] ** 2
    integral = np.cumsum((e2[1:] + e2[:-1]) / 2 * np.diff(t))
    enough = np.sqrt(integral / t[1:]) >= rmse
    return float(t[1:][enough][-1]) if enough.any() else float("nan")


def horizon_of(trajectory: agvjax.Trajectory, i: int, rmse: float) -> str:
    """The same in words."""
    found = horizon(trajectory, i, rmse)
    return (
        "ours is smaller over every horizon" if np.isnan(found) else f"ours is the print's over the first {found:.2f} s"
    )


def number(value: float | None, metric: str = "") -> str:
    """A figure for a reader."""
    if value is None:
        return ""
    if np.isinf(value):
        return "unsettled" if metric.startswith("settling") else "diverged"
    return f"{value:.3f}" if metric.startswith(("settling", "last")) else f"{value:.4g}"


MARKS = {"reproduced": "**reproduced**", "ordering": "ordering", "not": "not"}


def markdown(made: Table) -> str:
    """Printed metrics beside ours with the verdict, then what the paper does not print."""
    lines = [
        "| controller | channel | settling [s] | paper | verdict | RMSE | paper | verdict | RMSE after 4 s |"
        " RMS command | peak | chatter |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, channels in made.items():
        for channel, cells in channels.items():
            row = [LABELS.get(name, name), channel]
            for metric in ("settling_time", "rmse"):
                cell = cells[metric]
                row += [number(cell.ours, metric), number(cell.paper, metric), MARKS.get(cell.verdict or "", "")]
            row += [number(cells[m].ours, m) for m in ("rmse_after_4s", "rms_command", "peak_command", "chatter")]
            lines.append("| " + " | ".join(row) + " |")
    return "\n".join(lines)


def reasons(made: Table) -> str:
    """Why, for every printed cell that is not reproduced."""
    lines = ["| controller | channel | metric | verdict | why |", "|---|---|---|---|---|"]
    for name, channels in made.items():
        for channel, cells in channels.items():
            for metric, cell in cells.items():
                if cell.verdict in ("ordering", "not"):
                    lines.append(f"| {LABELS.get(name, name)} | {channel} | {metric} | {cell.verdict} | {cell.why} |")
    return "\n".join(lines)


def counts(made: Table) -> dict[str, dict[str, int]]:
    """How many cells have which verdict, by metric."""
    found = {m: dict.fromkeys(MARKS, 0) for m in ("settling_time", "rmse")}
    for channels in made.values():
        for cells in channels.values():
            for metric in found:
                found[metric][cells[metric].verdict or "not"] += 1
    return found


def pairs(runs: Judged, printed: Mapping[str, Printed]) -> dict[str, tuple[int, int]]:
    """By metric: of the comparisons of two controllers in a channel that the print decides, how many go as printed."""
    found = {}
    names = list(printed)
    for metric in ("settling_time", "rmse"):
        kept = of = 0
        for i in range(3):
            for k, name in enumerate(names):
                for other in names[:k]:
                    theirs = _order(*(float(getattr(printed[n], metric)[i]) for n in (name, other)))
                    of += theirs != 0
                    ours = _order(*(_value(runs, n, i, metric) for n in (name, other)))
                    kept += theirs != 0 and ours == theirs
        found[metric] = (kept, of)
    return found


def plain(made: Table) -> Json:
    """For `tables.json`: controller -> channel -> metric -> ours, paper, verdict, why."""

    def said(value: float | None, metric: str) -> Any:
        return number(value, metric) if value is not None and np.isinf(value) else value

    return {
        name: {
            channel: {
                metric: {
                    "ours": said(c.ours, metric),
                    "paper": said(c.paper, metric),
                    "verdict": c.verdict,
                    "why": c.why,
                }
                for metric, c in cells.items()
            }
            for channel, cells in channels.items()
        }
        for name, channels in made.items()
    }


def rows(made: Table) -> list[list[Any]]:
    """For CSV: controller, channel, metric, ours, paper, verdict, why."""
    return [
        [name, channel, metric, number(c.ours, metric), number(c.paper, metric), c.verdict or "", c.why or ""]
        for name, channels in made.items()
        for channel, cells in channels.items()
        for metric, c in cells.items()
    ]


COLUMNS = ("controller", "channel", "metric", "ours", "paper", "verdict", "why")
PRINTED = {"table1": TABLE1, "table2": TABLE2}
