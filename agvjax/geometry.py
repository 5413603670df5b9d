"""Angles: the one place where they are wrapped and where a bearing is taken."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

TURN = 2 * np.pi


def wrap(angle: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """The same angle [rad], from -pi to pi. Written with round: `%` would be a scalar library call in the hot loop."""
    return angle - TURN * jnp.round(angle * (1 / TURN))


def bearing(y: Float[Array, ""], x: Float[Array, ""]) -> Float[Array, ""]:
    """`atan2(y, x)` [rad], with value and derivative 0 where both vanish and the bearing is undefined."""
    undefined = (x == 0) & (y == 0)
    return jnp.where(undefined, 0.0, jnp.arctan2(y, jnp.where(undefined, 1.0, x)))


def turned(velocity: Float[Array, "2"], yaw_rate: Float[Array, ""]) -> Float[Array, "2"]:
    """Eqs. (4), (9). The acceleration of a velocity that turns at a yaw rate [m/s^2]; the F that some laws cancel."""
    return yaw_rate * jnp.stack([-velocity[1], velocity[0]])


def direction(angle: Float[Array, ""]) -> Float[Array, "2"]:
    """The unit vector along an angle [rad]."""
    return jnp.stack([jnp.cos(angle), jnp.sin(angle)])


def into_body(vector: Float[Array, "2"], heading: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Components of a vector of the plane along the heading and across it, to the left."""
    sine, cosine = jnp.sin(heading), jnp.cos(heading)
    return vector[0] * cosine + vector[1] * sine, vector[1] * cosine - vector[0] * sine


def into_plane(along: Float[Array, ""], across: Float[Array, ""], heading: Float[Array, ""]) -> Float[Array, "2"]:
    """The vector that has these components along the heading and across it."""
    sine, cosine = jnp.sin(heading), jnp.cos(heading)
    return jnp.stack([along * cosine - across * sine, along * sine + across * cosine])


def safe_sqrt(x: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Square root whose derivative at 0 is 0 and not infinite."""
    positive = x > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, x, 1.0)), 0.0)
