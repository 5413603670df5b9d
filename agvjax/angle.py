"""Angles: the one place where they are wrapped and where a bearing is taken."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

TURN = 2 * np.pi


def wrap(angle: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """The same angle in [-pi, pi] [rad]. Written with round: `%` would be a scalar library call in the hot loop."""
    return angle - TURN * jnp.round(angle * (1 / TURN))


def bearing(y: Float[Array, ""], x: Float[Array, ""]) -> Float[Array, ""]:
    """`atan2(y, x)` [rad], with value and derivative 0 where both vanish and the bearing is undefined."""
    undefined = (x == 0) & (y == 0)
    return jnp.where(undefined, 0.0, jnp.arctan2(y, jnp.where(undefined, 1.0, x)))
