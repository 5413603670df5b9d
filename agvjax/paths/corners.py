"""Straight lines between points, their corners rounded by arcs, as legs of a route; on the host."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jax.typing import ArrayLike

from .laying import Laid, Leg
from .points import signed
from .stops import stops

OFF = 1e-5  # m that the pieces may be off: the curvature jumps where lines and arcs meet
STRAIGHT = 1e-9  # rad, a corner that is none
BACK = np.radians(170.0)  # a corner from which on a vehicle turns back and does not turn round


class Part(NamedTuple):
    """A line or an arc."""

    begin: np.ndarray  # (2,) m
    heading: float  # rad, of travel where it begins
    curvature: float  # 1/m
    length: float  # m
    line: int  # to which it belongs; an arc to the line after it
    back: bool = False  # whether the vehicle has turned back before it


class Lines:
    """Lines and arcs in a row, by arc length."""

    def __init__(self, parts: Sequence[Part], speeds: np.ndarray):
        self.begins = np.array([part.begin for part in parts])
        self.headings, self.curvatures = (np.array([part[k] for part in parts]) for k in (1, 2))
        self.marks = np.r_[0, np.cumsum([part.length for part in parts])]
        self.speeds = speeds[[part.line for part in parts]]

    def _part(self, s: np.ndarray) -> np.ndarray:
        return np.clip(np.searchsorted(self.marks, s, "right") - 1, 0, len(self.begins) - 1)

    def __call__(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position, unit tangent and its rate (n, 2) at arc lengths (n,)."""
        k = self._part(s)
        way, curvature, heading = s - self.marks[k], self.curvatures[k], self.headings[k]
        half = curvature * way / 2
        chord = way * np.sinc(half / np.pi)
        toward = heading + half
        position = self.begins[k] + chord[:, None] * np.stack([np.cos(toward), np.sin(toward)], axis=1)
        tangent = np.stack([np.cos(heading + 2 * half), np.sin(heading + 2 * half)], axis=1)
        return position, tangent, curvature[:, None] * np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)

    def speed(self, s: np.ndarray) -> np.ndarray:
        """That of the line [m/s]."""
        return self.speeds[self._part(s)]


def corners(
    points: ArrayLike,
    speed: ArrayLike | None,
    closed: bool,
    radius: float | None,
    tolerance: float | None,
    dwell: ArrayLike = 0.0,
) -> Laid:
    """Lines between points, rounded, as a route; see `Route.corners`."""
    if (radius is None) == (tolerance is None):
        raise ValueError(f"one of radius and tolerance must be given; got {radius} and {tolerance}")
    name, value = ("tolerance", tolerance) if radius is None else ("radius", radius)
    if value is None or not (np.isfinite(value) and value > 0):
        raise ValueError(f"{name} must be finite and > 0; got {value}")
    points, speed, halts = stops(points, speed, dwell, closed, _back)
    points, speeds = signed(points, speed, least=3 if closed else 2)
    parts = _parts(points, closed, radius, tolerance)
    cuts = [0, *(i for i, part in enumerate(parts) if part.back), len(parts)]
    legs = []
    for first, last in itertools.pairwise(cuts):
        signs = np.sign(speeds[[part.line for part in parts[first:last]]])
        turned, rule = signs != signs[0], "where the lines turn back, by more than 170 degrees"
        if turned.any():
            place = _at(points, parts, first + int(turned.argmax()))
            raise ValueError(f"speed must change its sign only {rule}; not {place}")
        if legs and signs[0] == legs[-1].sign:
            raise ValueError(f"speed must change its sign {rule}; it keeps it {_at(points, parts, first)}")
        lines = Lines(parts[first:last], np.abs(speeds))
        ends = halts.get(parts[last].line, 0.0) if last < len(parts) else 0.0
        leg = Leg(lines, float(lines.marks[-1]), lines.speed, OFF, signs[0], dwell=ends)
        legs += leg.cut(_within(parts, first, lines.marks, halts))
    return Laid(legs, closed)


def _at(points: np.ndarray, parts: Sequence[Part], number: int) -> str:
    """Where the line of a part begins, in words."""
    line = parts[number].line
    return f"at point number {line + 1} ({points[line, 0]:.6g}, {points[line, 1]:.6g})"


