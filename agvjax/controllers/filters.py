"""Command filters, eq. (22), in continuous time and over a period of a digital loop."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._pytree import Real, pytree


class Filtered(NamedTuple):
    """A command filter's state, its input, and the gains of the law that set it."""

    phi1: Float[Array, "2"]  # m/s
    phi2: Float[Array, "2"]  # m/s
    alpha1: Float[Array, "2"]  # m/s, the input
    alpha1_rate: Float[Array, "2"]  # m/s^2
    omega_n: Real  # rad/s
    zeta: Real  # 1


@pytree
class CommandFilter:
    """Eq. (22) as the standard command filter: natural frequency omega_n, damping zeta (reading R5, the default)."""

    def __call__(self, x: Filtered) -> tuple[Array, Array]:
        """Derivatives of phi1 and phi2."""
        return x.omega_n * x.phi2, -2 * x.zeta * x.omega_n * x.phi2 - x.omega_n * (x.phi1 - x.alpha1)

    def over_period(self, x: Filtered, period: Real) -> tuple[Array, Array]:
        """Exact changes of phi1 and phi2 over a `period` [s] in which alpha1 is constant."""
        return _second_order(x, x.omega_n, period)

    def poles(self, omega_n: float, zeta: float) -> np.ndarray:
        """Roots of s^2 + 2 zeta omega_n s + omega_n^2 [1/s]."""
        return np.roots([1.0, 2 * zeta * omega_n, omega_n**2])


@pytree
class LiteralFilter:
    """Eq. (22) as printed: natural frequency omega_n^1.5, damping zeta / omega_n^0.5 (reading R5, selectable)."""

    def __call__(self, x: Filtered) -> tuple[Array, Array]:
        """Derivatives of phi1 and phi2."""
        return x.omega_n * x.phi2, -2 * x.zeta * x.omega_n * x.phi2 - x.omega_n**2 * (x.phi1 - x.alpha1)

    def over_period(self, x: Filtered, period: Real) -> tuple[Array, Array]:
        """Exact changes of phi1 and phi2 over a `period` [s] in which alpha1 is constant."""
        return _second_order(x, x.omega_n**2, period)

    def poles(self, omega_n: float, zeta: float) -> np.ndarray:
        """Roots of s^2 + 2 zeta omega_n s + omega_n^3 [1/s]."""
        return np.roots([1.0, 2 * zeta * omega_n, omega_n**3])


def _second_order(x: Filtered, q: Real, period: Real) -> tuple[Array, Array]:
    """How far phi1 and phi2 move in a `period`, by phi1' = p phi2, phi2' = -2 decay phi2 - q (phi1 - alpha1).

    With p = omega_n, decay = zeta omega_n and M = [[0, p], [-q, -2 decay]] it is (expm(M T) - 1) (phi1 - alpha1, phi2).
    Written for the change alone: a law divides it by T, which would multiply the rounding of a difference.
    """
    p, decay = x.omega_n, x.zeta * x.omega_n
    w2 = jnp.asarray(decay**2 - p * q)
    apart = w2 * period**2 > 1e-2  # two real poles, decay -+ w, so far apart that their difference is no cancellation
    off, y = x.phi1 - x.alpha1, x.phi2
    changes = _apart(jnp.where(apart, w2, 1.0), p, q, decay, period, off, y)
    near = _together(jnp.where(apart, 0.0, -w2 * period**2), p, q, decay, period, off, y)
    phi1, phi2 = (jnp.where(apart, a, b) for a, b in zip(changes, near, strict=True))
    return phi1, phi2


def _apart(w2: Array, p: Real, q: Real, decay: Real, T: Real, off: Array, y: Array) -> tuple[Array, Array]:
    """Well damped: the sum of two modes that fade, without the hyperbolic functions, which cancel and overflow."""
    w = jnp.sqrt(w2)
    fast = decay + w
    slow = p * q / fast  # decay - w
    lost_slow, lost_fast = jnp.expm1(-slow * T), jnp.expm1(-fast * T)
    moved = (lost_slow - lost_fast) / (2 * w)
    phi1 = off * (fast * lost_slow - slow * lost_fast) / (2 * w) + y * p * moved
    return phi1, y * (fast * lost_fast - slow * lost_slow) / (2 * w) - off * q * moved


def _together(d2: Array, p: Real, q: Real, decay: Real, T: Real, off: Array, y: Array) -> tuple[Array, Array]:
    """Complex poles or two alike: expm(M T) = e^(-decay T) (C + S T (M + decay)), C = cos d, S = sin(d) / d."""
    less, S = _cosine_less_one_and_sinc(d2)
    fade, lost = jnp.exp(-decay * T), jnp.expm1(-decay * T)
    stay = less + lost + less * lost  # e^(-decay T) C - 1
    inner, outer = off * decay + p * y, -q * off - decay * y
    return stay * off + fade * S * T * inner, stay * y + fade * S * T * outer


def _cosine_less_one_and_sinc(d2: Array) -> tuple[Array, Array]:
    """cos(d) - 1 and sin(d) / d as functions of d^2, which may be a little below 0."""
    small = d2 < 1e-2
    size = jnp.sqrt(jnp.where(small, 1.0, d2))
    near = -d2 / 2 * (1 - d2 / 12 * (1 - d2 / 30 * (1 - d2 / 56 * (1 - d2 / 90))))
    near_S = 1 - d2 / 6 * (1 - d2 / 20 * (1 - d2 / 42 * (1 - d2 / 72 * (1 - d2 / 110))))
    return jnp.where(small, near, -2 * jnp.sin(size / 2) ** 2), jnp.where(small, near_S, jnp.sin(size) / size)


@pytree
class NoFilter:
    """No filter: phi1 is alpha1, with its exact derivative, which (22) is there to avoid; an ablation."""

    def __call__(self, x: Filtered) -> tuple[Array, Array]:
        """Derivatives of phi1, which starts at alpha1 and so stays there, and of phi2, which is idle."""
        return x.alpha1_rate, jnp.zeros_like(x.phi2)

    def over_period(self, x: Filtered, period: Real) -> tuple[Array, Array]:
        """From phi1 to where alpha1 will be a `period` [s] later, by its rate."""
        return x.alpha1 - x.phi1 + period * x.alpha1_rate, jnp.zeros_like(x.phi2)

    def poles(self, omega_n: float, zeta: float) -> np.ndarray:
        """No poles: nothing is filtered."""
        return np.array([])
