"""What was read of a file of waypoints, made ready to lay a path through: thinned, with speeds, near an origin."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..io import drives

FAR = 1000.0  # m from a map's origin, from which on a path is counted from its own beginning
NEAR = "nearer than {:.3g} m to the one before (standing still, jitter; scenario.path.spacing)"
SPOKEN = 1.0  # s of standing still that are worth a word
SLOW = 0.01  # m/s, below which nothing is driven: times are then in another unit


class Track(NamedTuple):
    """Waypoints.

    Attributes:
        points: (N, 2) m.
        speed: at each [m/s]; None: the file does not say.
        widths: of a corridor to the left and to the right of each (N, 2) m; None: the file does not say.
        said: what was done to them.
    """

    points: np.ndarray
    speed: np.ndarray | None
    widths: np.ndarray | None
    said: list[str]


def origin(rows: np.ndarray) -> tuple[float, float]:
    """Where [m] of its map a path through rows (N, ...) is counted from: whole metres by its first point, if far."""
    if rows.shape[0] == 0 or not np.all(np.isfinite(rows[0, :2])) or np.abs(rows[0, :2]).max() < FAR:
        return (0.0, 0.0)
    x, y = np.round(rows[0, :2]).tolist()
    return x, y


def waypoints(
    columns: Mapping[str, np.ndarray], closed: bool, fixed: bool, spacing: float | None, stops: bool = False
) -> Track:
    """The waypoints of columns x, y and perhaps speed, t, left and right.

    Args:
        columns: by our names, in SI units.
        closed: whether the path goes on from its last point to its first.
        fixed: whether the speed is said elsewhere.
        spacing: at least so far apart [m]; None: a recorded drive as far as it takes, others as they are.
        stops: whether the vehicle may stop on the way, where the speed is 0; not on a closed path.

    Raises:
        ValueError: the points make no path at any spacing.
    """
    points, t = np.column_stack([columns["x"], columns["y"]]), columns.get("t")
    if closed and len(points) > 3 and np.array_equal(points[0], points[-1]):  # as racing lines are written
        columns = {name: values[:-1] for name, values in columns.items()}
        points, t = points[:-1], None if t is None else t[:-1]
    kept = drives.thinned(points, closed, t is not None) if spacing is None else drives.apart(points, spacing)
    said, speed, halts, lost = [], columns.get("speed"), np.zeros(0, int), 0
    stops = stops and not closed and not fixed
    if (fewer := len(points) - len(kept.rows)) > 0:
        said.append(f"{fewer} of {len(points)} points left out, {NEAR.format(kept.spacing)}")
    if speed is not None:
        if stops:
            kept, halts, lost = drives.halts(points, speed, kept)
        speed = speed[kept.rows]
        speed[halts] = 0.0
    elif t is not None and not fixed:
        speed, words = _driven(points, t, kept)
        said.append(words)
    if speed is not None and not fixed:
        speed, words = _slowest(speed, halts, lost, "" if stops else ", for only an open route has stops")
        said += words
    widths = (
        np.column_stack([columns["left"], columns["right"]])[kept.rows] if {"left", "right"} <= {*columns} else None
    )
    return Track(points[kept.rows], speed, widths, said)


def _slowest(speed: np.ndarray, halts: np.ndarray, lost: int, why: str) -> tuple[np.ndarray, list[str]]:
    """Speeds that are 0 at these stops alone, and the words for it."""
    speed, still = drives.moving(speed)
    speed[halts], still, said = 0.0, still - len(halts), []
    if len(halts):
        said.append(f"it stops at {len(halts)} of {len(speed)} points, where its speed is 0 (scenario.path.dwell)")
    if lost:
        said.append(f"{lost} stops nearer to another one than the spacing are left out (scenario.path.spacing)")
    if still > 0:
        said.append(f"speed 0 at {still} of {len(speed)} points taken for {drives.CRAWL:.0%} of the largest{why}")
    return speed, said


def _driven(points: np.ndarray, t: np.ndarray, kept: drives.Thinned) -> tuple[np.ndarray, str]:
    """The speed at each waypoint by the times of a drive, and the words for it.

    Raises:
        ValueError: nothing is driven so slowly.
    """
    speed, stood = drives.speeds(points, t, kept)
    if not speed.max() >= SLOW:
        mended = 'if they are in ms, say columns = { t = { column = "its name", unit = "ms" } }, or speed'
        raise ValueError(f"by its times it was driven at {speed.max():.2g} m/s at most; {mended}")
    words = f"speeds are those at which it was driven, {speed.min():.3g} to {speed.max():.3g} m/s"
    return speed, words + f", {stood:.0f} s at rest apart (a stop is a point of speed 0)" * (stood > SPOKEN)
