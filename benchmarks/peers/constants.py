"""The default loop in numbers: gains, what differs between scenarios, and what depends on time alone."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np

K1, K2, K3 = 20.0, 20.0, 12.0
LAM, LAM_PSI = 16.0, 9.0
OMEGA_N, ZETA = 90.0, 0.75
GAMMA1, GAMMA2 = 0.1, 0.1
ETA1, ETA2 = 0.001, 0.001
B1, B2 = 1.0, 1.0
CENTERS, WIDTH = (-3.0, -1.5, 0.0, 1.5, 3.0), 0.5
PATH_RATE = 22 / 7 / 6  # rad/s, 22/7 as printed
DISTURBANCE_RATE = 0.5  # rad/s
START_VELOCITY = (0.1, 0.1)
START_ESTIMATE = 0.1

# x, y, their rates, heading, command filter (2 + 2), compensator, integral of the position error, estimate of the
# position network, integral of the heading error, estimate of the heading network
STATES = "x y vx vy psi fx fy gx gy xi_x xi_y beta_x beta_y varphi beta_psi varphi_psi".split()
SIGNALS = "x_d y_d x_d_rate y_d_rate psi_d psi_d_rate push".split()
DEADZONE = ("slope_right", "slope_left", "threshold_right", "threshold_left")
PARAMETERS = [
    *(f"deadzone.{a}.{b}" for a, b in itertools.product(("position", "heading"), DEADZONE)),
    "disturbance.amplitude",
]


def parameters(values: Mapping[str, np.ndarray]) -> np.ndarray:
    """One row per scenario, columns as in `PARAMETERS`, shape (B, 9)."""
    return np.stack([values[name] for name in PARAMETERS], axis=1)


def start(values: Mapping[str, np.ndarray]) -> np.ndarray:
    """State at t = 0, columns as in `STATES`, shape (B, 16); the filter starts at its input."""
    position = values["start.position"]
    states = np.zeros((len(position), len(STATES)))
    states[:, 0:2], states[:, 2:4], states[:, 4] = position, START_VELOCITY, values["start.heading"]
    states[:, 5:7] = -K1 * position + np.array([2 * PATH_RATE, PATH_RATE])  # the path leaves the origin
    states[:, 13] = states[:, 15] = START_ESTIMATE
    return states


def signals(t: Any, xp: Any = np) -> tuple[Any, ...]:
    """What depends on time alone, as in `SIGNALS`; `xp` is any module with sin, cos and atan2."""
    sine, cosine = xp.sin(PATH_RATE * t), xp.cos(PATH_RATE * t)
    return (
        xp.sin(2 * PATH_RATE * t),
        sine,
        2 * PATH_RATE * xp.cos(2 * PATH_RATE * t),
        PATH_RATE * cosine,
        xp.atan2(1.0, 2 * cosine),
        2 * PATH_RATE * sine / (1 + 4 * cosine * cosine),
        xp.cos(DISTURBANCE_RATE * t),
    )


def tabulate(dt: float, n_steps: int, dtype: str) -> np.ndarray:
    """The signals every half step, shape (2 n_steps + 1, 7): step k reads rows 2k, 2k + 1 and 2k + 2.

    Part of the preparation, so a peer that reads the table does not pay for it.
    """
    table = np.stack(signals(dt / 2 * np.arange(2 * n_steps + 1)), axis=1)
    return np.ascontiguousarray(table, dtype)
