"""Figures of a tuning run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter

import agvjax
from agvjax.draw import plot

from ..io.panels import panels
from .analysis import Findings, Standing
from .rounds import COLUMNS, Run


def signed(x: float) -> str:
    """Of a slope, two digits with its sign; 0 where it is less than half a percent."""
    return f"{x:+.2f}" if abs(x) >= 0.005 else "0"


def history_figure(names: Sequence[str], run: Run) -> Figure:
    """Cost, gradient norm and gains over the iterations of every round, of the best start."""
    table = np.array(run.history)
    figure, axes = panels(3, 1, (7.5, 7), sharex=True)
    cost, norm, gain = axes[:, 0]
    lead = next(i for i, search in enumerate(run.searches) if search is run.lead)
    others = sorted({(row[0], row[1]) for row in table})
    offset = 0
    for turn, start in others:
        part = table[(table[:, 0] == turn) & (table[:, 1] == start)]
        best = start == (lead if turn == run.round else 0)
        iteration = offset + part[:, COLUMNS.index("iteration")]
        if not best:
            cost.plot(iteration, part[:, COLUMNS.index("cost")], color="0.85", lw=0.8, zorder=0)
            continue
        said = "_" if turn else ""  # one label a line, whatever the number of rounds
        cost.plot(iteration, part[:, COLUMNS.index("cost")], color="0.6", lw=1, label=said + "cost = goal + penalty")
        cost.plot(iteration, part[:, COLUMNS.index("goal")], color="tab:blue", lw=1.3, label=said + "goal")
        norm.semilogy(iteration, part[:, COLUMNS.index("gradient_norm")], color="tab:orange", lw=1)
        values = part[:, len(COLUMNS) :]
        for k, name in enumerate(names):
            gain.semilogy(
                iteration, values[:, k] / table[0, len(COLUMNS) + k], color=f"C{k}", lw=1.2, label=said + name
            )
        if turn < run.round:
            offset += len(part)
    low = np.nanmin(table[:, COLUMNS.index("goal")])
    top = max(table[0, COLUMNS.index("cost")], low)
    cost.set(ylabel="sum of weighed goals", ylim=(0.98 * low, 1.05 * top))
    cost.legend(fontsize=8)
    norm.set(ylabel="gradient norm")
    for side in (norm.yaxis.set_major_formatter, norm.yaxis.set_minor_formatter):
        side(StrMethodFormatter("{x:g}"))
    gain.set(ylabel="gain / start", xlabel="iteration")
    gain.legend(fontsize=8, ncols=len(names), loc="upper center", bbox_to_anchor=(0.5, -0.2))
    return figure


def sensitivity_figure(findings: Findings) -> Figure:
    """By how much each gain moves each requirement."""
    names, rows = findings.names, findings.standings
    table = np.array([s.slopes for s in rows])
    figure = Figure(figsize=(1.6 + 0.75 * len(names), 1.2 + 0.42 * len(rows)), layout="constrained")
    axes = figure.add_subplot()
    top = max(np.abs(table).max(), 1e-6)
    axes.imshow(table, cmap="RdBu_r", vmin=-top, vmax=top, aspect="auto")
    for (i, k), value in np.ndenumerate(table):
        color = "w" if abs(value) > 0.6 * top else "k"
        axes.text(k, i, signed(value), ha="center", va="center", fontsize=8, color=color)
    axes.set_xticks(range(len(names)), names, fontsize=9)
    axes.set_yticks(range(len(rows)), [_label(s) for s in rows], fontsize=9)
    axes.set_title("relative change of a requirement per relative change of a gain", fontsize=9)
    return figure


def _label(standing: Standing) -> str:
    return standing.requirement.name + (" (active limit)" if standing.active else " (limit)" if standing.limit else "")


def tracking_figure(before: agvjax.Trajectory, after: agvjax.Trajectory, title: str) -> Figure:
    """Path, size of the error and of the commands, before and after."""
    runs = {"starting gains": before, "tuned": after}
    figure = Figure(figsize=(10, 4.6), layout="constrained")
    figure.suptitle(title, fontsize=10)
    heading = np.shape(before.command)[-1] == 3
    rows: list[Any] = [["path", "position"], ["path", "heading"]] if heading else [["path", "position"]]
    parts = figure.subplot_mosaic(rows, width_ratios=[1, 1.4])
    plot.draw_path(parts["path"], runs)
    for (label, run), style in zip(runs.items(), plot.STYLES, strict=False):
        error = np.asarray(agvjax.tracking_error(run))
        parts["position"].semilogy(np.asarray(run.t), np.hypot(error[:, 0], error[:, 1]), label=label, **style)
        if heading:
            parts["heading"].plot(np.asarray(run.t), error[:, 2], label=label, **style)
            parts["heading"].set(ylabel=plot.ERRORS[2])
        parts[rows[-1][1]].set(xlabel="time [s]")
    parts["position"].set(ylabel="position error [m]", ylim=(1e-4, None))
    for _, name in rows:
        parts[name].grid(alpha=0.3)
    return figure
