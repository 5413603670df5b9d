"""Figures of a tuning run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

import agvjax
from agvjax.draw import plot

from ..io.panels import panels
from .analysis import Findings, Standing
from .methods.objective import FEASIBLE
from .rounds import COLUMNS, Run

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LETTERS = 95  # that fit beside each other below a panel, with 6 for each line
COLOURS = 10  # that lines have before they repeat


def signed(x: float) -> str:
    """Of a slope, two digits with its sign; 0 where it is less than half a percent."""
    return f"{x:+.2f}" if abs(x) >= 0.005 else "0"


def history_figure(names: Sequence[str], start: Sequence[float], run: Run) -> Figure:
    """Cost, gradient norm and gains, by those of `start`, over the iterations of every round, of its best search."""
    table = plot.shown(np.array(run.history))
    column = {name: table[:, i] for i, name in enumerate(COLUMNS)}
    figure, axes = panels(3, 1, (7.5, 7), sharex=True)
    cost, norm, gain = axes[:, 0]
    drawn = _drawn(table[:, len(COLUMNS) :], np.asarray(start, float))
    offset, low, top, others = 0, np.inf, -np.inf, "cost of the other searches"
    for turn in range(run.round + 1):
        lead = _lead(run, table, turn)
        for search in np.unique(column["start"][column["round"] == turn]):
            rows = (column["round"] == turn) & (column["start"] == search)
            iteration = offset + column["iteration"][rows]
            if search != lead:
                cost.plot(iteration, column["cost"][rows], color="0.85", lw=0.8, zorder=0, label=others)
                others = "_"  # one label for all
                continue
            said = "_" if turn else ""  # one label a line, whatever the number of rounds
            cost.plot(iteration, column["cost"][rows], color="0.6", lw=1, label=said + "cost = goal + penalty")
            cost.plot(iteration, column["goal"][rows], color="tab:blue", lw=1.3, label=said + "goal")
            if np.any(column["gradient_norm"][rows] > 0):  # generations of CMA-ES have none
                norm.semilogy(iteration, column["gradient_norm"][rows], color="tab:orange", lw=1)
            for i, k in enumerate(drawn):
                values = table[rows, len(COLUMNS) + k] / start[k]
                gain.semilogy(iteration, values, color=f"C{i}", lw=1.2, label=said + names[k])
            low = float(np.fmin(low, np.fmin.reduce(column["goal"][rows])))  # NaN where it is not finite
            top = float(np.fmax(top, column["cost"][rows][0]))
        offset += int(((column["round"] == turn) & (column["start"] == lead)).sum())
    cost.set(ylabel="weighted sum of goals")
    if np.isfinite(low):
        cost.set(ylim=(0.98 * low, 1.05 * max(top, low)))
    cost.legend(fontsize=8, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    norm.set(ylabel="gradient norm")
    gain.set(ylabel="gain / starting gain", xlabel="iteration")
    _readable(norm, gain, [names[k] for k in drawn])
    return plot.complete(figure)


def _readable(norm: Axes, gain: Axes, names: Sequence[str]) -> None:
    """Plain numbers on both, and below the gains their names in columns."""
    from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter

    if not norm.lines:
        norm.text(0.5, 0.5, "best gains: found without gradients", ha="center", transform=norm.transAxes, fontsize=9)
        norm.set(yticks=[])
    for part in (
        (norm, gain) if norm.lines else (gain,)
    ):  # plain numbers, those between powers of ten where there is room
        low, top = part.get_ylim()
        part.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if top < 100 * low else (1.0,)))
        part.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        part.yaxis.set_minor_formatter(NullFormatter())
    gain.xaxis.set_major_locator(MaxNLocator(integer=True))
    longest = max(map(len, names), default=1)
    columns = max(1, min(7, LETTERS // (longest + 6)))  # a row that were wider than the figure would narrow the panels
    gain.legend(fontsize=8, ncols=columns, loc="upper center", bbox_to_anchor=(0.5, -0.2))


def _drawn(gains: np.ndarray, start: np.ndarray) -> list[int]:
    """The gains, as many as there are colours, that move furthest in their logarithm, in the order they are named."""
    ratios = gains / np.where(start == 0, 1.0, start)
    usable = [k for k in range(len(start)) if start[k] and np.all(ratios[:, k] > 0)]
    return sorted(sorted(usable, key=lambda k: -float(np.abs(np.log(ratios[-1, k]))))[:COLOURS])


def _lead(run: Run, table: np.ndarray, turn: int) -> int:
    """The search that a round went on from: the one that saw the least excess and, of these, the lowest goal."""
    if turn == run.round:
        return next(i for i, search in enumerate(run.searches) if search is run.lead)
    rows = table[table[:, 0] == turn]
    rank = np.lexsort((rows[:, COLUMNS.index("goal")], np.maximum(rows[:, COLUMNS.index("excess")] - FEASIBLE, 0)))
    return int(rows[rank[0], 1])


def sensitivity_figure(findings: Findings) -> Figure:
    """By how much each gain moves each requirement."""
    names, rows = findings.names, findings.standings
    table = plot.shown(np.array([s.slopes for s in rows]))
    figure = plot.sheet((1.6 + 0.75 * len(names), 1.2 + 0.42 * len(rows)))
    axes = figure.add_subplot()
    top = max(np.abs(np.nan_to_num(table)).max(), 1e-6)
    axes.imshow(table, cmap="RdBu_r", vmin=-top, vmax=top, aspect="auto")
    for (i, k), value in np.ndenumerate(table):
        color = "w" if abs(value) > 0.6 * top else "k"
        axes.text(k, i, signed(value), ha="center", va="center", fontsize=8, color=color)
    turned = {"rotation": 30, "ha": "right"} if max(map(len, names)) > 8 else {}
    axes.set_xticks(range(len(names)), names, fontsize=9, **turned)
    axes.set_yticks(range(len(rows)), [_label(s) for s in rows], fontsize=9)
    figure.suptitle("relative change of a requirement\nper relative change of a gain", fontsize=9)
    return figure


def _label(standing: Standing) -> str:
    return standing.requirement.name + (" (active limit)" if standing.active else " (limit)" if standing.limit else "")


def tracking_figure(
    before: agvjax.Trajectory,
    after: agvjax.Trajectory,
    title: str,
    points: np.ndarray | None = None,
    unit: str = "m/s^2",
    way: agvjax.Path | None = None,
) -> Figure:
    """Path, size of the errors and of the commands, before and after; `points` and `way` as of `plot.path`.

    `unit` is that of a command: of a vehicle that is sent a speed, its speed is drawn.
    """
    runs = {"starting gains": before, "tuned": after}
    figure = plot.sheet((10, 5.6))
    figure.suptitle(title, fontsize=10)
    twist, heading = unit == "m/s", np.shape(before.command)[-1] == 3
    names = ["position", *(["heading"] if heading else []), "command", *(["turn"] if twist else [])]
    parts = figure.subplot_mosaic([["path", name] for name in names], width_ratios=[1, 1.4])
    plot.draw_path(parts["path"], runs, points, way)
    if (legend := parts["path"].get_legend()) is not None:
        legend.remove()
    figure.legend(*parts["path"].get_legend_handles_labels(), fontsize=9, ncols=5, loc="outside lower center")
    for run, style in zip(runs.values(), plot.STYLES, strict=False):
        _courses(parts, run, style)
    if after.route is None:
        parts["position"].set(ylabel="position [m]", ylim=(1e-4, None))
    else:
        parts["position"].set(ylabel="to the left [mm]")
    parts["command"].set(ylabel="speed asked [m/s]" if twist else "asked [m/s$^2$]")
    parts[names[-1]].set(xlabel="time [s]")
    for name in names:
        parts[name].grid(alpha=0.3)
        parts[name].yaxis.label.set_fontsize(9)
        parts[name].tick_params(labelbottom=name == names[-1])
    return plot.complete(figure)


def _courses(parts: Mapping[str, Axes], run: agvjax.Trajectory, style: Mapping[str, Any]) -> None:
    """Errors and commands of a run over time."""
    t, error, command = np.asarray(run.t), plot.shown(agvjax.tracking_error(run)), plot.shown(run.command)
    if run.route is None:
        parts["position"].semilogy(t, np.hypot(error[:, 0], error[:, 1]), **style)
    else:
        parts["position"].plot(t, 1e3 * plot.shown(run.route.cross_track), **style)
    if "turn" in parts:
        parts["command"].plot(t, command[:, 0], **style)
        parts["turn"].plot(t, command[:, 1], **style)
        parts["turn"].set(ylabel="yaw rate asked [rad/s]")
    else:
        parts["command"].semilogy(t, np.hypot(command[:, 0], command[:, 1]), **style)
    if "heading" in parts:
        parts["heading"].plot(t, error[:, 2], **style)
        parts["heading"].set(ylabel="heading [rad]")
