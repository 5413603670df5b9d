"""Input deadzone, eqs. (11)-(18)."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._pytree import NONNEGATIVE, POSITIVE, Real, number, pytree
from ..protocols import Element, Reach


@pytree
class Deadzone(Element):
    """Eq. (11). What an actuator delivers of what it is commanded; the default delivers everything.

    Slopes and thresholds are magnitudes (reading R1: the paper's section 4 prints a negative left threshold,
    which eq. (11) does not allow).

    Attributes:
        slope_right: slope for a positive command beyond its threshold.
        slope_left: slope for a negative command beyond its threshold.
        threshold_right: up to this command nothing is delivered.
        threshold_left: down to minus this command nothing is delivered.
    """

    slope_right: Real = number(1.0, "1", POSITIVE, "Pi_r, eq. (11)")
    slope_left: Real = number(1.0, "1", POSITIVE, "Pi_l, eq. (11)")
    threshold_right: Real = number(0.0, "unit of the command", NONNEGATIVE, "s_r, eq. (11)")
    threshold_left: Real = number(0.0, "unit of the command", NONNEGATIVE, "s_l, eq. (11), reading R1")

    def __call__(self, u: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """Eq. (11). Delivered input, same shape and unit as the command `u`.

        Kinks lie at u = threshold_right and u = -threshold_left; between them the derivative is exactly 0.
        """
        right = self.slope_right * jnp.maximum(u - self.threshold_right, 0)
        left = self.slope_left * jnp.minimum(u + self.threshold_left, 0)
        return right + left

    def reach(self, asked: Reach) -> Reach:
        """Its own bounds, and a rate by the steeper slope."""
        return asked.through(self, asked.rate * max(float(self.slope_left), float(self.slope_right)))

    def slope(self, u: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """Eqs. (13), (17). The slope that the sign of the command selects."""
        return jnp.where(u > 0, self.slope_right, self.slope_left)

    def residual(self, u: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """Eqs. (14), (18). The disturbance-like rest d(u): what is delivered is slope * u + residual, eq. (12)."""
        inside = -self.slope(u) * u
        left = jnp.where(u <= -self.threshold_left, self.slope_left * self.threshold_left, inside)
        return jnp.where(u >= self.threshold_right, -self.slope_right * self.threshold_right, left)
