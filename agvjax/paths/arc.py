"""Lengths along curves, on the host in float64: integrals by Gauss' rule, and splines through points by arc length."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

PARTS = 8  # of a segment between two points, on which integrals are taken by Gauss' rule; halved where that is too few
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)


def gauss(rate: Callable[[np.ndarray], np.ndarray], left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """The integrals of `rate` over intervals."""
    half = (right - left) / 2
    return half * (rate(left[..., None] + half[..., None] * (1 + NODES)) @ WEIGHTS)


class Integral:
    """The integral of a positive rate from the first of some grid points on, and the way back."""

    def __init__(self, rate: Callable[[np.ndarray], np.ndarray], marks: np.ndarray):
        shares = np.arange(PARTS) / PARTS
        grid = np.r_[(marks[:-1, None] + np.diff(marks)[:, None] * shares).ravel(), marks[-1]]
        for _ in range(30):
            middle = (grid[:-1] + grid[1:]) / 2
            halves = gauss(rate, grid[:-1], middle) + gauss(rate, middle, grid[1:])
            rough = np.abs(gauss(rate, grid[:-1], grid[1:]) - halves) > 1e-13 * np.sum(halves)
            if not rough.any():
                break
            grid = np.sort(np.r_[grid, middle[rough]])
        self.rate, self.grid = rate, grid
        self.values = np.r_[0, np.cumsum(gauss(rate, grid[:-1], grid[1:]))]
        self.marks = self.values[np.searchsorted(grid, marks)]

    def where(self, wanted: np.ndarray) -> np.ndarray:
        """Where it reaches what is wanted: Newton's method within one interval of the grid."""
        j = np.clip(np.searchsorted(self.values, wanted, "right") - 1, 0, self.grid.size - 2)
        left, right = self.grid[j], self.grid[j + 1]
        beyond = wanted - self.values[j]
        x = left + beyond / (self.values[j + 1] - self.values[j]) * (right - left)
        for _ in range(6):
            x = np.clip(x - (gauss(self.rate, left, x) - beyond) / self.rate(x), left, right)
        return x


class Spline:
    """The cubic spline through points (N, 2) over the length of the chords, periodic where closed, by arc length."""

    def __init__(self, points: np.ndarray, closed: bool):
        from scipy.interpolate import CubicSpline  # late: a second that few runs need

        loop = np.r_[points, points[:1]] if closed else points
        chords = np.r_[0, np.cumsum(np.linalg.norm(np.diff(loop, axis=0), axis=1))]
        self.curve = CubicSpline(chords, loop, bc_type="periodic" if closed else "not-a-knot")
        self.arc = Integral(lambda p: np.linalg.norm(self.curve(p, 1), axis=-1), chords)
        self.marks = self.arc.marks  # m, where the points lie, and of a closed one the first once more

    def __call__(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position, unit tangent and its rate (n, 2) at arc lengths (n,) [m]."""
        p = self.arc.where(s)
        first, second = self.curve(p, 1), self.curve(p, 2)
        length = np.linalg.norm(first, axis=1, keepdims=True)
        tangent = first / length
        bend = (second - tangent * np.sum(second * tangent, axis=1, keepdims=True)) / length**2
        return self.curve(p), tangent, bend

    def speeds(self, speed: np.ndarray) -> Any:
        """Speeds (N,) given at the points, as a monotone cubic (PCHIP) over the arc length."""
        from scipy.interpolate import PchipInterpolator

        marks = self.marks
        if len(marks) > len(speed):  # two neighbours on either side are all that the slopes at the seam look at
            marks = np.r_[marks[-3:-1] - marks[-1], marks, marks[-1] + marks[1:3]]
            speed = np.r_[speed[-2:], speed, speed[:1], speed[1:3]]
        return PchipInterpolator(marks, speed)


def quintics(position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray, h: float) -> np.ndarray:
    """Pieces (M, 6, 2), each `h` long, that meet the M + 1 knots in value, first and second derivative.

    The coefficients are of the powers of the share of a piece, from the constant on.
    """
    p, q = position[:-1], position[1:]
    v, w = velocity[:-1] * h, velocity[1:] * h
    a, b = acceleration[:-1] * (h * h), acceleration[1:] * (h * h)
    # what the Taylor polynomial of the left knot leaves at the right one
    gap, slope, bend = q - p - v - a / 2, w - v - a, b - a
    rest = [10 * gap - 4 * slope + bend / 2, -15 * gap + 7 * slope - bend, 6 * gap - 3 * slope + bend / 2]
    return np.stack([p, v, a / 2, *rest], axis=1)
