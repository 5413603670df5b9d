"""A drive that was recorded, or any dense track, as waypoints: standing still and jitter left out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from agvjax.paths.points import checked

DENSE = 50  # points from which on a file without times is one that was recorded
FINEST, COARSEST, RATIO = 1e-4, 0.1, 2**0.5  # of a track's extent: the spacings that are tried, each so much wider
SHARP, CORNERS = np.pi / 3, 0.02  # rad, a turn beyond which a point is a corner; what share of points may be corners
SHAKEN = 0.1  # rad, by which most turns differ from the one before at most: beyond it is noise
PARTS = 5  # of the way between two waypoints
STOPPED, REST = 0.2, 1.0  # of the speed on the ways beside it, on a way with a stop; s that this takes at least
STILL, CRAWL = 1e-3, 0.05  # of the largest speed: below it a vehicle stands; what is driven there instead


class Thinned(NamedTuple):
    """Which rows of a track are waypoints.

    Attributes:
        rows: their numbers, increasing.
        spacing: at least so far [m] is each from the one before; 0: none was left out.
    """

    rows: np.ndarray
    spacing: float


def apart(points: np.ndarray, spacing: float) -> Thinned:
    """Points (N, 2) each at least `spacing` [m] from the one before, and the last point."""
    rows = [0]
    for i in range(1, len(points)):
        if np.hypot(*(points[i] - points[rows[-1]])) >= spacing:
            rows.append(i)
    last = len(points) - 1
    if rows[-1] != last and spacing > 0:
        near = np.hypot(*(points[last] - points[rows[-1]])) < spacing / 2
        rows[-1:] = [last] if near and len(rows) > 1 else [rows[-1], last]
    return Thinned(np.array(rows), spacing)


def thinned(points: np.ndarray, closed: bool, timed: bool) -> Thinned:
    """The points of a track (N, 2) [m] that a path can be laid through: all, or those of the finest spacing that do.

    Of a recorded drive (`timed`) they must also be free of noise, at best without corners; a few points without times
    are left as they are.

    Raises:
        ValueError: no spacing does.
    """
    everything = Thinned(np.arange(len(points)), 0.0)
    if len(points) < (4 if timed else DENSE) or (not timed and _sound(points, closed)):
        return everything
    extent, share, tried = float(np.linalg.norm(np.ptp(points, axis=0))), FINEST, [everything] * timed
    while share <= COARSEST and extent > 0:
        tried.append(apart(points, share * extent))
        share *= RATIO
    for corners, shaken in ((0.0, SHAKEN), (CORNERS, SHAKEN), (1.0, np.inf)):
        for one in tried:
            if _calm(points[one.rows], closed, corners, shaken):
                return one
    raise ValueError("no path can be laid through its points, however far apart they are taken; say spacing [m]")


def _sound(points: np.ndarray, closed: bool) -> bool:
    try:
        checked(points, 1.0, closed)
    except ValueError:
        return False
    return True


def _calm(points: np.ndarray, closed: bool, corners: float, shaken: float) -> bool:
    """Whether a path can be laid through points, few of which are corners, and most turns are like the one before."""
    if len(points) < 4 or not _sound(points, closed):
        return False
    steps = np.diff(points, axis=0)
    turns = np.diff(np.arctan2(steps[:, 1], steps[:, 0]))
    turns -= 2 * np.pi * np.round(turns / (2 * np.pi))
    return bool(np.mean(np.abs(turns) > SHARP) <= corners and np.median(np.abs(np.diff(turns))) <= shaken)


def speeds(points: np.ndarray, t: np.ndarray, kept: Thinned) -> tuple[np.ndarray, float]:
    """The speed [m/s] at each waypoint, and how long [s] the vehicle stood still, which does not count.

    The way between two waypoints is cut into `PARTS`, of which the one with the median time tells the speed: standing
    is in one of them, or in two. Where there are too few instants for that, a way driven `STOPPED` times as fast as
    those beside it is one on which the vehicle stood. At a waypoint the speed is the mean of the ways on both sides.
    """
    way, lengths, stood = [], [], 0.0
    for i, j in zip(kept.rows[:-1], kept.rows[1:], strict=True):
        line = points[j] - points[i]
        progress = np.maximum.accumulate((points[i : j + 1] - points[i]) @ line / (line @ line))
        first = np.r_[True, np.diff(progress) > 0]  # instants at which it was never so far before
        times = np.diff(np.interp(np.linspace(0, 1, PARTS + 1), progress[first], t[i : j + 1][first]))
        moved = PARTS * float(np.median(times))
        way.append(float(np.hypot(*line)) / moved)
        lengths.append(float(np.hypot(*line)))
        whole = float(t[j] - t[i])
        stood += whole - moved if whole > 2 * moved else 0.0
    beside = [(a + b) / 2 for a, b in zip(way[:-2], way[2:], strict=True)]
    for k, usual in enumerate(beside, 1):
        if way[k] < STOPPED * usual and lengths[k] * (1 / way[k] - 1 / usual) > REST:
            stood += lengths[k] * (1 / way[k] - 1 / usual)
            way[k] = usual
    begin, end = way[:1], way[-1:]
    return (np.array([*begin, *way]) + np.array([*way, *end])) / 2, stood


def halts(points: np.ndarray, speed: np.ndarray, kept: Thinned) -> tuple[Thinned, np.ndarray, int]:
    """The stops on the way, which take the places of the nearest waypoints.

    Of points in a row at which the speed (N,) is 0 the first is one, or the last where it turns back there.

    Returns:
        The waypoints; which of them are stops, by number; how many stops are too near to another one.
    """
    still = np.flatnonzero(np.abs(speed) <= STILL * np.abs(speed).max(initial=0.0))
    runs = [run for run in np.split(still, np.flatnonzero(np.diff(still) > 1) + 1) if run.size]
    runs = [run for run in runs if run[0] > 0 and run[-1] < len(speed) - 1]
    rows, taken = kept.rows.copy(), set()
    for run in runs if len(rows) > 2 else []:
        row = run[0] if speed[run[0] - 1] * speed[run[-1] + 1] > 0 else run[-1]
        k = int(np.searchsorted(rows, row))
        before, after = (float(np.hypot(*(points[rows[i]] - points[row]))) for i in (k - 1, k))
        k = min(max(k if after < before else k - 1, 1), len(rows) - 2)
        if k not in taken:
            rows[k] = row
            taken.add(k)
    return kept._replace(rows=rows), np.array(sorted(taken), int), len(runs) - len(taken)


def moving(speed: np.ndarray) -> tuple[np.ndarray, int]:
    """Speeds of which none is zero: where the vehicle stands, a crawl in the direction of what is next; how many."""
    most = float(np.abs(speed).max(initial=0.0))
    still = np.abs(speed) <= STILL * most
    if not still.any() or still.all():
        return speed, 0
    going = np.flatnonzero(~still)
    nearest = going[np.argmin(np.abs(going[None, :] - np.flatnonzero(still)[:, None]), axis=1)]
    speed = speed.copy()
    speed[still] = np.sign(speed[nearest]) * CRAWL * most
    return speed, int(still.sum())
