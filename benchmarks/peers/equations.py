"""The closed loop of one scenario, for the tools that take it as ordinary scalar expressions."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from . import constants as c


def as_it_is(thing: Any) -> Any:
    """No conversion, no compilation."""
    return thing


def closed_loop(
    *,
    exp: Callable[[Any], Any],
    maximum: Callable[[Any, Any], Any],
    minimum: Callable[[Any, Any], Any],
    nearest: Callable[[Any], Any],
    number: Callable[[float], Any] = as_it_is,
    compiled: Callable[[Any], Any] = as_it_is,
) -> Callable[[Any, Any, Any], tuple[Any, Any]]:
    """A function of (state, signals, parameters) giving the 16 derivatives and the squared error.

    Args:
        exp: the exponential of the tool.
        maximum: of two numbers.
        minimum: of two numbers.
        nearest: rounds to the nearest integer.
        number: converts each constant, for tools that would promote float32.
        compiled: applied to every function, for tools that compile them.
    """
    k1, k2, k3, lam, lam_psi = map(number, (c.K1, c.K2, c.K3, c.LAM, c.LAM_PSI))
    omega_n, damping = number(c.OMEGA_N), number(2 * c.ZETA * c.OMEGA_N)
    gamma1, gamma2, eta1, eta2 = map(number, (c.GAMMA1, c.GAMMA2, c.ETA1, c.ETA2))
    share1, share2 = number(1 / (2 * c.B1**2)), number(1 / (2 * c.B2**2))
    centers, steepness = tuple(map(number, c.CENTERS)), number(-2 / c.WIDTH)
    turn, per_turn, zero = number(2 * math.pi), number(1 / (2 * math.pi)), number(0.0)

    @compiled
    def deadzone(u: Any, slope_right: Any, slope_left: Any, threshold_right: Any, threshold_left: Any) -> Any:
        return slope_right * maximum(u - threshold_right, zero) + slope_left * minimum(u + threshold_left, zero)

    @compiled
    def derivative(state: Any, signals: Any, parameters: Any) -> Any:
        x, y, vx, vy, psi, fx, fy, gx, gy, xi_x, xi_y, beta_x, beta_y, varphi, beta_psi, varphi_psi = state
        x_d, y_d, x_d_rate, y_d_rate, psi_d, psi_d_rate, push = signals
        right, left, from_right, from_left, right_psi, left_psi, from_right_psi, from_left_psi, amplitude = parameters
        z1x, z1y = x - x_d, y - y_d
        z3 = psi - psi_d
        z3 = z3 - turn * nearest(z3 * per_turn)
        filtering_x = fx - (x_d_rate - k1 * z1x - lam * beta_x)
        filtering_y = fy - (y_d_rate - k1 * z1y - lam * beta_y)
        z2x, z2y = vx - fx, vy - fy  # xi2 is 0 for good
        nodes, nodes_psi = zero, zero
        for center in centers:
            dx, dy, dpsi = vx - center, vy - center, psi - center
            nodes = nodes + exp(steepness * (dx * dx + dy * dy))
            nodes_psi = nodes_psi + exp(steepness * (dpsi * dpsi))
        nodes, nodes_psi = share1 * nodes, share2 * nodes_psi
        gain = k2 + varphi * nodes
        ux = deadzone(omega_n * gx - gain * z2x, right, left, from_right, from_left)
        uy = deadzone(omega_n * gy - gain * z2y, right, left, from_right, from_left)
        omega = psi_d_rate - (k3 + varphi_psi * nodes_psi) * z3 - lam_psi * beta_psi
        omega = deadzone(omega, right_psi, left_psi, from_right_psi, from_left_psi)
        delta = amplitude * push
        rates = (
            vx,
            vy,
            ux + delta - omega * vy,
            uy + delta + omega * vx,
            omega + delta,
            omega_n * gx,
            omega_n * gy,
            -damping * gx - omega_n * filtering_x,
            -damping * gy - omega_n * filtering_y,
            filtering_x - k1 * xi_x,
            filtering_y - k1 * xi_y,
            z1x,
            z1y,
            gamma1 * nodes * (z2x * z2x + z2y * z2y) - eta1 * varphi,
            z3,
            gamma2 * nodes_psi * z3 * z3 - eta2 * varphi_psi,
        )
        return rates, z1x * z1x + z1y * z1y + z3 * z3

    return derivative
