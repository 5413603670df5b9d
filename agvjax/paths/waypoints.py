"""A path through given points at given speeds: a smooth curve, fitted on the host and looked up by time."""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from .._pytree import POSITIVE, Numbers, Real, number, pytree, structure
from ..geometry import bearing
from ..protocols import Path
from .arc import Integral, Spline, gauss, quintics
from .points import checked

Values = TypeVar("Values", Array, np.ndarray)
FIRST, MOST = 8, 2**16  # pieces of a segment to begin with; pieces in all beyond which the fit is given up
OFF, SLOW = 1e-8, 1e-4  # how far off it may be: in position, of the path's size, and in velocity, of the speed there


class Geometry(NamedTuple):
    """What a path asks of a vehicle, at n instants."""

    t: np.ndarray  # s
    arc: np.ndarray  # m along the path
    position: np.ndarray  # (n, 2) m
    speed: np.ndarray  # m/s
    curvature: np.ndarray  # 1/m, positive in a left turn; its inverse is the radius
    acceleration: np.ndarray  # (n, 2) m/s^2, along the path and to its left


@pytree
class Waypoints(Path):
    """A curve through points at speeds interpolated between them; made by `Waypoints.through`.

    Curvature and acceleration are continuous. A closed path is run again and again. An open one ends at its last point,
    where the reference stands still from then on: its velocity jumps to 0 there, unless the last speed is small.

    `points` says what the path was made of and is not looked at again: to move a point make another path. Another
    `duration` runs the same path faster or slower. What a path gives is counted from `origin`, points are not.
    """

    points: Numbers  # (N, 3): x [m], y [m], speed [m/s]
    coefficients: Numbers  # (M, 6, 2) m, of the powers of the share of each of M pieces of equal duration
    duration: Real | np.ndarray = number(1.0, "s", POSITIVE)
    closed: bool = structure(False)
    origin: tuple[float, float] = structure((0.0, 0.0))  # m, where of the map of its points the path counts from

    @classmethod
    def through(cls, points: ArrayLike, speed: ArrayLike | None = None, closed: bool = False) -> Waypoints:
        """The path through points (N, 2) [m] at a speed, one for all or one for each [m/s]; 1 m/s where none is given.

        Through the points runs a cubic spline over the length of the chords, periodic where closed; the speed is a
        monotone cubic (PCHIP) over the arc length, so it never leaves the range of its neighbours.

        Raises:
            ValueError: too few points, repeated ones, numbers that are none, speeds that are not positive, or a curve
                that turns too sharply to be followed.
        """
        rows = checked(points, speed, bool(closed))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # where the curve has a cusp
            motion = _Motion(rows, bool(closed))
            pieces = FIRST * (motion.instants.size - 1)
            (x, y), turn = motion.sharpest()
            while pieces <= MOST and turn * motion.duration <= MOST:
                path = motion.fitted(pieces)
                if motion.close_to(path):
                    return path
                pieces *= 2
        raise ValueError(
            "points and speed must make a path that can be followed: it turns, or its speed changes, too suddenly for"
            f" its length, perhaps near its sharpest turn at x = {x:.4g} m, y = {y:.4g} m"
        )

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "2"]:
        """Position [m]."""
        coefficients, share, _ = self._piece(t)
        return _powers(coefficients, share)

    def bearing(self, t: Float[Array, ""]) -> Float[Array, ""]:
        """The direction of travel [rad]; of an open path that has ended, the last one."""
        coefficients, share, _ = self._piece(t)
        x_rate, y_rate = _powers(_slope(coefficients), share)
        return bearing(y_rate, x_rate)

    def lap(self) -> float | None:
        """Time [s] of a lap of a closed path."""
        return float(self.duration) if self.closed else None

    def end(self) -> float:
        """When [s] an open path stops at its last point."""
        return np.inf if self.closed else float(self.duration)

    def _piece(self, t: Array) -> tuple[Array, Array, Real | np.ndarray]:
        """The piece that is run at `t` [s], how much of it has been run, and how many there are in a second."""
        count = self.coefficients.shape[0]
        if self.closed:
            t = jnp.mod(t, self.duration)
        else:  # not clip: its slope is a half at either end
            t = jnp.where(t > self.duration, self.duration, jnp.where(t < 0, jnp.zeros_like(t), t))
        along = t * (count / self.duration)
        index = jnp.clip(jnp.floor(along).astype(int), 0, count - 1)
        return jnp.asarray(self.coefficients)[index], along - index.astype(along.dtype), count / self.duration

    def geometry(self, n: int = 2000) -> Geometry:
        """Speed, curvature and acceleration at `n` instants from start to end, on the host in float64."""
        t = np.linspace(0, float(self.duration), n)
        steps = gauss(lambda time: np.linalg.norm(self._rates(time)[1], axis=-1), t[:-1], t[1:])
        position, rate, second = self._rates(t)
        speed = np.linalg.norm(rate, axis=-1)
        tangent = rate / speed[:, None]
        left = np.stack([-tangent[:, 1], tangent[:, 0]], axis=-1)
        acceleration = np.stack([np.sum(second * tangent, -1), np.sum(second * left, -1)], axis=-1)
        return Geometry(t, np.r_[0, np.cumsum(steps)], position, speed, acceleration[:, 1] / speed**2, acceleration)

    def _rates(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position, velocity and acceleration (..., 2) at times within the path, on the host."""
        table, duration = np.asarray(self.coefficients, float), float(self.duration)
        pace = len(table) / duration
        index = np.clip((t * pace).astype(int), 0, len(table) - 1)
        position, share = table[index], t * pace - index
        rate = _slope(position) * pace
        return _powers(position, share), _powers(rate, share), _powers(_slope(rate) * pace, share)


def _powers(coefficients: Values, x: Values) -> Values:
    """A polynomial by Horner's rule: coefficients (..., k, 2) from the constant on, at x (...)."""
    value = coefficients[..., -1, :]
    for k in range(coefficients.shape[-2] - 2, -1, -1):
        value = value * x[..., None] + coefficients[..., k, :]
    return value


def _slope(coefficients: Values) -> Values:
    """The coefficients of a polynomial's derivative."""
    powers = np.arange(1, coefficients.shape[-2]).astype(coefficients.dtype)[:, None]
    return coefficients[..., 1:, :] * powers.reshape((1,) * (coefficients.ndim - 2) + powers.shape)


class _Motion:
    """Where the path is, and how fast, by its definition: t -> arc length -> length of the chords -> position."""

    def __init__(self, rows: np.ndarray, closed: bool):
        self.rows, self.closed = rows, closed
        self.curve = Spline(rows[:, :2], closed)
        self.size = float(np.linalg.norm(np.ptp(rows[:, :2], axis=0)))
        self.speed = self.curve.speeds(rows[:, 2])
        self.time = Integral(lambda s: 1 / self.speed(s), self.curve.marks)
        self.instants = self.time.marks
        self.duration = float(self.instants[-1])

    def __call__(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position, velocity and acceleration (n, 2) at times (n,)."""
        s = self.time.where(t)
        position, tangent, bend = self.curve(s)
        v, v_slope = self.speed(s)[:, None], self.speed(s, 1)[:, None]
        return position, v * tangent, v * v_slope * tangent + v**2 * bend

    def fitted(self, pieces: int) -> Waypoints:
        """The path as so many pieces of equal duration."""
        knots = self(np.linspace(0, self.duration, pieces + 1))
        table, duration = quintics(*knots, self.duration / pieces), np.asarray(self.duration)
        return Waypoints(points=self.rows, coefficients=table, duration=duration, closed=self.closed)

    def close_to(self, path: Waypoints) -> bool:
        """Whether a path is near enough: at its points, and between its knots."""
        knots = np.linspace(0, self.duration, len(path.coefficients) + 1)
        t = np.r_[self.instants, (knots[:-1] + knots[1:]) / 2]
        wanted, found = self(t), path._rates(t)
        off, slip = (np.linalg.norm(a - b, axis=1) for a, b in zip(wanted[:2], found[:2], strict=True))
        return bool(off.max() <= OFF * self.size and np.all(slip <= SLOW * np.linalg.norm(wanted[1], axis=1)))

    def sharpest(self) -> tuple[np.ndarray, float]:
        """Where it turns or turns back most, (2,) [m], and about how fast [rad/s]."""
        arc, curve = self.curve.arc, self.curve.curve
        p, s = arc.grid, arc.values
        bend = np.linalg.norm(curve(p, 2), axis=1) / np.sum(curve(p, 1) ** 2, axis=1)
        turn = np.nan_to_num(bend * self.speed(s), nan=np.inf)
        return curve(p[np.argmax(turn)]), float(turn.max())
