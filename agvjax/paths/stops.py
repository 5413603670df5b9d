"""Where a vehicle stops on its way and for how long: points of speed 0 and dwell times, before a route is laid."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jax.typing import ArrayLike

from .points import numbers


def stops(
    points: ArrayLike,
    speed: ArrayLike | None,
    dwell: ArrayLike,
    closed: bool,
    back: Callable[[np.ndarray, int], bool] | None = None,
) -> tuple[ArrayLike, ArrayLike | None, dict[int, float]]:
    """Points, their speeds without those of 0, and how long [s] a vehicle stands at those points, by number, at which.

    Of lines, `back` says where they turn back; elsewhere they keep their sign, and the last point has no line.

    Raises:
        ValueError: a stop on a closed route or at an end; two in a row where the speed changes its sign.
    """
    given, times = numbers("points", points), numbers("dwell", dwell)
    if given.ndim != 2:
        return points, speed, {}  # refused with all else that is wrong with points
    if given.shape[1] == 3 and speed is None:
        points, speed = given[:, :2], given[:, 2]
    n, speeds = len(given), numbers("speed", 1.0 if speed is None else speed)
    if times.shape not in ((), (n,)):
        raise ValueError(f"dwell must be a number or one for each of {n} points; its shape is {times.shape}")
    if bad := [t for t in times.ravel().tolist() if not (np.isfinite(t) and t >= 0)]:
        raise ValueError(f"dwell must be finite and >= 0 [s]; got {bad[0]:g}")
    still = speeds == 0 if speeds.shape == (n,) else np.zeros(n, bool)
    where = np.flatnonzero(still | (times > 0) if times.ndim else still)
    rule = "speed must not be 0" if still.any() else "dwell must be 0"
    if closed and (still.any() or np.any(times > 0)):
        raise ValueError(f"{rule} on a closed route, which has no stops")
    if not times.ndim and times > 0 and not where.size:
        raise ValueError(f"dwell must be one for each of {n} points where none has speed 0; got {float(times):g}")
    if ends := {0, n - 1} & {*where.tolist()}:
        raise ValueError(f"{rule} at the first and the last point, for a stop lies between; number {min(ends) + 1}")
    if still.any():
        speed = _around(speeds, still, given, back)
    return points, speed, dict(zip(where.tolist(), np.broadcast_to(times, n)[where].tolist(), strict=True))


def _around(
    speeds: np.ndarray, still: np.ndarray, points: np.ndarray, back: Callable[[np.ndarray, int], bool] | None
) -> np.ndarray:
    """Speeds in which those of 0 take the mean of the ones driven at beside them; the next where the sign changes."""
    inside, going = np.flatnonzero(still), np.flatnonzero(~still)
    first = np.searchsorted(going, inside)  # of those driven through after each
    before, after, found = speeds[going[first - 1]], speeds[going[first]], speeds.copy()
    if (odd := inside[:-1][(np.diff(inside) == 1) & (before * after < 0)[:-1]]).size:
        rule = "speed must not be 0 at two points in a row where it changes its sign"
        raise ValueError(f"{rule}; numbers {odd[0] + 1} and {odd[0] + 2}")
    if back is not None:
        kept = np.array([before[i] * after[i] < 0 and not back(points, int(k)) for i, k in enumerate(inside)])
        after = np.where(kept | ((going[first] == len(points) - 1) & (before * after > 0)), before, after)
    found[inside] = np.where(before * after > 0, (before + after) / 2, after)
    return found
