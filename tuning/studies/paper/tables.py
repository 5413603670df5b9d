"""Tables 1 and 2: our figure beside the printed one in every cell, with a verdict that follows from a rule."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

import agvjax

from ...io.files import Json
from ...io.pages import grid
from .cases import LABELS, Judged, Run
from .published import CHANNELS, TABLE1, TABLE2, Printed

COMPARED = ("settling_time", "rmse")  # what the paper prints
COMMANDS = ("rms_command", "peak_command", "chatter")
SAME = 0.05  # a figure counts as reproduced within this share of the printed one, which has two digits
APART = 0.01  # two figures stand in an order if they differ by more than this share

RULES = (
    f"**Reproduced**: within {SAME:.0%} of the print, or unsettled in both. **Ordering**: not that, but ranked against"
    f" every other controller of the table as in the print, by more than {APART:.0%}."
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
    return {
        name: {
            channel: _ours(runs[name], i) | (_judged(runs, printed, name, i) if name in printed else {})
            for i, channel in enumerate(CHANNELS)
        }
        for name in names or printed
    }


def _ours(run: Run, i: int) -> dict[str, Cell]:
    values = {
        "settling_time": run.judged.settling_time,
        "rmse": run.judged.rmse,
        "rmse_after_4s": run.judged.rmse_late,
        "rms_command": run.judged.rms_command,
        "peak_command": run.judged.peak_command,
        "chatter": run.judged.chatter,
        "settling_time_5_percent": run.metrics["5 % of the first error"].settling_time,
        "settling_time_2_percent": run.metrics["2 % of the first error"].settling_time,
        "last_outside_0.05": last_outside(run.trajectory),
    }
    return {name: Cell(float(value[i])) for name, value in values.items()}


def last_outside(trajectory: agvjax.Trajectory, band: float = 0.05) -> np.ndarray:
    """Last time outside the band [s], (3,), settled or not."""
    outside = np.abs(np.asarray(agvjax.tracking_error(trajectory))) > band
    return np.max(np.where(outside, np.asarray(trajectory.t)[:, None], 0.0), axis=0)


def _judged(runs: Judged, printed: Mapping[str, Printed], name: str, i: int) -> dict[str, Cell]:
    """What the paper prints of a controller in a channel: ours, the print, verdict and reason."""
    cells = {}
    for metric in COMPARED:
        ours, paper = (float(getattr(figures, metric)[i]) for figures in (runs[name].judged, printed[name]))
        orders = {other: _orders(runs, printed, (name, other), i, metric) for other in printed if other != name}
        wrong = [f"{LABELS[other]} ({_IN_PRINT[theirs]})" for other, (here, theirs) in orders.items() if here != theirs]
        if np.isinf(ours) if np.isinf(paper) else abs(ours - paper) <= SAME * paper:
            why = "unsettled in both" if np.isinf(ours) else f"{ours / paper - 1:+.1%}"
            cells[metric] = Cell(ours, paper, "reproduced", why)
            continue
        unsettled = "settled here" if np.isinf(paper) else "unsettled here"
        why = unsettled if np.isinf(paper) or np.isinf(ours) else f"{ours / paper:.2f} x print"
        why += f"; differs against {', '.join(wrong)}" if wrong else "; stands as printed against every other"
        if metric == "rmse":
            first = horizon(runs[name].trajectory, i, paper)
            longest = f"the print's over the first {first:.2f} s"
            why += f"; ours is {'smaller over every horizon' if np.isnan(first) else longest}"
        elif np.isfinite(paper) and wrong:
            why += f"; last outside 0.05 at {last_outside(runs[name].trajectory)[i]:.2f} s"
        cells[metric] = Cell(ours, paper, "not" if wrong else "ordering", why)
    return cells


_IN_PRINT = {-1: "the print has it larger", 0: "the print has them alike", 1: "the print has it smaller"}


def _orders(
    runs: Judged, printed: Mapping[str, Printed], names: tuple[str, str], i: int, metric: str
) -> tuple[int, int]:
    """How two controllers stand in a channel, here and in print: 1 where the first figure is larger, 0 alike."""
    here = _order(*(float(getattr(runs[name].judged, metric)[i]) for name in names))
    return here, _order(*(float(getattr(printed[name], metric)[i]) for name in names))


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


def number(value: float | None, metric: str = "") -> str:
    """A figure for a reader."""
    if value is None:
        return ""
    if np.isinf(value):
        return "unsettled" if metric.startswith("settling") else "diverged"
    return f"{value:.3f}" if metric.startswith(("settling", "last")) else f"{value:.4g}"


MARKS = {"reproduced": "**reproduced**", "ordering": "ordering", "not": "not"}


def _cells(made: Table) -> Iterator[tuple[str, str, str, Cell]]:
    """Every cell with its controller, channel and metric."""
    for name, channels in made.items():
        for channel, cells in channels.items():
            for metric, cell in cells.items():
                yield name, channel, metric, cell


def markdown(made: Table) -> str:
    """Printed metrics beside ours with the verdict, then what the paper does not print."""
    header = ["controller", "channel", "settling [s]", "paper", "verdict", "RMSE", "paper", "verdict"]
    lines = []
    for name, channels in made.items():
        for channel, cells in channels.items():
            row = [LABELS.get(name, name), channel]
            for metric in COMPARED:
                cell = cells[metric]
                row += [number(cell.ours, metric), number(cell.paper, metric), MARKS.get(cell.verdict or "", "")]
            lines.append(row + [number(cells[m].ours, m) for m in ("rmse_after_4s", *COMMANDS)])
    return grid([*header, "RMSE after 4 s", "RMS command", "peak", "chatter"], lines)


def reasons(made: Table) -> str:
    """Why, for every printed cell that is not reproduced."""
    lines = [
        [LABELS.get(name, name), channel, metric, cell.verdict, cell.why]
        for name, channel, metric, cell in _cells(made)
        if cell.verdict in ("ordering", "not")
    ]
    return grid(["controller", "channel", "metric", "verdict", "why"], lines)


def counts(made: Table) -> dict[str, dict[str, int]]:
    """How many cells have which verdict, by metric."""
    verdicts = [(metric, cell.verdict or "not") for _, _, metric, cell in _cells(made)]
    return {metric: {mark: verdicts.count((metric, mark)) for mark in MARKS} for metric in COMPARED}


def pairs(runs: Judged, printed: Mapping[str, Printed]) -> dict[str, tuple[int, int]]:
    """By metric: of the comparisons of two controllers in a channel that the print decides, how many go as printed."""
    agreed = {}
    for metric in COMPARED:
        every = [_orders(runs, printed, p, i, metric) for p in itertools.combinations(printed, 2) for i in range(3)]
        decided = [here == theirs for here, theirs in every if theirs != 0]
        agreed[metric] = (sum(decided), len(decided))
    return agreed


def plain(made: Table) -> Json:
    """For `tables.json`: controller -> channel -> metric -> ours, paper, verdict, why."""

    def values(metric: str, cell: Cell) -> Json:
        infinite = {key: x for key, x in (("ours", cell.ours), ("paper", cell.paper)) if x is not None and np.isinf(x)}
        return cell._asdict() | {key: number(x, metric) for key, x in infinite.items()}

    return {
        name: {c: {metric: values(metric, cell) for metric, cell in cells.items()} for c, cells in channels.items()}
        for name, channels in made.items()
    }


def rows(made: Table) -> list[list[Any]]:
    """For CSV: controller, channel, metric, ours, paper, verdict, why."""
    return [
        [name, channel, metric, number(c.ours, metric), number(c.paper, metric), c.verdict or "", c.why or ""]
        for name, channel, metric, c in _cells(made)
    ]


COLUMNS = ("controller", "channel", "metric", "ours", "paper", "verdict", "why")
PRINTED = {"table1": TABLE1, "table2": TABLE2}
