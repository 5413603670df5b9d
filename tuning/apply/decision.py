"""Accept or refuse, and why: from numbers alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..config.settings import Apply

SMALL = 1e-9  # of a cost: rounding
SLIGHT = 1e-3  # of a cost: nobody would notice


class Limited(NamedTuple):
    """A limit: each level is 1 at its bound and more beyond it."""

    name: str
    before: float  # with the current gains
    after: float

    def kept(self, slack: float) -> bool:
        """Whether new gains hold it, but for a `slack`; where the current ones exceed it by more, as far as these.

        The slack is of the bound, so that it does not add up over many changes.
        """
        return bool(self.after <= max(1 + slack, self.before * (1 + SMALL)))


class Decision(NamedTuple):
    """Whether new gains may go onto the robot."""

    accepted: bool
    reasons: tuple[str, ...]  # against it, a sentence each; none where it is accepted
    worse: int  # vehicles on which they are
    vehicles: int
    least: float  # share of all possible vehicles on which they are not, at least, with the confidence asked for


def provable(share: float, confidence: float) -> int:
    """How many draws, none of them worse, show that at least a share of all is not worse.

    n draws none of which is worse have a chance of at most share^n where fewer than that share are not worse.
    """
    return int(np.ceil(np.log1p(-confidence) / np.log(share) - 1e-9))


def least_share(good: int, count: int, confidence: float) -> float:
    """The share that is good at least, where `good` of `count` independent draws are: one-sided, exact.

    Source: Clopper and Pearson, The use of confidence or fiducial limits illustrated in the case of the binomial,
    Biometrika 26 (1934).
    """
    from scipy.stats import beta  # late: half a second that few commands need

    return float(beta.ppf(1 - confidence, good, count - good + 1)) if good else 0.0


def worse(before: np.ndarray, after: np.ndarray, margin: float) -> np.ndarray:
    """Where the cost after is higher by more than a margin; infinite ones are of runs that diverge.

    A vehicle that diverges with both sets of gains counts: nothing shows that it is not worse.
    """
    risen = np.asarray(after) > (1 + margin) * np.asarray(before) * (1 + SMALL)
    return risen | ~np.isfinite(np.asarray(after))


def _slight(costs: np.ndarray) -> str:
    """What to do where vehicles are worse, but none by as much as anybody would notice; empty of others."""
    before, after = costs
    most = float(np.max(after / before - 1, initial=0.0)) if np.isfinite(costs).all() and (before > 0).all() else np.inf
    if not 0 < most < SLIGHT:
        return ""
    return f"; by {100 * most:.2g} % at most, which with apply.margin = {SLIGHT} would not count"


def decide(costs: np.ndarray, worst: np.ndarray, limits: Sequence[Limited], asked: Apply) -> Decision:
    """The decision.

    Args:
        costs: (2, n), of n vehicles with the current and with the new gains; infinite where a run diverges.
        worst: (2, k), the same of the worst vehicles that were found.
        limits: of the configuration.
        asked: settings.
    """
    count = costs.shape[1]
    bad = int(worse(costs[0], costs[1], asked.margin).sum())
    least = least_share(count - bad, count, asked.confidence)
    by = f" by more than {asked.margin:.1%}" if asked.margin else ""
    reasons = []
    if least < asked.share:
        reasons.append(
            f"on {bad} of {count} vehicles that the log leaves possible the new gains are worse{by}: that they are not"
            f" on {asked.share:.0%} of all is not shown ({least:.1%} at least, with {asked.confidence:.0%} confidence)"
            f"{_slight(costs)}"
        )
    lost = int((~np.isfinite(costs[1])).sum())
    if lost:
        reasons.append(f"{lost} of {count} vehicles diverge with the new gains")
    for before, after in worst.T[worse(worst[0], worst[1], asked.margin)]:
        how = f"{100 * (after / before - 1):.2g} % worse{by}" if np.isfinite(after) else "diverging"
        reasons.append(f"on a worst vehicle that was found the new gains are {how}")
        break
    reasons += [
        f"{one.name} would be at {one.after:.3f} of its limit (now {one.before:.3f})"
        for one in limits
        if not one.kept(asked.slack)
    ]
    return Decision(not reasons, tuple(reasons), bad, count, least)
