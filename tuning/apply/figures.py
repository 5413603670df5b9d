"""The picture of a decision."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agvjax.metric_units import units_in

from ..config.settings import Config
from ..io.panels import panels
from .compare import Compared

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def vehicles(config: Config, found: Compared) -> Figure:
    """Of every run what the first goal is with the current gains and with the new ones; of every vehicle the cost."""
    figure, ((left, right),) = panels(1, 2, (10, 4.6))
    goal = found.objective.goals[0].metric
    unit = units_in(config.scenario)[goal]
    before, after = (np.asarray(metrics[goal], float) for metrics in found.metrics)
    ok = np.asarray(found.metrics[0].ok) & np.asarray(found.metrics[1].ok)
    _pairs(left, before[ok], after[ok], f"{goal} [{unit}]")
    fine = np.isfinite(found.costs).all(axis=0)
    _pairs(right, found.costs[0, fine], found.costs[1, fine], "goal of a vehicle, 1 = current mean")
    there = found.worst[:, np.isfinite(found.worst).all(axis=0)]
    if there.size:
        right.plot(*there, "x", color="C3", ms=8, mew=2, label="worst found")
    right.legend(fontsize="small")
    return figure


def _pairs(axis: Axes, before: np.ndarray, after: np.ndarray, name: str) -> None:
    """Points, and the line on which nothing changes."""
    ends = np.array([min(before.min(), after.min()), max(before.max(), after.max())]) if before.size else [0, 1]
    axis.plot(ends, ends, color="0.4", lw=1, ls="--", label="no change; below it the new gains are better")
    axis.plot(before, after, ".", ms=4, alpha=0.6, color="C0", label="of vehicles the log leaves possible")
    axis.set(xlabel=f"{name}, current gains", ylabel="new gains")
