"""Where failures lie, without gradients: subset simulation (Au and Beck, Probabilistic Engineering Mechanics 16, 2001).

From level to level the worst eighth go on, each as a chain that walks where the level is kept (conditional sampling,
Papaioannou et al., Probabilistic Engineering Mechanics 41, 2015). The product of the shares estimates the probability.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...ensemble.draws import uniform
from .mixture import normal
from .problem import Problem

KEPT = 8  # one in so many goes on
MOST_LEVELS = 12  # 8^-12 is 1e-11
ACCEPTED = 0.44  # share of the steps of a chain that should be (Papaioannou et al.)
FIRST_STEP, SMALLEST, LARGEST = 0.6, 0.05, 1.0  # of chains, as a share of a new draw


class Pilot(NamedTuple):
    """What subset simulation saw."""

    plain: np.ndarray  # (n, D), draws of the ensemble
    plain_levels: np.ndarray  # (n,)
    failing: np.ndarray  # (m, D), about as the ensemble's failures are spread
    probability: float  # about; 0: no failure was met


def pilot(problem: Problem, population: int, seed: int) -> Pilot:
    """Walk towards the failures with so many vehicles at every level.

    Args:
        problem: what fails.
        population: a multiple of `KEPT`.
        seed: of the random numbers.
    """
    draws = _Draws(seed, problem.size)
    plain = draws.take(population)
    plain_levels = problem.levels(plain)
    u, levels, probability, step = plain, plain_levels, 1.0, FIRST_STEP
    for _ in range(MOST_LEVELS):
        kept = population // KEPT
        failing = levels > 0
        bar = float(np.sort(levels)[-kept])
        if failing.sum() >= kept:
            break
        if not np.isfinite(bar) or bar >= levels.max():  # nothing lies higher: there is no way up
            break
        above = np.flatnonzero(levels >= bar)  # more than are kept where levels are equal: then some of all
        begin = above[np.linspace(0, len(above) - 1, kept).round().astype(int)]
        probability *= len(above) / len(levels)
        u, levels, step = _walk(problem, u[begin], levels[begin], bar, step, draws)
    failing = levels > 0
    return Pilot(plain, plain_levels, u[failing], probability * float(failing.mean()))


class _Draws:
    """Standard normal numbers, one after the other."""

    def __init__(self, seed: int, size: int):
        self.seed, self.size, self.taken = seed, size, 0

    def take(self, count: int) -> np.ndarray:
        """The next (count, D)."""
        shares = uniform(self.seed, "pilot#rare", count, self.size, self.taken)
        self.taken += count
        return normal(shares)


def _walk(
    problem: Problem, u: np.ndarray, levels: np.ndarray, bar: float, step: float, draws: _Draws
) -> tuple[np.ndarray, np.ndarray, float]:
    """Chains that keep above the bar, all their places and levels, and the step that suits them."""
    every, heights = [u], [levels]
    for number in range(1, KEPT):
        tried = np.sqrt(1 - step**2) * u + step * draws.take(len(u))
        found = problem.levels(tried)
        better = found >= bar
        u, levels = np.where(better[:, None], tried, u), np.where(better, found, levels)
        every.append(u)
        heights.append(levels)
        step = float(np.clip(step * np.exp((better.mean() - ACCEPTED) / np.sqrt(number)), SMALLEST, LARGEST))
    return np.concatenate(every), np.concatenate(heights), step
