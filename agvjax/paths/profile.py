"""The speed over a route: what it was given, reduced to what acceleration and curvature allow."""

from __future__ import annotations

import dataclasses

import numpy as np

from .._pytree import POSITIVE, number, pytree


@pytree
class SpeedLimits:
    """What the speed of a route is reduced to; infinite: no limit.

    By a forward and a backward pass over squared speed, after Kapania, Subosits and Gerdes (2016).
    """

    speed: float = number(np.inf, "m/s", POSITIVE)
    acceleration: float = number(np.inf, "m/s^2", POSITIVE, "speeding up")
    deceleration: float = number(np.inf, "m/s^2", POSITIVE, "slowing down")
    lateral_acceleration: float = number(np.inf, "m/s^2", POSITIVE, "speed^2 times curvature")
    stop: bool = dataclasses.field(default=True, metadata={"static": True})  # at the end of an open route

    def faster(self, factor: float) -> SpeedLimits:
        """Those of a route driven so many times as fast: in a turn that takes the square of it sideways."""
        sideways = factor**2 * self.lateral_acceleration
        return dataclasses.replace(self, speed=factor * self.speed, lateral_acceleration=sideways)


def squares(given: np.ndarray, curvature: np.ndarray, h: float, limits: SpeedLimits, ends: tuple[bool, bool]):
    """Squared speeds (N,) [m^2/s^2] at knots `h` [m] apart, of given speeds (N,) [m/s] and curvatures (N,) [1/m].

    `ends` says whether the vehicle stands at the first and at the last knot.
    """
    top = np.minimum(given, limits.speed) ** 2
    with np.errstate(divide="ignore"):
        top = np.minimum(top, limits.lateral_acceleration / np.abs(curvature))
    if ends[0]:
        top[0] = 0.0
    if ends[1]:
        top[-1] = 0.0
    return _passes(top, 2 * h * limits.acceleration, 2 * h * limits.deceleration)


def around(given: np.ndarray, curvature: np.ndarray, h: float, limits: SpeedLimits) -> np.ndarray:
    """The same of a closed route, its first knot once more at its end."""
    three = np.r_[given[:-1], given[:-1], given], np.r_[curvature[:-1], curvature[:-1], curvature]
    n = len(given) - 1
    middle = squares(*three, h, limits, (False, False))[n : 2 * n]
    return np.r_[middle, middle[:1]]


def _passes(top: np.ndarray, gain: float, loss: float) -> np.ndarray:
    """The largest squared speeds below `top` that rise by at most `gain` and fall by at most `loss` from knot to knot.

    In one go: the least over all knots of top + gain x distance, from either side.
    """
    n = np.arange(len(top))
    for slope, way in ((gain, slice(None)), (loss, slice(None, None, -1))):
        if np.isfinite(slope):
            top = (np.minimum.accumulate(top[way] - slope * n) + slope * n)[way]
    return top
