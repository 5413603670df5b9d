"""NumPy over the batch: every operation on all scenarios at once, the large arrays allocated once."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from . import constants as c

# rows of the state
POSITION, VELOCITY, PSI, F, G, XI, BETA = (
    slice(0, 2),
    slice(2, 4),
    4,
    slice(5, 7),
    slice(7, 9),
    slice(9, 11),
    slice(11, 13),
)
VARPHI, BETA_PSI, VARPHI_PSI = 13, 14, 15


def contestant(values: Mapping[str, np.ndarray], *, dt: float, n_steps: int, dtype: str) -> Callable[[], np.ndarray]:
    """RK4 on the states of all scenarios, shape (16, B)."""
    start = np.ascontiguousarray(c.start(values).T, dtype)
    table = c.tabulate(dt, n_steps, dtype)
    derivative = _closed_loop(np.ascontiguousarray(c.parameters(values).T, dtype))
    d, weighted, moved = np.empty_like(start), np.empty_like(start), np.empty_like(start)

    def run() -> np.ndarray:
        state = start.copy()
        total = derivative(d, state, table[0]) * -0.5  # the trapezoid: half of either end
        for k in range(0, 2 * n_steps, 2):
            total += derivative(d, state, table[k])
            weighted[:] = d
            for h, row, weight in ((dt / 2, k + 1, 2), (dt / 2, k + 1, 2), (dt, k + 2, 1)):
                np.multiply(d, h, out=moved)
                np.add(moved, state, out=moved)
                derivative(d, moved, table[row])
                np.multiply(d, weight, out=moved)
                np.add(weighted, moved, out=weighted)
            np.multiply(weighted, dt / 6, out=weighted)
            np.add(state, weighted, out=state)
        total += derivative(d, state, table[-1]) * 0.5
        return np.sqrt(total / n_steps)

    return run


def _closed_loop(parameters: np.ndarray) -> Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]:
    """A function that writes the derivatives of a state into its first argument and returns the squared error."""
    position, heading, amplitude = parameters[0:4], parameters[4:8], parameters[8]
    centers = np.array(c.CENTERS, parameters.dtype)[:, None]
    nodes = np.empty((2, len(centers), parameters.shape[1]), parameters.dtype)  # of the position, of the heading
    square, energies = np.empty_like(nodes[0]), np.empty_like(nodes[:, 0])

    def derivative(d: np.ndarray, s: np.ndarray, row: np.ndarray) -> np.ndarray:
        pair = row[:4, None]
        velocity, psi_d, psi_d_rate, push = s[VELOCITY], row[4], row[5], row[6]
        z1 = np.subtract(s[POSITION], pair[:2], out=d[BETA])
        z3 = np.subtract(s[PSI], psi_d, out=d[BETA_PSI])
        z3 -= 2 * math.pi * np.rint(z3 * (1 / (2 * math.pi)))
        filtering = s[F] - pair[2:] + c.K1 * z1 + c.LAM * s[BETA]
        z2 = velocity - s[F]  # xi2 is 0 for good
        np.subtract(velocity[0], centers, out=nodes[0])
        np.subtract(velocity[1], centers, out=square)
        np.subtract(s[PSI], centers, out=nodes[1])
        np.multiply(nodes, nodes, out=nodes)
        np.multiply(square, square, out=square)
        nodes[0] += square
        np.multiply(nodes, -2 / c.WIDTH, out=nodes)
        np.exp(nodes, out=nodes)
        np.sum(nodes, axis=1, out=energies)
        energy, energy_psi = energies[0] * (1 / (2 * c.B1**2)), energies[1] * (1 / (2 * c.B2**2))
        delta = amplitude * push
        np.multiply(s[G], c.OMEGA_N, out=d[F])
        omega = psi_d_rate - (c.K3 + s[VARPHI_PSI] * energy_psi) * z3 - c.LAM_PSI * s[BETA_PSI]
        omega = _deadzone(omega, heading)
        d[POSITION] = velocity
        np.add(_deadzone(d[F] - (c.K2 + s[VARPHI] * energy) * z2, position), delta, out=d[VELOCITY])
        d[2] -= omega * velocity[1]
        d[3] += omega * velocity[0]
        np.add(omega, delta, out=d[PSI])
        np.subtract(s[G] * (-2 * c.ZETA * c.OMEGA_N), c.OMEGA_N * filtering, out=d[G])
        np.subtract(filtering, c.K1 * s[XI], out=d[XI])
        np.subtract(c.GAMMA1 * energy * (z2[0] * z2[0] + z2[1] * z2[1]), c.ETA1 * s[VARPHI], out=d[VARPHI])
        square_psi = z3 * z3
        np.subtract(c.GAMMA2 * energy_psi * square_psi, c.ETA2 * s[VARPHI_PSI], out=d[VARPHI_PSI])
        return z1[0] * z1[0] + z1[1] * z1[1] + square_psi

    return derivative


def _deadzone(u: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    right, left, from_right, from_left = numbers
    return right * np.maximum(u - from_right, 0) + left * np.minimum(u + from_left, 0)
