"""A path through given points at given speeds: a smooth curve, fitted on the host and looked up by time."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from .._pytree import POSITIVE, Numbers, Real, number, pytree, structure
from ..geometry import bearing
from ..protocols import Path
from .points import checked

Values = TypeVar("Values", Array, np.ndarray)
PARTS = 8  # of a segment between two points, on which integrals are taken by Gauss' rule; halved where that is too few
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
    `duration` runs the same path faster or slower.
    """

    points: Numbers  # (N, 3): x [m], y [m], speed [m/s]
    coefficients: Numbers  # (M, 6, 2) m, of the powers of the share of each of M pieces of equal duration
    duration: Real | np.ndarray = number(1.0, "s", POSITIVE)
    closed: bool = structure(False)

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
        steps = _gauss(lambda time: np.linalg.norm(self._rates(time)[1], axis=-1), t[:-1], t[1:])
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


def _quintics(position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray, h: float) -> np.ndarray:
    """Pieces (M, 6, 2), each `h` [s] long, that meet the M + 1 knots in value, first and second derivative."""
    p, q = position[:-1], position[1:]
    v, w = velocity[:-1] * h, velocity[1:] * h
    a, b = acceleration[:-1] * (h * h), acceleration[1:] * (h * h)
    # what the Taylor polynomial of the left knot leaves at the right one
    gap, slope, bend = q - p - v - a / 2, w - v - a, b - a
    rest = [10 * gap - 4 * slope + bend / 2, -15 * gap + 7 * slope - bend, 6 * gap - 3 * slope + bend / 2]
    return np.stack([p, v, a / 2, *rest], axis=1)


NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)


def _gauss(rate: Callable[[np.ndarray], np.ndarray], left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """The integrals of `rate` over intervals."""
    half = (right - left) / 2
    return half * (rate(left[..., None] + half[..., None] * (1 + NODES)) @ WEIGHTS)


class _Integral:
    """The integral of a positive rate from the first of some grid points on, and the way back."""

    def __init__(self, rate: Callable[[np.ndarray], np.ndarray], marks: np.ndarray):
        shares = np.arange(PARTS) / PARTS
        grid = np.r_[(marks[:-1, None] + np.diff(marks)[:, None] * shares).ravel(), marks[-1]]
        for _ in range(30):
            middle = (grid[:-1] + grid[1:]) / 2
            halves = _gauss(rate, grid[:-1], middle) + _gauss(rate, middle, grid[1:])
            rough = np.abs(_gauss(rate, grid[:-1], grid[1:]) - halves) > 1e-13 * np.sum(halves)
            if not rough.any():
                break
            grid = np.sort(np.r_[grid, middle[rough]])
        self.rate, self.grid = rate, grid
        self.values = np.r_[0, np.cumsum(_gauss(rate, grid[:-1], grid[1:]))]
        self.marks = self.values[np.searchsorted(grid, marks)]

    def where(self, wanted: np.ndarray) -> np.ndarray:
        """Where it reaches what is wanted: Newton's method within one interval of the grid."""
        j = np.clip(np.searchsorted(self.values, wanted, "right") - 1, 0, self.grid.size - 2)
        left, right = self.grid[j], self.grid[j + 1]
        beyond = wanted - self.values[j]
        x = left + beyond / (self.values[j + 1] - self.values[j]) * (right - left)
        for _ in range(6):
            x = np.clip(x - (_gauss(self.rate, left, x) - beyond) / self.rate(x), left, right)
        return x


class _Motion:
    """Where the path is, and how fast, by its definition: t -> arc length -> length of the chords -> position."""

    def __init__(self, rows: np.ndarray, closed: bool):
        from scipy.interpolate import CubicSpline, PchipInterpolator  # late: a second that few runs need

        self.rows, self.closed = rows, closed
        loop = np.r_[rows, rows[:1]] if closed else rows
        chords = np.r_[0, np.cumsum(np.linalg.norm(np.diff(loop[:, :2], axis=0), axis=1))]
        self.curve = CubicSpline(chords, loop[:, :2], bc_type="periodic" if closed else "not-a-knot")
        self.size = float(np.linalg.norm(np.ptp(rows[:, :2], axis=0)))
        self.arc = _Integral(lambda p: np.linalg.norm(self.curve(p, 1), axis=-1), chords)
        marks = self.arc.marks
        if closed:  # two neighbours on either side are all that the slopes at the seam look at
            marks = np.r_[marks[-3:-1] - marks[-1], marks, marks[-1] + marks[1:3]]
            loop = np.r_[loop[-3:-1], loop, loop[1:3]]
        self.speed = PchipInterpolator(marks, loop[:, 2])
        self.time = _Integral(lambda s: 1 / self.speed(s), self.arc.marks)
        self.instants = self.time.marks
        self.duration = float(self.instants[-1])

    def __call__(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position, velocity and acceleration (n, 2) at times (n,)."""
        s = self.time.where(t)
        p = self.arc.where(s)
        v, v_slope = self.speed(s)[:, None], self.speed(s, 1)[:, None]
        first, second = self.curve(p, 1), self.curve(p, 2)
        length = np.linalg.norm(first, axis=1, keepdims=True)
        tangent = first / length
        bend = (second - tangent * np.sum(second * tangent, axis=1, keepdims=True)) / length**2
        return self.curve(p), v * tangent, v * v_slope * tangent + v**2 * bend

    def fitted(self, pieces: int) -> Waypoints:
        """The path as so many pieces of equal duration."""
        knots = self(np.linspace(0, self.duration, pieces + 1))
        table, duration = _quintics(*knots, self.duration / pieces), np.asarray(self.duration)
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
        p, s = self.arc.grid, self.arc.values
        bend = np.linalg.norm(self.curve(p, 2), axis=1) / np.sum(self.curve(p, 1) ** 2, axis=1)
        turn = np.nan_to_num(bend * self.speed(s), nan=np.inf)
        return self.curve(p[np.argmax(turn)]), float(turn.max())