def _back(points: np.ndarray, number: int) -> bool:
    """Whether lines turn back at a point."""
    return bool(abs(_turns(np.diff(points[:, :2], axis=0))[number]) > BACK)


def _turns(edges: np.ndarray) -> np.ndarray:
    """By how much [rad] the way turns before each line (N,), before the first one from the last."""
    angles = np.arctan2(edges[:, 1], edges[:, 0])
    return (angles - np.roll(angles, 1) + np.pi) % (2 * np.pi) - np.pi


def _within(parts: Sequence[Part], first: int, marks: np.ndarray, halts: Mapping[int, float]) -> dict[float, float]:
    """Where [m] on the parts of a leg from the `first` on it stops and how long: where a line begins, or in its arc."""
    found: dict[float, float] = {}
    for point, time in halts.items():  # of a line that the arc at its end takes, that arc begins where the line does
        i, part = next((i, part) for i, part in enumerate(parts) if part.line >= point)
        within = part.length / 2 if part.curvature and part.line == point else 0.0
        if first <= i < first + len(marks) - 1 and marks[i - first] + within > 0:
            found[float(marks[i - first]) + within] = time
    return found


def _parts(points: np.ndarray, closed: bool, radius: float | None, tolerance: float | None) -> list[Part]:
    """Lines and arcs in order; of a closed way the arc at its first point comes last."""
    edges = np.diff(np.r_[points, points[:1]] if closed else points, axis=0)
    lengths, angles = np.linalg.norm(edges, axis=1), np.arctan2(edges[:, 1], edges[:, 0])
    if np.any(lengths == 0):
        j = int(np.argmin(lengths)) + 1
        closes = "; a closed path needs no repetition of its first point" if j == len(points) else "; leave one out"
        raise ValueError(
            f"points must differ from the one before; number {j} and number {j % len(points) + 1} are equal{closes}"
        )
    units, n = edges / lengths[:, None], len(edges)
    turns = _turns(edges)
    if not closed:
        turns[0] = 0.0
    elif np.any(np.abs(turns) > BACK):
        raise ValueError("points of a closed route must not turn back: it would have to do so for ever")
    bends = np.where((np.abs(turns) < STRAIGHT) | (np.abs(turns) > BACK), 0.0, np.abs(turns))
    radii = _radii(bends, lengths, radius, tolerance)
    taken = radii * np.tan(bends / 2)  # of the lines on either side of each arc
    parts = []
    for j in range(n):
        after = taken[(j + 1) % n] if closed or j < n - 1 else 0.0
        straight = lengths[j] - taken[j] - after
        back = bool(abs(turns[j]) > BACK)
        if straight > 1e-12 * lengths[j] or back:
            parts.append(Part(points[j] + units[j] * taken[j], angles[j], 0.0, straight, j, back))
        k = (j + 1) % n
        if after > 0:
            begin = points[j + 1 if j + 1 < len(points) else 0] - units[j] * after
            parts.append(Part(begin, angles[j], np.sign(turns[k]) / radii[k], abs(turns[k]) * radii[k], k))
    return parts


def _radii(bends: np.ndarray, lengths: np.ndarray, radius: float | None, tolerance: float | None) -> np.ndarray:
    """Of the arcs before each line [m], which turns by `bends` [rad] there; 0 where it does not."""
    half = np.tan(bends / 2)
    if tolerance is not None:
        share = lengths / np.where(bends * np.roll(bends, -1) > 0, 2, 1)  # of a line with arcs at both ends each half
        room = np.minimum(share, np.roll(share, 1))
        with np.errstate(divide="ignore"):
            wanted = np.minimum(tolerance / (1 / np.cos(bends / 2) - 1), room / half)
        return np.where(bends > 0, wanted, 0.0)
    radii = np.where(bends > 0, float(radius or 0), 0.0)
    taken = radii * half
    over = taken + np.roll(taken, -1) > lengths * (1 + 1e-9)
    if over.any():
        j = int(np.argmax(over))
        raise ValueError(
            f"radius must leave room on every line; {radius:g} m takes {taken[j] + np.roll(taken, -1)[j]:.4g} m of the"
            f" {lengths[j]:.4g} m from point number {j + 1} on"
        )
    return radii
