"""Rare failures, drawn: which numbers matter, and where vehicles fail."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from agvjax.draw import plot

from ...io.pictures import Drawing
from .study import Outcome, Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BARS, POINTS = 12, 3  # numbers shown, and failures beside each other
LEAST = 0.005  # share of a number that is shown
DOTS = 4000  # draws shown of either kind


def every(asked: Study, outcome: Outcome) -> dict[str, Drawing]:
    """All figures, by name, not yet drawn; none where nothing failed."""
    if not outcome.points:
        return {}
    figures: dict[str, Drawing] = {"importance": partial(importance, asked, outcome)}
    if asked.problem.size > 1:
        figures["failures"] = partial(failures, asked, outcome)
    return figures


def importance(asked: Study, outcome: Outcome) -> Figure:
    """Squared direction cosines of the most likely failures: what share of the way each number goes."""
    points = outcome.points[:POINTS]
    shares = np.array([point.importance for point in points])  # (P, D)
    order = np.argsort(-shares.max(axis=0), kind="stable")[:BARS]
    order = order[shares.max(axis=0)[order] >= LEAST]
    names = [asked.plan.sampled[i].name.replace("+", "\nwith ") for i in order]
    figure = plot.sheet((8.0, 1.4 + 0.2 * len(order) * (1 + len(points)) / 2))
    axes = figure.subplots()
    height = 0.8 / len(points)
    for number, (point, row) in enumerate(zip(points, shares, strict=True)):
        label = f"{number}: {point.distance:.2f} standard deviations out"
        axes.barh(np.arange(len(order)) + (number - (len(points) - 1) / 2) * height, row[order], height, label=label)
    axes.set_yticks(np.arange(len(order)), names)
    axes.invert_yaxis()
    axes.set(xlabel="share of the squared distance to the most likely failure", xlim=(0, 1))
    axes.legend(fontsize=8)
    return figure


def failures(asked: Study, outcome: Outcome) -> Figure:
    """The draws over the two numbers that matter most: those that failed, those that did not, the most likely."""
    first, second = np.argsort(-outcome.points[0].importance, kind="stable")[:2]
    draws, figure = outcome.draws, plot.sheet((6.4, 5.4))
    axes = figure.subplots()
    for failed, colour, label in ((False, "0.7", "kept its bounds"), (True, "tab:red", "failed")):
        u = draws.u[draws.failed == failed][:DOTS]
        axes.plot(u[:, first], u[:, second], ".", ms=2, color=colour, label=f"{label} ({len(u)} shown)")
    axes.plot(0, 0, "*", ms=12, mfc="white", mec="black", label="middle of the ensemble")
    for number, point in enumerate(outcome.points[:POINTS]):
        x, y = float(point.u[first]), float(point.u[second])
        axes.plot(x, y, "o", ms=7, mfc="none", mec="black")
        axes.annotate(str(number), (x, y), xytext=(6, 6), textcoords="offset points", fontweight="bold")
    x, y = (asked.plan.sampled[i].name.replace("+", "\nwith ") for i in (first, second))
    axes.set(xlabel=f"{x}, as a normal number", ylabel=f"{y}, as a normal number")
    axes.legend(fontsize=8, markerscale=1.5)
    return figure
