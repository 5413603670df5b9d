"""Goals and limits on statistics of metrics, and the default ones."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection

import numpy as np

from agvjax._pytree import number
from agvjax.metric_table import AXES, METRICS

from .fields import USUAL, WEIGHT

LATE = tuple(f"rmse_late_{axis}" for axis in AXES)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Weights:
    """Weights of the statistics of a metric in the goal, each relative to its value with the starting gains.

    Attributes:
        mean: weight of the mean over the ensemble.
        worst: weight of the worst scenario of the ensemble.
        cvar: weight of the mean of the worst `tune.tail` of the ensemble.
    """

    mean: float = number(0.0, "1", WEIGHT)
    worst: float = number(0.0, "1", WEIGHT)
    cvar: float = number(0.0, "1", WEIGHT)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Limit:
    """Upper limits on the statistics of a metric, or with `least` lower ones: times the starting gains' or absolute.

    Attributes:
        mean: limit of the mean over the ensemble; infinite: none.
        worst: limit of the worst scenario of the ensemble; infinite: none.
        cvar: limit of the mean of the worst `tune.tail` of the ensemble; infinite: none.
        absolute: whether the limits are in the metric's own unit, not multiples of the starting gains' values.
        least: whether they are lower limits.
    """

    mean: float = np.inf
    worst: float = np.inf
    cvar: float = np.inf
    absolute: bool = False
    least: bool = False


WHOLE_ERROR = {"total_rmse": Weights(mean=1.0, worst=0.3)}  # the goal of the preset paper-goal


def default_goals(
    known: Collection[str] = METRICS, horizon: object = np.inf, follows: bool = False, late: float = float(USUAL.late)
) -> dict[str, Weights]:
    """The error of the whole run, which is that of its start, and of each channel what is left after the start.

    A late error weighs a fortieth: little enough that the whole error hardly suffers, enough that no late error of the
    paper's law rises (docs/tuning.md has what other weights do). Runs shorter than twice the start, which is over at
    `late` [s], have none.

    A law that `follows` a route is to lie on it: its goal is the distance to it once the start is over.
    """
    long = isinstance(horizon, (int, float)) and horizon >= 2 * late
    if follows:
        return {"cross_track_late" if long else "cross_track": Weights(mean=1.0, worst=0.3)}
    goals = dict(WHOLE_ERROR)
    if long:
        goals |= {name: Weights(mean=0.025) for name in LATE if name in known}
    return goals


def default_limits(known: Collection[str] = METRICS, follows: bool = False) -> dict[str, Limit]:
    """No more command than the starting gains ask for, on average and at worst; of the metrics that are `known`.

    A law that `follows` a route is to be no slower, and its command to vary by no more than half as much again.
    """
    if follows:
        return {"pace": Limit(mean=1.0), "total_chatter": Limit(mean=1.5, worst=1.5)}
    limited = [name for name in ("effort", "peak_position", "peak_heading") if name in known]
    return dict.fromkeys(limited, Limit(mean=1.0, worst=1.0))
