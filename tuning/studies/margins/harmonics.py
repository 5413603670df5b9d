"""The balance of all harmonics of a limit cycle, from what a describing function says of the first one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import root

from .describing import Way, settled

HARMONICS = 9
POINTS = 512  # of a period
FAR = 2.0  # by what factor amplitude and frequency may differ from the first guess


def balanced(
    way: Way,
    ratio: Callable[[np.ndarray], np.ndarray],
    rest: tuple[float, float],
    guess: tuple[float, float, float],
    fastest: float,
) -> tuple[float, float, float] | None:
    """Mean, half of the range, and frequency [rad/s] of a limit cycle at the input of a way; None where none is found.

    u_k + ratio(k w) y_k = 0 for k = 1 .. HARMONICS, (1 - share) u_0 + share y_0 = level, y_k the harmonics of what is
    delivered of u. The first harmonic has the phase 0.

    Args:
        way: between the law and what is delivered.
        ratio: the loop's frequency response for what is delivered, negative feedback.
        rest: level and share.
        guess: mean, amplitude and frequency [rad/s] by a describing function.
        fastest: half the sampling frequency [rad/s]; harmonics beyond it do not count.

    Source: Gelb and Vander Velde, 1968, sec. 3.4; Khalil, Nonlinear Systems, 3rd ed., sec. 7.2 (harmonic balance).
    """
    mean, amplitude, omega = guess
    orders = np.arange(1, max(1, min(HARMONICS, int(0.9 * fastest / omega))) + 1)
    count, waves = len(orders), np.exp(2j * np.pi / POINTS * np.outer(orders, np.arange(POINTS)))

    def course(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        parts = amplitude * (np.append(x[1], x[3 : 2 + count]) + 1j * np.append(0.0, x[2 + count :]))
        return parts, amplitude * x[0] + np.real(parts @ waves)

    def missing(x: np.ndarray) -> np.ndarray:
        parts, u = course(x)
        y = settled(way, u)
        found = parts + ratio(omega * x[2] * orders) * 2 * (y @ np.conj(waves).T) / POINTS
        slow = (1 - rest[1]) * amplitude * x[0] + rest[1] * y.mean() - rest[0]
        return np.concatenate([[slow], found.real, found.imag]) / amplitude

    solved = root(missing, [mean / amplitude, 1.0, 1.0, *[0.0] * (2 * count - 2)], options={"eps": 1e-4})
    if np.max(np.abs(solved.fun)) >= 1e-3 or not all(1 / FAR < x < FAR for x in solved.x[1:3]):
        return None
    return float(amplitude * solved.x[0]), float(np.ptp(course(solved.x)[1]) / 2), float(omega * solved.x[2])
