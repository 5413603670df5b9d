"""Tyres of single-track vehicles: the lateral force that a slip angle makes under a load."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._pytree import POSITIVE, Real, number, pytree


@pytree
class LinearTyre:
    """CommonRoad's ST: lateral force = mu C_S F_z slip, without saturation.

    C_S = -p_ky1 / p_dy1 and mu = p_dy1, so that in the published sets mu cancels; what the road leaves of the friction
    has no effect here. The defaults are those of all CommonRoad vehicles.
    """

    mu: Real = number(1.0489, "1", POSITIVE, "p_dy1")
    stiffness_front: Real = number(21.92 / 1.0489, "1/rad", POSITIVE, "C_Sf = -p_ky1 / p_dy1")
    stiffness_rear: Real = number(21.92 / 1.0489, "1/rad", POSITIVE, "C_Sr = -p_ky1 / p_dy1")

    def front(self, slip: Array, load: Array, surface: Real) -> Float[Array, ""]:
        """Lateral force, in the unit of the load, at a slip angle [rad]; `surface` is the road's factor."""
        return self._force(self.stiffness_front * slip, load, surface)

    def rear(self, slip: Array, load: Array, surface: Real) -> Float[Array, ""]:
        """As `front`."""
        return self._force(self.stiffness_rear * slip, load, surface)

    def _force(self, demand: Array, load: Array, surface: Real) -> Array:
        return self.mu * load * demand

    def peak(self) -> Real:
        """The friction coefficient [1]: a real tyre on an unbroken road gives no more than this times its load."""
        return self.mu


@pytree
class SaturatingTyre(LinearTyre):
    """Lateral force = P tanh(mu C_S F_z slip / P) up to the peak P = friction mu F_z, times the road's factor.

    Friction lowers the peak and not the slope at zero slip, which is the rubber's: for small slip this is `LinearTyre`,
    the error is of third order. Grip that driving and braking take is not subtracted.
    """

    friction: Real = number(1.0, "1", POSITIVE, "of mu")

    def _force(self, demand: Array, load: Array, surface: Real) -> Array:
        grip = self.friction * surface
        return self.mu * load * grip * jnp.tanh(demand / grip)

    def peak(self) -> Real:
        """The friction coefficient [1]."""
        return self.mu * self.friction
