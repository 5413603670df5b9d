"""A path of poses as a reference in time: position, velocity, acceleration and heading of one point."""

from __future__ import annotations

import numpy as np

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


class Motion:
    """Progress along a path from `start` to `end`: from the `rate` it has, to `cruise`, and to rest, all smoothly.

    The acceleration of a ramp is a parabola in time whose peak is `acceleration`. A path too short for `cruise` is
    driven slower; one too short even to stop is braked on harder.
    """

    def __init__(self, start, end, rate, cruise, acceleration):
        """All in the unit of the path's parameter, and seconds."""
        length = max(end - start, 1e-9)
        acceleration = max(acceleration, 0.75 * rate**2 / length)
        cruise = min(cruise, np.sqrt((acceleration * length + 0.75 * rate**2) / 1.5))
        up, down = 1.5 * abs(cruise - rate) / acceleration, 1.5 * cruise / acceleration
        even = (length - (rate + cruise) / 2 * up - cruise / 2 * down) / cruise
        self.start, self.end, self.cruise = start, end, cruise
        self.stages = ((up, rate, cruise), (max(even, 0.0), cruise, cruise), (down, cruise, 0.0))
        self.duration = sum(time for time, _, _ in self.stages)

    def __call__(self, t):
        """Progress, its rate and its acceleration a time t [s] after the start."""
        u = self.start
        for time, before, after in self.stages:
            if t < time:
                s = max(t, 0.0) / time
                u += before * s * time + (after - before) * time * (s**3 - s**4 / 2)
                rate = before + (after - before) * (3 * s**2 - 2 * s**3)
                return min(u, self.end), rate, (after - before) * 6 * s * (1 - s) / time
            u, t = u + (before + after) / 2 * time, t - time
        return self.end, 0.0, 0.0


class Reference:
    """What the path asks for: a spline through its points, driven along by a `Motion`.

    Where the points (N, 2) [m] have increasing `times` (N,) [s], these say how fast each part of the path is driven;
    otherwise it is driven at one speed. Points nearer than `spacing` [m] to the one before are left out.
    """

    def __init__(self, points, times=None, spacing=0.0):
        """Raises ValueError where the points make no path."""
        points = np.asarray(points, float).reshape(-1, 2)
        if not np.all(np.isfinite(points)):
            raise ValueError("the path has a position that is not finite")
        kept = _apart(points, max(spacing, 1e-6))
        if len(kept) < 2:
            raise ValueError(f"the path has no two poses that are {spacing:g} m apart")
        points = points[kept]
        knots = np.zeros(len(kept)) if times is None else np.asarray(times, float)[kept] - times[0]
        self.timed = bool(np.all(np.diff(knots) > 0))
        self.spline = Spline(knots, points) if self.timed else _by_length(points)
        self.end = self.spline.knots[-1]
        parts = self.spline.knots[:-1, None] + np.diff(self.spline.knots)[:, None] * np.arange(SAMPLES) / SAMPLES
        self.samples = np.append(parts.ravel(), self.end)
        self.motion, self.heading = Motion(0.0, self.end, 0.0, 1.0, 1.0), None
        self.reached = 0.0  # the parameter that was asked for last

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
        for _ in range(5):  # Gauss and Newton's method
            value, slope, _ = self.spline(found)
            found = np.clip(found + (point - value) @ slope / max(slope @ slope, 1e-12), after, self.end)
        return float(found)

    def drive(self, start, moving, speed, acceleration, max_speed, max_yaw_rate):
        """Plan the drive from u = `start`, where the point moves along the path at `moving` [m/s] already.

        Slower than asked for where the path would else be faster than `max_speed` [m/s] or `max_yaw_rate` [rad/s].
        Returns the share of the speed asked for that is left, at most 1.
        """
        _, slope, bend = self.spline(np.append(start, self.samples[self.samples > start]))
        size = np.maximum(np.linalg.norm(slope, axis=-1), 1e-9)
        turn = np.abs(slope[..., 0] * bend[..., 1] - slope[..., 1] * bend[..., 0]) / size**2
        wanted = 1.0 if self.timed else speed
        cruise = min(wanted, max_speed / size.max(), max_yaw_rate / max(turn.max(), 1e-9))
        self.motion = Motion(start, self.end, moving / size[0], cruise, acceleration / size.max())
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
