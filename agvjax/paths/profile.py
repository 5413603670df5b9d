"""The speed over a route: what it was given, reduced to what acceleration and curvature allow."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from .._pytree import POSITIVE, number, pytree

if TYPE_CHECKING:
    from scipy import sparse

MOST = 2048  # knots at which jerk is limited; longer profiles are linear in squared speed between so many
ROUNDS, NEAR = 30, 0.01  # of linear programmes; within what of each other they end, in jerk and squared speed
SLOW = 1e-3  # of the largest squared speed: slower than that, time weighs no more


@pytree
class SpeedLimits:
    """What the speed of a route is reduced to; infinite: no limit.

    By a forward and a backward pass over squared speed, after Kapania, Subosits and Gerdes (2016).
    """

    speed: float = number(np.inf, "m/s", POSITIVE)
    acceleration: float = number(np.inf, "m/s^2", POSITIVE, "speeding up")
    deceleration: float = number(np.inf, "m/s^2", POSITIVE, "slowing down")
    lateral_acceleration: float = number(np.inf, "m/s^2", POSITIVE, "speed^2 times curvature")
    jerk: float = number(np.inf, "m/s^3", POSITIVE, "change of the acceleration along the route, also where it stands")
    stop: bool = dataclasses.field(default=True, metadata={"static": True})  # at the end of an open route

    def faster(self, factor: float) -> SpeedLimits:
        """Those of a route driven so many times as fast: in a turn that takes the square of it sideways."""
        sideways = factor**2 * self.lateral_acceleration
        return dataclasses.replace(self, speed=factor * self.speed, lateral_acceleration=sideways)


def squares(given: np.ndarray, curvature: np.ndarray, h: float, limits: SpeedLimits, ends: tuple[bool, bool]):
    """Squared speeds (N,) [m^2/s^2] at knots `h` [m] apart, of given speeds (N,) [m/s] and curvatures (N,) [1/m].

    `ends` says whether the vehicle stands at the first and at the last knot.
    """
    top = _top(given, curvature, h, limits, ends)
    return top if np.isinf(limits.jerk) else _smooth(top, h, limits, ends)


def around(given: np.ndarray, curvature: np.ndarray, h: float, limits: SpeedLimits) -> np.ndarray:
    """The same of a closed route, its first knot once more at its end."""
    three = np.r_[given[:-1], given[:-1], given], np.r_[curvature[:-1], curvature[:-1], curvature]
    n = len(given) - 1
    middle = _top(*three, h, limits, (False, False))[n : 2 * n]
    top = np.r_[middle, middle[:1]]
    return top if np.isinf(limits.jerk) else _smooth(top, h, limits, None)


def _top(given: np.ndarray, curvature: np.ndarray, h: float, limits: SpeedLimits, ends: tuple[bool, bool]):
    """Squared speeds within all limits but that of jerk."""
    top = np.minimum(given, limits.speed) ** 2
    with np.errstate(divide="ignore"):
        top = np.minimum(top, limits.lateral_acceleration / np.abs(curvature))
    if ends[0]:
        top[0] = 0.0
    if ends[1]:
        top[-1] = 0.0
    return _passes(top, 2 * h * limits.acceleration, 2 * h * limits.deceleration)


def _passes(top: np.ndarray, gain: float, loss: float) -> np.ndarray:
    """The largest squared speeds below `top` that rise by at most `gain` and fall by at most `loss` from knot to knot.

    In one go: the least over all knots of top + gain x distance, from either side.
    """
    n = np.arange(len(top))
    for slope, way in ((gain, slice(None)), (loss, slice(None, None, -1))):
        if np.isfinite(slope):
            top = (np.minimum.accumulate(top[way] - slope * n) + slope * n)[way]
    return top


def _smooth(top: np.ndarray, h: float, limits: SpeedLimits, ends: tuple[bool, bool] | None) -> np.ndarray:
    """Squared speeds below `top` whose jerk keeps its limit too; `ends` as in `squares`, None of a closed route.

    Jerk is the step of acceleration from piece to piece over the time between their middles. That time hangs on the
    speeds, so linear programmes are solved in turn, each with the times of the speeds before it, until they agree. What
    is over the limit then, about `NEAR` or 2 NEAR where they swing, is taken away by driving all of it slower.
    """
    every = np.arange(len(top))
    chosen = np.unique(np.round(np.linspace(0, every[-1], min(len(top), MOST))).astype(int))
    lengths, most = h * np.diff(chosen), top[chosen]
    rows = [(_between_knots(chosen, len(top)), np.delete(top, chosen))]
    rate, step = _differences(lengths, ends)
    rows += [(rate, np.full(len(lengths), limits.acceleration)), (-rate, np.full(len(lengths), limits.deceleration))]
    square, found, over = most, most, np.inf
    for _ in range(ROUNDS):
        side = limits.jerk * _between(square, lengths, ends)
        weights = np.maximum(square, SLOW * square.max()) ** -1.5  # of a piece's time, by its squared speed
        found = _programme(most, weights, [*rows, (step, side), (-step, side)])
        over = np.max(np.abs(step @ found) / (limits.jerk * _between(found, lengths, ends)), initial=0.0)
        if abs(over - 1) <= NEAR and np.abs(found - square).max() <= NEAR * square.max():
            break
        square = (square + found) / 2
    found = found / max(over, 1.0) ** (2 / 3)  # jerk goes with the cube of speed
    return np.interp(every, chosen, found)


def _differences(lengths: np.ndarray, ends: tuple[bool, bool] | None) -> tuple[sparse.csr_array, sparse.csr_array]:
    """What makes of squared speeds the acceleration on each piece, and of those its steps; rest is without any."""
    from scipy import sparse  # late, as below: half a second that only a limit of jerk needs

    n = len(lengths)
    row, change = np.arange(n), 1 / (2 * lengths)
    entries = np.r_[-change, change], (np.r_[row, row], np.r_[row, row + 1])
    rate = sparse.csr_array(entries, shape=(n, n + 1))
    if ends is None:
        return rate, sparse.csr_array(rate - sparse.vstack([rate[-1:], rate[:-1]]))
    first, last = (rate[:1] if ends[0] else rate[:0]), (-rate[-1:] if ends[1] else rate[:0])
    return rate, sparse.csr_array(sparse.vstack([first, rate[1:] - rate[:-1], last]))


def _between(square: np.ndarray, lengths: np.ndarray, ends: tuple[bool, bool] | None) -> np.ndarray:
    """The times [s] over which acceleration steps: from the middle of a piece to that of the next."""
    root = np.sqrt(square)
    half = lengths / np.maximum(root[1:] + root[:-1], np.sqrt(np.finfo(float).tiny))
    if ends is None:
        return half + np.roll(half, 1)
    return np.r_[half[:1] if ends[0] else [], half[1:] + half[:-1], half[-1:] if ends[1] else []]


def _between_knots(chosen: np.ndarray, n: int) -> sparse.csr_array:
    """What makes of squared speeds at chosen ones of `n` knots those at the others."""
    from scipy import sparse

    others = np.delete(np.arange(n), chosen)
    after = np.searchsorted(chosen, others)
    share = (others - chosen[after - 1]) / (chosen[after] - chosen[after - 1])
    row = np.arange(len(others))
    entries = np.r_[1 - share, share], (np.r_[row, row], np.r_[after - 1, after])
    return sparse.csr_array(entries, shape=(len(others), len(chosen)))


def _programme(most: np.ndarray, weights: np.ndarray, rows: list[tuple[sparse.csr_array, np.ndarray]]) -> np.ndarray:
    """Squared speeds up to `most`, of the largest weighted sum, for which no row of a matrix is above its side."""
    from scipy import sparse
    from scipy.optimize import linprog

    rows = [(matrix, side) for matrix, side in rows if np.all(np.isfinite(side))]
    matrix, right = sparse.vstack([matrix for matrix, _ in rows]), np.concatenate([side for _, side in rows])
    bounds = np.c_[np.zeros_like(most), most]
    found = linprog(-weights / weights.max(), matrix.tocsr(), right, bounds=bounds, method="highs")
    if not found.success:
        raise ValueError(f"no speed profile within the limits was found: {found.message}")
    return np.clip(found.x, 0.0, most)
