"""What a controller and a plant say to each other."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._pytree import ANY, number, pytree


@pytree
class Command:
    """What a controller asks for, before the actuators: U_bar and omega_bar."""

    position: Float[Array, "2"]  # m/s^2
    heading: Float[Array, ""]  # rad/s
    inputs: Any = None  # {actuator: input}, of a law that allocates for itself; None: the plant does


@pytree
class Measurement:
    """What a controller sees of the vehicle."""

    position: Float[Array, "2"]  # m, the reference point (x_n, y_n), eq. (2)
    velocity: Float[Array, "2"]  # m/s
    heading: Float[Array, ""]  # rad
    yaw_rate: Float[Array, ""]  # rad/s
    steering_angle: Any = None  # rad, of a vehicle that steers a wheel


@pytree
class Start:
    """Where a run begins (section 4)."""

    position: Float[Array, "2"] = number((-0.5, 0.5), "m", ANY, "sec. 4", shape=(2,))
    velocity: Float[Array, "2"] = number((0.1, 0.1), "m/s", ANY, "sec. 4 (reading R15)", shape=(2,))
    heading: float = number(0.1, "rad", ANY, "sec. 4")


def turned(velocity: Float[Array, "2"], yaw_rate: Float[Array, ""]) -> Float[Array, "2"]:
    """Eqs. (4), (9). The acceleration of a velocity that turns at a yaw rate [m/s^2]; the F that some laws cancel."""
    return yaw_rate * jnp.stack([-velocity[1], velocity[0]])


def into_body(vector: Float[Array, "2"], heading: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Components of a vector of the plane along the heading and across it, to the left."""
    sine, cosine = jnp.sin(heading), jnp.cos(heading)
    return vector[0] * cosine + vector[1] * sine, vector[1] * cosine - vector[0] * sine


def into_plane(along: Float[Array, ""], across: Float[Array, ""], heading: Float[Array, ""]) -> Float[Array, "2"]:
    """The vector that has these components along the heading and across it."""
    sine, cosine = jnp.sin(heading), jnp.cos(heading)
    return jnp.stack([along * cosine - across * sine, along * sine + across * cosine])
