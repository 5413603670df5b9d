"""Command filters, eq. (22), in continuous time and over a period of a digital loop."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._pytree import pytree


@pytree
class CommandFilter:
    """Eq. (22) as the standard command filter: natural frequency omega_n, damping zeta (reading R5, the default)."""

    def __call__(
        self, phi1: Array, phi2: Array, alpha1: Array, alpha1_rate: Array, omega_n: Array, zeta: Array
    ) -> tuple[Array, Array]:
        """Derivatives of phi1 and phi2."""
        return omega_n * phi2, -2 * zeta * omega_n * phi2 - omega_n * (phi1 - alpha1)

    def held(
        self, phi1: Array, phi2: Array, alpha1: Array, alpha1_rate: Array, omega_n: Array, zeta: Array, period: Array
    ) -> tuple[Array, Array]:
        """phi1 and phi2 a `period` [s] later, exactly, for an alpha1 that is held."""
        return _second_order(phi1, phi2, alpha1, omega_n, omega_n, zeta * omega_n, period)

    def poles(self, omega_n: float, zeta: float) -> np.ndarray:
        """Roots of s^2 + 2 zeta omega_n s + omega_n^2 [1/s]."""
        return np.roots([1.0, 2 * zeta * omega_n, omega_n**2])


@pytree
class LiteralFilter:
    """Eq. (22) as printed: natural frequency omega_n^1.5, damping zeta / omega_n^0.5 (reading R5, selectable)."""

    def __call__(
        self, phi1: Array, phi2: Array, alpha1: Array, alpha1_rate: Array, omega_n: Array, zeta: Array
    ) -> tuple[Array, Array]:
        """Derivatives of phi1 and phi2."""
        return omega_n * phi2, -2 * zeta * omega_n * phi2 - omega_n**2 * (phi1 - alpha1)

    def held(
        self, phi1: Array, phi2: Array, alpha1: Array, alpha1_rate: Array, omega_n: Array, zeta: Array, period: Array
    ) -> tuple[Array, Array]:
        """phi1 and phi2 a `period` [s] later, exactly, for an alpha1 that is held."""
        return _second_order(phi1, phi2, alpha1, omega_n, omega_n**2, zeta * omega_n, period)

    def poles(self, omega_n: float, zeta: float) -> np.ndarray:
        """Roots of s^2 + 2 zeta omega_n s + omega_n^3 [1/s]."""
        return np.roots([1.0, 2 * zeta * omega_n, omega_n**3])


def _second_order(
    x: Array, y: Array, rest: Array, p: Array, q: Array, decay: Array, period: Array
) -> tuple[Array, Array]:
    """Solution of x' = p y, y' = -2 decay y - q (x - rest) after a `period`.

    M = [[0, p], [-q, -2 decay]] has expm(M T) = e^(-decay T) (C + S T (M + decay)) with C = cos d, S = sin(d) / d and
    d^2 = (p q - decay^2) T^2; hyperbolic where that is negative, and smooth where it is 0, at the damping 1.
    """
    d2 = (p * q - decay**2) * period**2
    C, S = _cosine_and_sinc(d2)
    off, fade = x - rest, jnp.exp(-decay * period)
    inner, outer = off * decay + p * y, -q * off - decay * y
    return rest + fade * (C * off + S * period * inner), fade * (C * y + S * period * outer)


def _cosine_and_sinc(d2: Array) -> tuple[Array, Array]:
    """cos(d) and sin(d) / d as functions of d^2, which may be negative."""
    small = jnp.abs(d2) < 1e-2
    size = jnp.sqrt(jnp.where(small, 1.0, jnp.abs(d2)))
    C = jnp.where(d2 > 0, jnp.cos(size), jnp.cosh(size))
    S = jnp.where(d2 > 0, jnp.sin(size), jnp.sinh(size)) / size
    near = 1 - d2 / 2 * (1 - d2 / 12 * (1 - d2 / 30 * (1 - d2 / 56 * (1 - d2 / 90))))
    near_S = 1 - d2 / 6 * (1 - d2 / 20 * (1 - d2 / 42 * (1 - d2 / 72 * (1 - d2 / 110))))
    return jnp.where(small, near, C), jnp.where(small, near_S, S)


@pytree
class NoFilter:
    """No filter: phi1 is alpha1, its derivative taken exactly. What (22) is there to spare; an ablation."""

    def __call__(
        self, phi1: Array, phi2: Array, alpha1: Array, alpha1_rate: Array, omega_n: Array, zeta: Array
    ) -> tuple[Array, Array]:
        """Derivatives of phi1, which starts at alpha1 and so stays there, and of phi2, which is idle."""
        return alpha1_rate, jnp.zeros_like(phi2)

    def held(
        self, phi1: Array, phi2: Array, alpha1: Array, alpha1_rate: Array, omega_n: Array, zeta: Array, period: Array
    ) -> tuple[Array, Array]:
        """Where alpha1 will be a `period` [s] later, by its rate."""
        return alpha1 + period * alpha1_rate, phi2

    def poles(self, omega_n: float, zeta: float) -> np.ndarray:
        """None."""
        return np.array([])
