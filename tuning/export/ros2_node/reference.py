"""A path of poses as a reference in time: position, velocity, acceleration and heading of one point."""

from __future__ import annotations

import numpy as np

from .motion import Motion

FAR = 1e8  # m; a number beyond is no place: squares of it are still told apart
SAMPLES = 8  # to a segment of the path, where it is searched
NODES, WEIGHTS = np.polynomial.legendre.leggauss(5)


class Spline:
    """Natural cubic spline through points (N, 2) at increasing knots (N,): twice continuously differentiable."""

    def __init__(self, knots, points):
        """N is at least 2; two points make a straight line."""
        self.knots, self.points = np.asarray(knots, float), np.asarray(points, float)
        self.bends = _second_derivatives(self.knots, self.points)

    def __call__(self, u):
        """The value and the first two derivatives at u (...), each (..., 2)."""
        u = np.asarray(u, float)
        i = np.clip(np.searchsorted(self.knots, u, side="right") - 1, 0, len(self.knots) - 2)
        h = (self.knots[i + 1] - self.knots[i])[..., None]
        right = (u - self.knots[i])[..., None] / h
        left = 1 - right
        before, after = self.bends[i], self.bends[i + 1]
        value = left * self.points[i] + right * self.points[i + 1]
        value = value + ((left**3 - left) * before + (right**3 - right) * after) * h**2 / 6
        chord = (self.points[i + 1] - self.points[i]) / h
        slope = chord + ((3 * right**2 - 1) * after - (3 * left**2 - 1) * before) * h / 6
        return value, slope, left * before + right * after

    def lengths(self):
        """Length of each segment, (N-1,), by Gauss's rule of five points."""
        half = np.diff(self.knots)[:, None] / 2
        _, slope, _ = self(self.knots[:-1, None] + half * (1 + NODES))
        return np.linalg.norm(slope, axis=-1) @ WEIGHTS * half[:, 0]


def _second_derivatives(knots, points):
    """Those at the knots, (N, 2): the tridiagonal system of a natural spline, x and y as one complex number."""
    h = np.diff(knots).tolist()
    slopes = (np.diff(points[:, 0]) + 1j * np.diff(points[:, 1])) / np.diff(knots)
    right = (6 * np.diff(slopes)).tolist()
    pivots, ahead = [], 0.0
    for i in range(len(right)):
        pivot = 2 * (h[i] + h[i + 1]) - h[i] * ahead
        right[i] = (right[i] - (h[i] * right[i - 1] if i else 0)) / pivot
        ahead = h[i + 1] / pivot
        pivots.append(ahead)
    for i in range(len(right) - 2, -1, -1):
        right[i] -= pivots[i] * right[i + 1]
    inner = np.array(right, complex)
    bends = np.zeros((len(knots), 2))
    bends[1:-1] = np.stack([np.real(inner), np.imag(inner)], axis=-1)
    return bends


