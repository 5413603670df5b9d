"""What a finite number of runs says of a probability: bounds that hold at any sample size, without a normal curve.

Clopper and Pearson (1934) for counts; for weighted runs the betting martingale of Waudby-Smith and Ramdas, Estimating
means of bounded random variables by betting (J. R. Stat. Soc. B 86, 2024).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ...io.statements import CONFIDENCE

LARGEST_BET = 0.75  # of what would be ruin at the worst outcome
PRIOR_COUNT = 1000  # runs that the variance of a pilot counts as, at most
HALVINGS = 80


def _wagers(values: np.ndarray, variance: float, count: int, confidence: float) -> np.ndarray:
    """How much is bet on each value (n,), chosen before it is seen: the pilot's variance and the values before it."""
    prior = min(count, PRIOR_COUNT)
    number = np.arange(len(values))
    before = np.concatenate([[0.0], np.cumsum(values)[:-1]])
    square = np.concatenate([[0.0], np.cumsum(values**2)[:-1]])
    spread = np.maximum(square - before**2 / np.maximum(number, 1), 0.0)
    seen = (prior * variance + spread) / (prior + number)
    with np.errstate(divide="ignore"):
        return np.sqrt(2 * math.log(1 / (1 - confidence)) / (len(values) * seen))


def mean_at_most(
    values: np.ndarray, largest: float, variance: float, count: int, confidence: float = CONFIDENCE
) -> float:
    """An upper bound on the mean of independent values in [0, largest], of which `values` (n,) were seen.

    Whoever bets against a mean m with the stakes of `_wagers` multiplies the money by 20 with a probability of at most
    5 % if m is the mean: what is not refused so holds with 95 %, for any n and any distribution.

    Args:
        values: n independent values.
        largest: that they cannot exceed.
        variance: about what it is; a wrong one loosens the bound and does not break it. From other values than these.
        count: of the values that it was estimated from.
        confidence: that the bound holds.
    """
    stakes = np.minimum(_wagers(values, variance, count, confidence), LARGEST_BET / largest)

    def refused(mean: float) -> bool:
        money = np.cumsum(np.log1p(stakes * (mean - values)))
        return bool(money.max() >= -math.log(1 - confidence))

    return largest if not refused(largest) else _edge(float(values.mean()), largest, refused)[1]


def mean_at_least(
    values: np.ndarray, largest: float, variance: float, count: int, confidence: float = CONFIDENCE
) -> float:
    """A lower bound on the mean; see `mean_at_most`."""
    wagers = _wagers(values, variance, count, confidence)

    def kept(mean: float) -> bool:
        money = np.cumsum(np.log1p(np.minimum(wagers, LARGEST_BET / mean) * (values - mean)))
        return bool(money.max() < -math.log(1 - confidence))

    average = float(values.mean())
    return _edge(0.0, average, kept)[0] if average > 0 else 0.0


def _edge(low: float, high: float, beyond: Callable[[float], bool]) -> tuple[float, float]:
    """Either side of where `beyond`, false at `low` and true at `high`, becomes true."""
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if beyond(middle) else (middle, high)
    return low, high


def share_at_most(count: int, size: int, confidence: float = CONFIDENCE) -> float:
    """An exact upper bound on the probability of an event seen `count` times in `size` independent tries."""
    from scipy.stats import beta  # late: half a second that few runs need

    return 1.0 if count == size else float(beta.ppf(confidence, count + 1, size - count))


def share_at_least(count: int, size: int, confidence: float = CONFIDENCE) -> float:
    """An exact lower bound; see `share_at_most`."""
    from scipy.stats import beta

    return 0.0 if count == 0 else float(beta.ppf(1 - confidence, count, size - count + 1))


def effective(weights: np.ndarray) -> float:
    """Effective sample size of weighted runs (Kish): so many runs of equal weight say as much."""
    total = float(weights.sum())
    return total**2 / float((weights**2).sum()) if total > 0 else 0.0
