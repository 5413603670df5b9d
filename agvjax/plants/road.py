"""What a road is made of: how much of a tyre's grip it leaves, place by place.

A surface is anything with `__call__(position) -> factor`, a position (2,) [m] in, a factor of the friction coefficient
out. None in its place stands for a road that is the same everywhere.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._pytree import ANY, POSITIVE, Real, number, pytree

GRAVITY = 9.81  # m/s^2


@pytree
class FrictionPatch:
    """A disc with another friction, such as ice or a puddle, on an otherwise uniform road."""

    center: Float[Array, "2"] = number((0.0, 0.0), "m", ANY, shape=(2,))
    radius: Real = number(5.0, "m", POSITIVE)
    factor: Real = number(0.5, "1", POSITIVE, "of the friction coefficient, well inside")
    edge: Real = number(0.2, "m", POSITIVE, "half way from 27 % to 73 % of the change")

    def __call__(self, position: Float[Array, "2"]) -> Float[Array, ""]:
        """Factor of the friction coefficient: `factor` inside, 1 outside, their mean at the radius."""
        square = jnp.sum((position - jnp.asarray(self.center)) ** 2)  # no root of it: its slope at the center is NaN
        inside = jax.nn.sigmoid((self.radius**2 - square) / (2 * self.radius * self.edge))
        return 1.0 + (self.factor - 1.0) * inside