class Reference:
    """What the path asks for: a spline through its points, driven along by a `Motion`.

    Where the points (N, 2) [m] have `times` (N,) [s], as `timing` passes them, these say how fast each part of the path
    is driven; otherwise it is driven at one speed. Points nearer than `spacing` [m] to the one before are left out.
    """

    def __init__(self, points, times=None, spacing=0.0):
        """Raises ValueError where the points make no path."""
        self.points, self.kept = _way(points, spacing)
        self.timed, points = times is not None, self.points[self.kept]
        knots = np.zeros(len(points)) if times is None else np.asarray(times, float)[self.kept] - times[0]
        self.spline = Spline(knots, points) if self.timed else _by_length(points)
        self.end = self.spline.knots[-1]
        parts = self.spline.knots[:-1, None] + np.diff(self.spline.knots)[:, None] * np.arange(SAMPLES) / SAMPLES
        self.samples = np.append(parts.ravel(), self.end)
        self.motion, self.heading = Motion(0.0, self.end, 0.0, 1.0, 1.0), None
        self.reached = 0.0  # the parameter that was asked for last

    def cut(self, points):
        """How many poses of this path's front these lack, which are else the same; None if they differ."""
        n = len(self.points) - len(points)
        return n if n >= 0 and np.array_equal(self.points[n:], points) else None

    def pace(self, t):
        """Where the reference is a time t [s] into the drive, (2,), which way it points, (2,), and how it moves on.

        That is its speed [m/s] and acceleration [m/s^2] along the path, and the time [s] that its ramp still takes.
        """
        u, rate, acceleration = self.motion(t)
        value, slope, bend = self.spline(u)
        size = max(np.linalg.norm(slope), 1e-9)
        along = slope @ bend / size * rate**2 + size * acceleration
        return value, slope / size, (float(size * rate), float(along), self.motion.left(t))

    def goes_on(self, before, t, within):
        """The u from which this path goes on from the reference of the one before at its time t [s].

        None where it does not pass within `within` [m] of that place, or passes another way.
        """
        place, direction, _ = before.pace(t)
        front = before.cut(self.points)
        if front is not None:
            index = np.interp(before.motion(t)[0], before.spline.knots, before.kept)
            return float(np.interp(index - front, self.kept, self.spline.knots))
        places, slopes, _ = self.spline(self.samples)
        same_way = slopes @ direction > 0.5 * np.linalg.norm(slopes, axis=-1)
        off = np.where(same_way, np.linalg.norm(places - place, axis=-1), np.inf)
        step = np.linalg.norm(np.diff(places, axis=0), axis=-1).max()
        if off.min() > within + step:
            return None
        first = int(np.flatnonzero(off <= within + step)[0])
        first += int(np.argmin(off[first : first + 2 * SAMPLES]))
        before_it = -within / max(
            np.linalg.norm(slopes[0]), 1e-9
        )  # a path may begin a little ahead: nothing is skipped
        start = self._closest(place, self.samples[first], before_it)
        return start if np.linalg.norm(self.spline(start)[0] - place) <= within else None

    def nearest(self, point, after, within):
        """Where the path passes the point, at most `within` [m] from it: the first such u from `after` on.

        It is nearest there for as far as the next `within` of the path, so that of a path that crosses itself the
        earlier branch is found. Raises ValueError where the path comes nowhere that near.
        """
        u = np.append(after, self.samples[self.samples > after])
        places = self.spline(u)[0]
        off = np.linalg.norm(places - point, axis=-1)
        if off.min() > within:
            raise ValueError(f"the path comes no nearer than {off.min():.2f} m to the vehicle, max_error is {within:g}")
        driven = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=-1)))
        ends = np.searchsorted(driven, driven + within)
        found = u[next(i for i in np.flatnonzero(off <= within) if off[i] <= off[i : ends[i] + 1].min())]
        return self._closest(point, found, after)

    def _closest(self, point, u, after):
        for _ in range(5):  # Gauss and Newton's method
            value, slope, _ = self.spline(u)
            u = np.clip(u + (point - value) @ slope / max(slope @ slope, 1e-12), after, self.end)
        return float(u)

    def drive(self, start, moving, pull, left, speed, acceleration, max_speed, max_yaw_rate):
        """Plan the drive from u = `start`, where the point moves along the path at `moving` [m/s] already.

        `pull` [m/s^2] and `left` [s] are what else `pace` says of that motion.
        Slower than asked for where the path would else be faster than `max_speed` [m/s] or `max_yaw_rate` [rad/s].
        Returns the share of the speed asked for that is left, at most 1.
        """
        _, slope, bend = self.spline(np.append(start, self.samples[self.samples > start]))
        size = np.maximum(np.linalg.norm(slope, axis=-1), 1e-9)
        turn = np.abs(slope[..., 0] * bend[..., 1] - slope[..., 1] * bend[..., 0]) / size**2
        wanted = 1.0 if self.timed else speed
        cruise = min(wanted, max_speed / size.max(), max_yaw_rate / max(turn.max(), 1e-9))
        rate = moving / size[0]
        push = (pull - slope[0] @ bend[0] / size[0] * rate**2) / size[0]
        self.motion = Motion(start, self.end, rate, cruise, acceleration / size.max(), push, left)
        return cruise / wanted

    def at(self, t, heading):
        """The reference a time t [s] into the drive; its heading is continuous, and begins nearest to `heading`."""
        u, rate, acceleration = self.motion(t)
        self.reached = float(u)
        value, slope, bend = self.spline(u)
        near = heading if self.heading is None else self.heading
        course = np.arctan2(slope[1], slope[0])
        self.heading = float(course + 2 * np.pi * np.round((near - course) / (2 * np.pi)))
        return {
            "position": value,
            "velocity": slope * rate,
            "acceleration": bend * rate**2 + slope * acceleration,
            "heading": self.heading,
            "heading_rate": float((slope[0] * bend[1] - slope[1] * bend[0]) / max(slope @ slope, 1e-12) * rate),
        }


def timing(points, times, spacing, slowest, fastest):
    """The times (N,) [s], or None where they are no timing, and why they are none.

    They are one where they increase and ask for a speed between `slowest` and `fastest` [m/s].
    """
    try:
        points, kept = _way(points, spacing)
    except ValueError:
        return None, ""  # no path either, which `Reference` says
    times = np.asarray(times, float)
    if times.shape != (len(points),) or not np.all(np.isfinite(times)):
        return None, "are not one number for each pose"
    if not np.any(np.diff(times)):
        return None, "are all equal"
    if not np.all(np.diff(times) > 0):
        return None, "do not increase from each pose to the next"
    speeds = np.linalg.norm(np.diff(points, axis=0), axis=-1) / np.diff(times)
    if speeds.max() > fastest * (1 + 1e-6):
        return None, f"ask for more than max_speed = {fastest:g} m/s"
    speeds = np.linalg.norm(np.diff(points[kept], axis=0), axis=-1) / np.diff(times[kept])
    if speeds.min() < slowest:
        return None, "ask for next to no speed, as if some had not been set"
    return times - times[0], ""


def _way(points, spacing):
    """The points (N, 2), and the indices of those `spacing` apart. Raises ValueError where they make no path."""
    points = np.asarray(points, float).reshape(-1, 2)
    if not np.all(np.abs(points) < FAR):  # NaN too
        raise ValueError(f"the path has a position that is not finite, or beyond {FAR:g} m")
    kept = _apart(points, max(spacing, 1e-6))
    if len(kept) < 2:
        raise ValueError(f"the path has no two poses that are {spacing:g} m apart")
    return points, np.array(kept)


def _apart(points, spacing):
    """Indices of the points that are `spacing` apart; the last is always among them."""
    kept = [0]
    for i in range(1, len(points)):
        if np.hypot(*(points[i] - points[kept[-1]])) >= spacing:
            kept.append(i)
    last = len(points) - 1
    if kept[-1] != last and len(kept) > 1:
        kept[-1] = last
    return kept


def _by_length(points):
    """The spline whose parameter is its own length, to the accuracy of a few corrections."""
    spline = Spline(np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))), points)
    for _ in range(3):
        spline = Spline(np.append(0.0, np.cumsum(spline.lengths())), points)
    return spline
