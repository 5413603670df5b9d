"""Odometry into what the law measures: how a point ahead of the axle moves in the plane."""

from __future__ import annotations

import math

import numpy as np


def yaw(x, y, z, w):
    """The angle about the vertical [rad] of a quaternion, which need not be normalised.

    Raises ValueError where it is no rotation.
    """
    square = x * x + y * y + z * z + w * w
    if not 0.5 < square < 2.0:  # NaN too
        raise ValueError(f"the orientation ({x:g}, {y:g}, {z:g}, {w:g}) is no unit quaternion")
    return math.atan2(2 * (w * z + x * y), square - 2 * (y * y + z * z))


def unwrapped(angle, before):
    """The angle [rad], whole turns added, that is nearest to the one before; itself where there was none."""
    return angle if before is None else angle + 2 * math.pi * round((before - angle) / (2 * math.pi))


def measured(position, heading, speed, yaw_rate, L):
    """The measurement of the reference point, L [m] ahead of the axle, of a vehicle that does not slip sideways.

    `position` (2,) [m] and `heading` [rad] of the axle in the odometry's frame, `speed` [m/s] and `yaw_rate` [rad/s]
    in the vehicle's. Raises ValueError where one is not finite.
    """
    if not np.all(np.isfinite([*position, heading, speed, yaw_rate])):
        raise ValueError("a position or a speed is not finite")
    ahead = np.array([math.cos(heading), math.sin(heading)])
    aside = np.array([-ahead[1], ahead[0]])
    return {
        "position": np.asarray(position, float) + L * ahead,
        "velocity": speed * ahead + L * yaw_rate * aside,
        "heading": heading,
        "yaw_rate": yaw_rate,
    }
