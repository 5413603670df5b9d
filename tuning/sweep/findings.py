"""What a sweep shows, in numbers: failures with intervals, the worst scenarios, sensitivities of the metrics."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ..config.settings import Bound
from ..io.statements import CONFIDENCE
from .design import LEVELS, SENSITIVITY, Axis, Design, unit_problem
from .results import Results

BINS = 24  # of an axis that was sampled
QUANTILES = (0.05, 0.5, 0.95)


class Failures(NamedTuple):
    """How many runs of one controller failed, and what that says of the probability."""

    failed: int
    runs: int
    diverged: int
    share: float
    low: float  # exact binomial interval (Clopper and Pearson); what is evenly spread has a narrower one
    high: float


class Index(NamedTuple):
    """Sensitivity of one metric to one axis."""

    axis: str
    first: float  # Sobol: first order; Morris: mean absolute elementary effect, in the metric's unit per whole range
    first_error: float  # half of the 95 % interval
    total: float  # Sobol: total order; Morris: standard deviation of the effects, from curvature and interaction
    total_error: float  # NaN for Morris


def absolute(fails: Mapping[str, Bound], nominal: Mapping[str, float]) -> dict[str, float]:
    """Bounds in the metrics' units; `nominal` are the metrics of the nominal run."""
    return {name: bound.value * (1.0 if bound.absolute else nominal[name]) for name, bound in fails.items()}


def failed(results: Results, bounds: Mapping[str, float]) -> np.ndarray:
    """Which runs diverged or passed a bound, (C, N)."""
    beyond = [~(results.metrics[name] <= bound) for name, bound in bounds.items()]
    return np.any([~results.ok, *beyond], axis=0)


def failures(results: Results, which: np.ndarray) -> list[Failures]:
    """How many of every controller, and the interval in which the probability lies."""
    size, counts = which.shape[1], zip(which.sum(axis=1).tolist(), (~results.ok).sum(axis=1).tolist(), strict=True)
    return [Failures(failed, size, diverged, failed / size, *interval(failed, size)) for failed, diverged in counts]


def interval(count: int, size: int) -> tuple[float, float]:
    """The probability of an event seen `count` times in `size` independent tries, with a confidence of 95 %."""
    from scipy.stats import binomtest  # late: a second that few runs need

    ends = binomtest(count, size).proportion_ci(CONFIDENCE, method="exact")
    return float(ends.low), float(ends.high)


def worst(values: np.ndarray, count: int) -> np.ndarray:
    """Numbers of the scenarios with the largest values, the largest first; of equal ones the first."""
    return np.argsort(-values, kind="stable")[:count]


def cut(results: Results, values: np.ndarray, place: int, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where along an axis (P,), as shares of it, and quantiles there (P, 3) and largest (P,), over all else.

    Args:
        results: of the sweep.
        values: (N,).
        place: which of the grid's axes and, after these, of the sampled.
        shares: where the scenarios lie along every axis, (N, axes).
    """
    plan = results.design
    if place < len(plan.grid):
        groups, at = np.moveaxis(plan.whole(values), place, 0).reshape(plan.shape[place], -1), plan.grid[place].places
    else:
        bin_of = np.minimum((shares[:, place] * BINS).astype(int), BINS - 1)
        full = np.unique(bin_of)
        groups, at = [values[bin_of == b] for b in full], (full + 0.5) / BINS
    rows = [[*np.quantile(group, QUANTILES, method="nearest"), group.max()] for group in groups]
    return at, np.array(rows)


def sensitivity(results: Results, values: np.ndarray) -> list[Index]:
    """Sobol or Morris indices (SALib) of one metric (N,) over the sampled axes; empty where a value is not finite."""
    plan = results.design
    if plan.method not in SENSITIVITY or not np.all(np.isfinite(values)):
        return []
    return indices(plan.method, plan.sampled, plan, values)


def indices(method: str, axes: tuple[Axis, ...], plan: Design, values: np.ndarray) -> list[Index]:
    """SALib's analysis of a design that SALib made."""
    from SALib.analyze import morris, sobol  # an extra, and slow to import

    names = [axis.name for axis in axes]
    problem = unit_problem(names)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of pandas, and of a metric that does not vary: its indices are NaN
        if method == "saltelli":
            table: Any = sobol.analyze(problem, values, calc_second_order=False, conf_level=CONFIDENCE, seed=plan.seed)
            columns = (table["S1"], table["S1_conf"], table["ST"], table["ST_conf"])
        else:
            points = plan.shares(0, plan.size)
            table = morris.analyze(problem, points, values, num_levels=LEVELS, seed=plan.seed)
            columns = (table["mu_star"], table["mu_star_conf"], table["sigma"], np.full(len(names), np.nan))
    return [Index(name, *map(float, row)) for name, row in zip(names, zip(*columns, strict=True), strict=True)]
