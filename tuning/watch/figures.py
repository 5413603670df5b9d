"""The picture of a log that is held against what gains were tuned for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..io.panels import panels
from .run import Watched

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN = 8  # numbers, those that explain most


def distance(found: Watched, limit: float) -> Figure:
    """How far the log is from the model, among logs of vehicles that the gains were tuned for; and which number."""
    figure, ((left, right),) = panels(1, 2, (10, 4.2), width_ratios=(3, 2))
    values = np.append(found.others, found.distance)
    low, high = max(values.min(), 1e-6 * values.max(), 1e-12), max(values.max(), 1e-9)
    bins = np.geomspace(low / 1.2, high * 1.2, 40)
    left.hist(np.maximum(found.others, low), bins=bins, color="0.7", label="logs simulated of vehicles tuned for")
    left.axvline(limit, color="C1", ls="--", label="alarm beyond")
    left.axvline(max(found.distance, low), color="C3", lw=2, label="this log")
    left.set(xscale="log", xlabel="distance of log and model", ylabel="logs")
    left.legend(fontsize="small")
    first = sorted(found.numbers, key=lambda one: -one.explains)[:SHOWN][::-1]
    right.barh([one.name for one in first], [100 * one.explains for one in first], color="C0")
    right.set(xlabel="of the distance, alone [%]", xlim=(0, 100))
    right.tick_params(axis="y", labelsize="small")
    return figure
