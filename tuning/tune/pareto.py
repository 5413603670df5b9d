"""What more command buys: the problem tuned again and again, with one limit moved, each from its neighbour's gains."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..io.kept import Kept
from ..io.panels import panels
from .methods.objective import FEASIBLE, within
from .problem import TuningProblem
from .tuner import Tuner

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Point(NamedTuple):
    """One point of the front."""

    factor: float  # of the limit that is moved, times the starting gains'
    goal: float  # on the tuning scenarios, relative to the starting gains
    met: bool
    dominated: bool  # another point is no worse in both
    controller: Any
    gains: list[float]
    looks: int


class Reached(NamedTuple):
    """Where a search with a moved limit has ended."""

    excess: float  # sum of what limits are exceeded by; 0: all are met
    goal: float
    looks: int
    z: tuple[float, ...]  # coordinates of the gains


def front(
    problem: TuningProblem,
    metric: str,
    factors: list[float],
    done: Callable[[Point], None] = lambda point: None,
    kept: Kept[Reached] | None = None,
) -> list[Point]:
    """Tuned gains for every factor on the limits of a metric, outward from the factor nearest 1.

    Args:
        problem: with the limit as it is; goals are relative to the starting gains.
        metric: whose mean and worst are limited.
        factors: of the limit, times what the starting gains need, rising.
        done: called with every point.
        kept: points of the same run that it has come to before.

    Raises:
        RuntimeError: nothing can be tuned from the starting gains.
    """
    tuner = _limited(problem.tuner, metric, 1.0)
    middle = int(np.argmin(np.abs(np.log(factors))))
    made, reached = dict[int, Point](), dict[int, Reached]()
    kept = Kept[Reached](None, Reached) if kept is None else kept
    for i in [*range(middle, len(factors)), *reversed(range(middle))]:
        here, neighbour = _limited(tuner, metric, factors[i]), reached.get(i - 1 if i > middle else i + 1)
        begin = None if neighbour is None else jnp.asarray(neighbour.z)
        reached[i] = found = kept.once(f"{i}", functools.partial(_tuned, here, begin))
        if np.isinf(found.goal):
            raise RuntimeError("no gradient at the starting gains was usable: no step was taken (agvjax doctor)")
        z, met = jnp.asarray(found.z), found.excess == 0
        law, gains = here.gains.controller(z, here.controller), here.gains.values(z, here.controller)
        made[i] = Point(factors[i], found.goal, met, False, law, gains, found.looks)
        done(made[i])
    points = [made[i] for i in range(len(factors))]
    lower = np.minimum.accumulate([p.goal if p.met else np.inf for p in points])
    worse = [bool(p.met and p.goal > low * (1 + FEASIBLE)) for p, low in zip(points, lower, strict=True)]
    return [p._replace(dominated=d) for p, d in zip(points, worse, strict=True)]


def _tuned(tuner: Tuner, begin: Array | None) -> Reached:
    progress = tuner.begin(begin)
    while not tuner.finished(progress):
        progress = tuner.advance(progress)
    (excess, goal), z = progress.best, np.asarray(progress.best_z)
    return Reached(float(excess), float(goal), progress.iteration, tuple(z.tolist()))


def _limited(tuner: Tuner, metric: str, factor: float) -> Tuner:
    """The problem with mean and worst of a metric limited to so many times the starting gains'; compiled parts kept."""
    moved = {r.statistic: r for r in within({metric: factor})}
    limits = [moved.pop(r.statistic, r) if r.metric == metric and not r.least else r for r in tuner.objective.limits]
    objective = tuner.objective._replace(limits=(*limits, *moved.values()))
    kept = tuner.pushed if objective.names == tuner.objective.names else None
    return dataclasses.replace(tuner, objective=objective, compiled=kept)


def figure(points: list[Point], uses: np.ndarray, errors: np.ndarray, metric: str, goal: str) -> Figure:
    """The front on scenarios not tuned on: `uses` and `errors` (P + 1, 2) are mean and worst, the last the start's."""
    drawn, (places,) = panels(1, 2, (9, 3.8))
    for column, (axes, name) in enumerate(zip(places, ("mean", "largest"), strict=True)):
        good = [i for i, p in enumerate(points) if p.met]
        axes.plot(uses[good, column], errors[good, column], "o-", ms=4, lw=1, color="tab:blue", label="tuned")
        bad = [i for i, p in enumerate(points) if not p.met]
        if bad:
            axes.plot(uses[bad, column], errors[bad, column], "x", color="0.5", label="limits not met")
        axes.plot(*uses[-1:, column], *errors[-1:, column], "s", color="tab:orange", label="starting gains")
        last, room = -np.inf, 0.06 * np.ptp(uses[:, column])
        for i in good:
            if uses[i, column] - last > room:  # labels that would lie upon each other are left out
                last, place = uses[i, column], (uses[i, column], errors[i, column])
                axes.annotate(f"{points[i].factor:.3g}", place, fontsize=7, xytext=(4, 3), textcoords="offset points")
        axes.set(xlabel=f"{name} {metric}", ylabel=f"{name} {goal}")
    handles = drawn.axes[0].get_legend_handles_labels()
    drawn.legend(*handles, fontsize=8, ncols=3, loc="outside lower center")  # beside the points, which may lie anywhere
    drawn.suptitle("on validation scenarios; numbers: the limit, times the starting gains'", fontsize=9)
    return drawn
