"""Headings: of quaternions, as ROS and Autoware write where a vehicle looks, and without leaps of a whole turn."""

from __future__ import annotations

import numpy as np

UNIT = 0.05  # by which the length of a quaternion may differ from 1, for its digits


def of_quaternions(parts: np.ndarray) -> np.ndarray:
    """The angle [rad] from the x axis towards the y axis at which the vehicle's own x axis lies in the plane.

    Args:
        parts: x, y, z, w of N quaternions (N, 4), or z and w alone (N, 2) of what only turns in the plane.

    Returns:
        Angles (N,) within half a turn; NaN where a part is.

    Raises:
        ValueError: the numbers are no quaternions, whose squares add up to 1; it says the row, counted from 1.
    """
    x, y, z, w = parts.T if parts.shape[1] == 4 else (0.0, 0.0, *parts.T)
    length = np.sqrt(np.sum(parts**2, axis=1))
    wrong = np.abs(length - 1) > UNIT
    if wrong.any():
        at = int(np.argmax(wrong))
        more = "" if parts.shape[1] == 4 else ", or all four of them where the vehicle tilts"
        rule = f"the squares of a quaternion must add up to 1, not to {length[at] ** 2:.4g}{more}"
        raise ValueError(f"row {at + 1} below the header: {rule}")
    return np.arctan2(2 * (w * z + x * y), w**2 + x**2 - y**2 - z**2)


def unwrapped(heading: np.ndarray) -> np.ndarray:
    """Headings (N,) [rad] without the leaps of a whole turn that the range of an angle makes; NaN stays NaN."""
    whole, fine = heading.copy(), np.isfinite(heading)
    whole[fine] = np.unwrap(heading[fine])
    return whole
