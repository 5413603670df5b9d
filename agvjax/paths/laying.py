"""How a route is laid, on the host in float64: legs as curves by arc length, cut into pieces of equal length."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from ..protocols import Path
from . import profile
from .arc import Integral, Spline, quintics
from .points import checked, numbers, signed
from .profile import SpeedLimits
from .stops import stops

BLOCK = 4096  # instants at which a path is looked at together
COARSE = 100.0  # times the usual deviation, that as many pieces as there may be are still taken with
FEWEST, MOST = 64, 2**16  # pieces of a leg to begin with; pieces beyond which the fit is given up
OFF_SQUARE, SLOW = 1e-4, 4096  # of squared speed, linear over a piece; pieces from which on a jump of it is let be
OFF = 1e-9  # how far off the pieces may be of the route's size

Curve = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]  # arc length -> position, tangent, its rate


@dataclasses.dataclass
class Leg:
    """A part of a route that is driven in one direction.

    Attributes:
        curve: position, unit tangent of travel and its rate at arc lengths from the leg's beginning.
        length: m.
        speed: at arc lengths [m/s], > 0.
        off: how far off [m] its pieces may be.
        sign: 1 forwards, -1 backwards.
        marks: where [m] the points lie that it was laid through, of a closed one the first once more.
        dwell: how long [s] a vehicle stands where it ends.
    """

    curve: Curve
    length: float
    speed: Callable[[np.ndarray], np.ndarray]
    off: float
    sign: float = 1.0
    marks: np.ndarray | None = None
    dwell: float = 0.0

    def cut(self, stops: Mapping[float, float]) -> list[Leg]:
        """Its parts between stops on the way, by where they are [m]: how long [s] each lasts."""
        bounds = [0.0, *sorted(stops), self.length]
        return [self._part(first, last, stops.get(last, self.dwell)) for first, last in itertools.pairwise(bounds)]

    def _part(self, first: float, last: float, dwell: float) -> Leg:
        marks = None if self.marks is None else self.marks - first
        part = dataclasses.replace(self, length=last - first, marks=marks, dwell=dwell)
        part.curve, part.speed = (lambda s: self.curve(s + first)), (lambda s: self.speed(s + first))
        return part

    def pieces(self) -> np.ndarray:
        """Pieces (n, 6, 2) of equal length that are near enough.

        Raises:
            ValueError: none of as many as there may be are.
        """
        n = FEWEST
        while n <= MOST:
            knots = np.linspace(0, self.length, n + 1)
            table = quintics(*self.curve(knots), self.length / n)
            middle = np.tensordot(table, 0.5 ** np.arange(6), axes=(1, 0))
            halfway = (knots[1:] + knots[:-1]) / 2
            square, between = self.speed(knots) ** 2, self.speed(halfway) ** 2
            slow = np.abs((square[1:] + square[:-1]) / 2 - between).max() <= OFF_SQUARE * between.max() or n >= SLOW
            off = np.linalg.norm(middle - self.curve(halfway)[0], axis=1).max()
            if slow and off <= self.off * (1 if n < MOST else COARSE):
                return table
            n *= 2
        raise ValueError("the path turns too suddenly for its length: it cannot be followed by arc length")


@dataclasses.dataclass
class Laid:
    """The legs of a route."""

    legs: Sequence[Leg]
    closed: bool
    points: int = 0  # it was given by so many; 0: by a curve

    def tables(self, limits: SpeedLimits, half_width: ArrayLike) -> dict[str, np.ndarray]:
        """The arrays of a `Route`."""
        tables, lows, changes, times, heads, begin, first = [], [], [], [], [], 0.0, 0
        for i, leg in enumerate(self.legs):
            table = leg.pieces()
            n, h = len(table), leg.length / len(table)
            square = self._squares(i, leg, n, limits)
            root = np.sqrt(square)
            tables.append(table.transpose(2, 1, 0).reshape(12, n))
            lows.append(square[:-1])
            changes.append(np.diff(square))
            with np.errstate(divide="ignore"):
                times.append(2 * h / (root[:-1] + root[1:]))
            times[-1][-1] += leg.dwell
            heads.append((begin, 1 / h, first, leg.sign, leg.dwell))
            begin, first = begin + leg.length, first + n
        instants = np.r_[0, np.cumsum(np.concatenate(times))]
        if not np.isfinite(instants[-1]):
            raise ValueError("limits leave no speed to a part of the route that is too short for them")
        arrays = {"table": np.concatenate(tables, axis=1), "legs": np.array(heads).T, "length": np.asarray(begin)}
        arrays |= {"squares": np.stack([np.concatenate(lows), np.concatenate(changes)]), "instants": instants}
        if np.any(half_width):
            arrays["half_widths"] = self._corridor(half_width, [len(low) for low in lows])
        return arrays

    def _squares(self, i: int, leg: Leg, n: int, limits: SpeedLimits) -> np.ndarray:
        knots = np.linspace(0, leg.length, n + 1)
        tangent, bend = leg.curve(knots)[1:]
        curvature = tangent[:, 0] * bend[:, 1] - tangent[:, 1] * bend[:, 0]
        given = leg.speed(knots)
        if self.closed:
            return profile.around(given, curvature, leg.length / n, limits)
        last = i == len(self.legs) - 1
        stands = i > 0, not last or limits.stop
        return profile.squares(given, curvature, leg.length / n, limits, stands)

    def _corridor(self, half_width: ArrayLike, pieces: Sequence[int]) -> np.ndarray:
        """Left and right (4, n) at the beginning of each piece, and their changes; those of points by arc length."""
        given = numbers("half_width", half_width)
        if not np.all(np.isfinite(given)) or np.any(given < 0):
            raise ValueError(f"half_width must be finite and >= 0; got {given.min():g}")
        if given.shape in ((), (2,)):
            left, right = np.broadcast_to(given, (2,))
            ones = np.ones(sum(pieces))
            return np.stack([left * ones, 0 * ones, right * ones, 0 * ones])
        rows = np.r_[given, given[:1]] if self.closed and given.ndim else given
        marks = [leg.marks for leg in self.legs]
        if given.shape != (self.points, 2) or any(mark is None or len(mark) != len(rows) for mark in marks):
            raise ValueError(
                f"half_width must be a number, left and right, or both for each of the points of a spline that is"
                f" driven one way; its shape is {given.shape}"
            )
        parts = []
        for leg, n in zip(self.legs, pieces, strict=True):
            knots = np.linspace(0, leg.length, n + 1)
            left, right = (np.interp(knots, np.asarray(leg.marks), column) for column in rows.T)
            parts.append([left[:-1], np.diff(left), right[:-1], np.diff(right)])
        return np.concatenate(parts, axis=1)


class _Timed:
    """A path by arc length that is given by time."""

    def __init__(self, path: Path, end: float, faster: float):
        def rates(t: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
            def motion(time: jax.Array) -> tuple[jax.Array, jax.Array]:
                return jax.jvp(path, (time,), (jnp.ones_like(time),))

            (position, velocity), (_, acceleration) = jax.jvp(motion, (t,), (jnp.ones_like(t),))
            return position, velocity, acceleration

        self.rates, self.faster = jax.jit(jax.vmap(rates)), faster
        self.arc = Integral(self._pace, np.linspace(0, end, FEWEST + 1))

    def _at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        flat, parts = t.ravel(), []
        for first in range(0, flat.size, BLOCK):
            block = np.resize(flat[first : first + BLOCK], BLOCK)  # of one size: another would be compiled anew
            parts.append([np.asarray(x, float) for x in self.rates(jnp.asarray(block, jnp.result_type(float)))])
        found = [np.concatenate(part)[: flat.size].reshape(*t.shape, 2) for part in zip(*parts, strict=True)]
        return found[0], found[1], found[2]

    def _pace(self, t: np.ndarray) -> np.ndarray:
        return np.linalg.norm(self._at(t)[1], axis=-1)

    def __call__(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position, unit tangent and its rate."""
        position, velocity, acceleration = self._at(self.arc.where(s))
        pace = np.linalg.norm(velocity, axis=-1, keepdims=True)
        tangent = velocity / pace
        bend = (acceleration - tangent * np.sum(acceleration * tangent, -1, keepdims=True)) / pace**2
        return position, tangent, bend

    def speed(self, s: np.ndarray) -> np.ndarray:
        """The path's own [m/s], times what was asked for."""
        return self.faster * self._pace(self.arc.where(s))


