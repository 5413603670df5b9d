"""What no path can be made of: points and speeds, looked at before a curve is laid through them."""

from __future__ import annotations

import numpy as np
from jax.typing import ArrayLike

REPEATED = 1e-2  # of the distances around it, below which a distance between points is a point given twice
SHARP = -0.5  # cosine of two turns in a row, 120 degrees, from which a step between them goes back
BACK, ON = 0.5, 0.1  # of the steps around it, below which one back is a slip; of that one, near to the way before it


def checked(points: ArrayLike, speed: ArrayLike | None, closed: bool) -> np.ndarray:
    """Points and speeds as rows (N, 3), found usable."""
    points, speeds = signed(points, speed, least=3 if closed else 2, backwards=False)
    after = np.roll(points, -1, axis=0) if closed else points[1:]
    gaps = np.linalg.norm(after - points[: len(after)], axis=1)
    around = _neighbouring(gaps, closed)
    repeated = gaps <= REPEATED * around
    if repeated.any():
        first = int(np.argmax(repeated)) + 1
        second = first % len(points) + 1
        apart = f"only {gaps[first - 1]:.3g} m apart, against {around[first - 1]:.3g} m around them"
        closes = "; a closed path needs no repetition of its first point" if second == 1 else "; leave one out"
        raise ValueError(
            "points must differ from the one before;"
            f" number {first} and number {second} are {apart if gaps[first - 1] else 'equal'}{closes}"
        )
    if went := _back(points, closed):
        raise ValueError(f"points must go on along the path; {went}")
    return np.column_stack([points, speeds])


def signed(
    points: ArrayLike, speed: ArrayLike | None, least: int = 2, backwards: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 2), at least so many, and a speed for each, negative and not 0 where it may be driven `backwards`."""
    points = numbers("points", points)
    if points.ndim == 2 and points.shape[1] == 3 and speed is None and backwards:
        points, speed = points[:, :2], points[:, 2]
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"points must be of shape (N, 2), x and y; their shape is {points.shape}")
    speeds = numbers("speed", 1.0 if speed is None else speed)
    if len(points) < least:
        kind = "a closed" if least > 2 else "an open"
        raise ValueError(f"points must be at least {least} for {kind} path; given {len(points)}")
    if speeds.shape not in ((), (len(points),)):
        raise ValueError(f"speed must be a number or one for each of {len(points)} points; its shape is {speeds.shape}")
    for name, bad in (("points", ~np.isfinite(points).all(axis=1)), ("speed", ~np.isfinite(np.atleast_1d(speeds)))):
        if bad.any():
            raise ValueError(f"{name} must be finite; number {np.argmax(bad) + 1} is not")
    low = speeds == 0 if backwards else speeds <= 0
    if np.any(low):
        place = f"number {np.argmax(low) + 1} is " if speeds.ndim else "it is "
        raise ValueError(f"speed must {'not be 0' if backwards else 'be > 0'}; {place}{speeds.flat[np.argmax(low)]:g}")
    return points, np.broadcast_to(speeds, len(points)).astype(float)


def _back(points: np.ndarray, closed: bool) -> str:
    """Where a way turns back for a step and then goes on: a slip, or a lap that runs past its own beginning."""
    steps = np.diff(np.r_[points, points[:1]] if closed else points, axis=0)
    gaps = np.linalg.norm(steps, axis=1)
    unit = steps / gaps[:, None]
    sharp = np.sum(unit * np.roll(unit, 1, axis=0), axis=1) < SHARP
    back = sharp & np.roll(sharp, -1)
    if not closed:
        back[[0, -1]] = False
    short = back & (gaps < BACK * np.minimum(np.roll(gaps, 1), np.roll(gaps, -1)))
    if closed and back[-1] and not short[-1] and len(points) > 3:
        first, line = points[1:-1], steps[1:-1]  # does a later part pass where the path began?
        share = np.clip(np.sum((points[0] - first) * line, axis=1) / gaps[1:-1] ** 2, 0, 1)
        off = np.linalg.norm(points[0] - first - share[:, None] * line, axis=1)
        off[np.cumsum(gaps[:-2]) < gaps[-1]] = np.inf
        short[-1] = off.min() < ON * gaps[-1] and line[np.argmin(off)] @ steps[0] > 0
    if not short.any():
        return ""
    number = int(np.argmax(short)) + 1
    if number == len(points):
        return f"it has passed number 1 before number {number}; leave out the last ones of a closed path that do so"
    return f"from number {number} to number {number + 1} it goes back by {gaps[number - 1]:.3g} m; leave one out"


def _neighbouring(gaps: np.ndarray, closed: bool) -> np.ndarray:
    """For each distance between points the usual one around it: the larger of two on either side, the smaller side."""
    padded = np.pad(gaps, 2, mode="wrap" if closed else "constant")
    sides = np.maximum(padded[:-4], padded[1:-3]), np.maximum(padded[3:-1], padded[4:])
    return np.where(np.minimum(*sides) > 0, np.minimum(*sides), np.maximum(*sides))


def numbers(name: str, given: ArrayLike) -> np.ndarray:
    """What was given, as an array of numbers."""
    try:
        return np.asarray(given, float)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{name} must be numbers, as many in every row ({error})") from error
