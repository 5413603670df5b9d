"""Before anything is estimated: where failures lie, what to draw from, and the region that a bound can speak of."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from . import nearest
from .mixture import PLAIN, Mixture
from .pilot import KEPT, Pilot, pilot
from .problem import Problem

POPULATION, ROUND = 50, 25  # one in so many of all rollouts are a level of the pilot, and a round of trial draws
LEAST = 256  # of either
SEARCHED = (
    10  # one in so many of all rollouts may go into the searches by gradients, and again into those for more points
)
STARTS = 8  # of searches from failures, and as many from the worst of plain draws
ROUNDS = 5  # of trial draws at most
MOST_POINTS = 16
MORE = 3  # points added in a round
HEAVY = 0.02  # of the trial's estimate: a failure that alone makes so much of it becomes a point
AFFORDED = 0.02  # how far one draw at the edge of the region moves the estimate: the further, the larger the region
SPARE = 2.0  # the region reaches at least to so many times the largest weight of a trial failure


class Prepared(NamedTuple):
    """All that is fixed before the draws of the estimate."""

    mixture: Mixture
    cut: float  # largest weight in the region
    probability: float  # of the last trial round
    variance: float  # of a weighted failure there
    tried: int  # draws of that round
    pilot: float  # probability by subset simulation; 0: it met no failure
    covered: float  # share of the pilot's failures that lie in the region; NaN: it met none
    draws: int  # left for the estimate
    spent: int  # rollouts so far

    @property
    def everywhere(self) -> bool:
        """Whether the region is all there is, so that a bound needs no assumption on where failures lie."""
        return self.cut >= 1 / PLAIN


class _Trial(NamedTuple):
    mixture: Mixture
    failing: np.ndarray  # (m, D)
    weights: np.ndarray  # (m,)
    size: int


def prepare(problem: Problem, budget: int, seed: int) -> Prepared:
    """Search, try, and fix what is drawn from, with so many rollouts in all.

    Args:
        problem: what fails.
        budget: rollouts, those of the estimate among them.
        seed: of the random numbers.
    """
    population = max(LEAST, budget // POPULATION // KEPT * KEPT)
    found = pilot(problem, population, seed)
    points = _points(problem, found, budget // SEARCHED)
    trial = _tried(problem, Mixture.about(points), 0, max(LEAST, budget // ROUND), seed)
    for number in range(1, ROUNDS):
        more = _missing(problem, trial, found.failing, budget // SEARCHED // ROUNDS)
        if not len(more):
            break
        mixture = Mixture.about(np.concatenate([trial.mixture.points, more]))
        trial = _tried(problem, mixture, number, trial.size, seed)
    mixture = trial.mixture
    if len(trial.weights):
        mixture = mixture.learned(trial.failing, trial.weights)
    weights = mixture.weights(trial.failing)
    mean = float(trial.weights.sum()) / trial.size
    variance = float((trial.weights**2).sum()) / trial.size - mean**2
    draws = max(budget - problem.rollouts, LEAST)
    largest = float(weights.max()) if len(weights) else 0.0
    cut = min(1 / PLAIN, max(SPARE * largest, AFFORDED * mean * draws)) if mean else 1 / PLAIN
    covered = float((mixture.weights(found.failing) <= cut).mean()) if len(found.failing) else np.nan
    spent = problem.rollouts
    return Prepared(mixture, cut, mean, variance, trial.size, found.probability, covered, draws, spent)


def _points(problem: Problem, found: Pilot, rollouts: int) -> np.ndarray:
    """The most likely failures that gradients and pilot find, (K, D); none: the middle stands for them."""
    middle = np.zeros((1, problem.size))
    safe = np.where(found.plain_levels > 0, -np.inf, found.plain_levels)
    begin = [middle, nearest.starts(found.plain, safe, STARTS)]
    if len(found.failing):
        begin.insert(1, nearest.starts(found.failing, np.ones(len(found.failing)), STARTS))
    points = nearest.search(problem, np.concatenate(begin), rollouts)
    points = nearest.distinct(points, MOST_POINTS)
    return points if len(points) else middle


def _tried(problem: Problem, mixture: Mixture, number: int, size: int, seed: int) -> _Trial:
    u, _ = mixture.draw(seed, f"trial{number}", 0, size)
    failing = u[problem.levels(u) > 0]
    return _Trial(mixture, failing, mixture.weights(failing), size)


def _missing(problem: Problem, trial: _Trial, seen: np.ndarray, rollouts: int) -> np.ndarray:
    """Points to add, (k, D): failures that are drawn so rarely that one of them makes a large part of an estimate."""
    total = trial.weights.sum()
    heavy = np.argsort(-trial.weights, kind="stable")[:MORE] if total > 0 else np.array([], int)
    heavy = heavy[trial.weights[heavy] > HEAVY * total]
    # the pilot's failures are spread as the ensemble's: one that the mixture hardly draws stands for many
    scarce = trial.mixture.weights(seen)
    bar = max(SPARE * trial.weights.max() if total > 0 else 0.0, AFFORDED * total)
    apart = np.argsort(-scarce, kind="stable")[:1]
    apart = apart[scarce[apart] > bar]
    candidates = np.concatenate([trial.failing[heavy], seen[apart]])
    if not len(candidates):
        return candidates
    points = nearest.search(problem, candidates, rollouts)
    known = trial.mixture.points
    return nearest.distinct(points, MOST_POINTS, known)[len(known) :]
