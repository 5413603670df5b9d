"""From weighted runs to what may be said: an estimate, its bounds, and why something is not said."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...io.statements import CONFIDENCE
from . import bounds
from .prepare import Prepared
from .problem import Problem

EFFECTIVE = 50.0  # effective failures of which an estimate is stated
FACTOR = 10.0  # by which pilot and estimate may differ
COVERED = 0.95  # share of the pilot's failures that the region must hold
DOUBT = 0.999  # confidence with which plain draws must contradict an estimate
# Draws decide which of two upper bounds is stated: together they fail in no more than 5 %, so the stated one does too.
OF_PLAIN = 0.99  # confidence of that by plain draws alone
OF_WEIGHTED = CONFIDENCE + (1 - OF_PLAIN)  # and of that by weighted draws


class Drawn(NamedTuple):
    """Draws of the mixture, rolled out."""

    u: np.ndarray  # (n, D)
    weights: np.ndarray  # (n,)
    failed: np.ndarray  # (n,)
    plain: np.ndarray  # (n,), which are draws of the ensemble itself


class Estimate(NamedTuple):
    """What the draws say of the probability of failure."""

    probability: float
    low: float  # at least so much, with 95 %
    high: float  # at most so much, if all failures lie in the region; with `plain_high` at once, with 95 %
    everywhere: bool  # the region is all there is
    outside: int  # failures that were met outside the region
    failures: int
    effective: float  # sample size of the failures
    runs: int
    plain_failures: int
    plain_runs: int
    plain_high: float  # at most so much, wherever failures lie: by the plain draws alone
    refused: tuple[str, ...]  # why `probability`, `low` and `high` are not to be stated

    @property
    def bound(self) -> float:
        """What may be stated: at most so much, with 95 %, whichever of the two the draws have chosen."""
        return self.plain_high if self.refused else self.high


def drawn(problem: Problem, prepared: Prepared, seed: int, first: int, count: int) -> Drawn:
    """The draws from number `first`: the same for a seed, however they are cut."""
    u, plain = prepared.mixture.draw(seed, "estimate", first, count)
    return Drawn(u, prepared.mixture.weights(u), problem.levels(u) > 0, plain)


def estimate(prepared: Prepared, draws: Drawn, tail: float) -> Estimate:
    """The estimate of all draws.

    Args:
        prepared: what they were drawn from.
        draws: all of them.
        tail: probability of what is not rolled out, counted as failing in what is bounded from above.
    """
    weights = draws.weights * draws.failed
    inside = np.where(draws.weights <= prepared.cut, weights, 0.0)
    known = (prepared.cut, prepared.variance, prepared.tried)
    plain = int(draws.plain.sum())
    plain_failures = int((draws.plain & draws.failed).sum())
    made = Estimate(
        probability=float(weights.mean()),
        low=bounds.mean_at_least(inside, *known),
        high=min(1.0, bounds.mean_at_most(inside, *known, OF_WEIGHTED) + tail),
        everywhere=prepared.everywhere,
        outside=int((draws.failed & (draws.weights > prepared.cut)).sum()),
        failures=int(draws.failed.sum()),
        effective=bounds.effective(weights),
        runs=len(weights),
        plain_failures=plain_failures,
        plain_runs=plain,
        plain_high=min(1.0, bounds.share_at_most(plain_failures, plain, OF_PLAIN) + tail),
        refused=(),
    )
    return made._replace(refused=tuple(_refusals(prepared, made)))


def _refusals(prepared: Prepared, made: Estimate) -> list[str]:
    """Why no estimate is stated."""
    if not made.failures:
        return ["no failure was found, by the searches, the pilot or the draws"]
    said = []
    if made.effective < EFFECTIVE:
        said.append(f"the effective sample size is {made.effective:.0f}, less than {EFFECTIVE:.0f}")
    if made.outside:
        said.append(f"{made.outside} draws failed outside the region that the searches had explored")
    if prepared.pilot and not 1 / FACTOR <= made.probability / prepared.pilot <= FACTOR:
        said.append(
            f"subset simulation estimates {prepared.pilot:.2g}, the weighted draws {made.probability:.2g}: more than"
            f" {FACTOR:.0f} times apart"
        )
    if prepared.covered < COVERED:
        said.append(f"only {prepared.covered:.0%} of the failures of subset simulation lie in the explored region")
    low = bounds.share_at_least(made.plain_failures, made.plain_runs, DOUBT)
    high = bounds.share_at_most(made.plain_failures, made.plain_runs, DOUBT)
    if low > made.high or high < made.low:
        said.append(f"plain draws contradict it: {made.plain_failures} of {made.plain_runs} failed")
    return said