def along(path: Path, until: float | None, faster: float = 1.0) -> Laid:
    """A path as a route; see `Route.along`."""
    lap, end = path.lap(), path.end()
    closed = until is None and lap is not None
    end = until if until is not None else lap if lap is not None else end
    if not (np.isfinite(end) and end > 0):
        raise ValueError(f"until must be given, finite and > 0, for a path without lap or end; got {until}")
    t = np.linspace(0, end, 257)
    curve = _Timed(path, end, faster)
    position, velocity, _ = curve._at(t)
    pace = np.linalg.norm(velocity, axis=1)
    if not np.all(np.isfinite(pace)) or np.any(pace <= 1e-9 * pace.max()):
        raise ValueError(f"the path must move; at t = {t[np.argmin(np.nan_to_num(pace, nan=-1))]:.4g} s it stands")
    off = max(OFF, 4 * float(jnp.finfo(jnp.result_type(float)).eps)) * float(np.linalg.norm(np.ptp(position, axis=0)))
    return Laid([Leg(curve, float(curve.arc.values[-1]), curve.speed, off)], closed)


def through(points: ArrayLike, speed: ArrayLike | None, closed: bool, dwell: ArrayLike = 0.0) -> Laid:
    """A spline through points as a route; see `Route.through`."""
    points, speed, halts = stops(points, speed, dwell, closed)
    points, speeds = signed(points, speed)
    signs = np.sign(speeds)
    if closed and np.any(signs != signs[0]):
        raise ValueError("speed must have one sign on a closed route: it cannot turn back for ever")
    turns = np.flatnonzero(signs[1:] != signs[:-1]) + 1
    if len(points) - 1 in turns:
        raise ValueError(
            f"speed must not change its sign at the last point, where nothing follows; it is {speeds[-1]:g}"
        )
    bounds = [0, *(int(k) for k in turns), len(points) - 1]
    legs = []
    for first, last in itertools.pairwise(bounds):
        rows = checked(points[first : last + 1], np.abs(speeds[first : last + 1]), closed)
        spline = Spline(rows[:, :2], closed)
        off = OFF * float(np.linalg.norm(np.ptp(rows[:, :2], axis=0)))
        speeding, length = spline.speeds(rows[:, 2]), float(spline.marks[-1])
        leg = Leg(spline, length, speeding, off, signs[first], spline.marks, halts.get(last, 0.0))
        legs += leg.cut({float(spline.marks[k - first]): time for k, time in halts.items() if first < k < last})
    return Laid(legs, closed, len(points))
