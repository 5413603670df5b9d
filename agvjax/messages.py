"""What a controller and a plant say to each other."""

from __future__ import annotations

from typing import Any

from jaxtyping import Array, Float

from ._pytree import ANY, Real, number, pytree


@pytree
class Command:
    """The command of a controller, before the actuators: U_bar and omega_bar."""

    position: Float[Array, "2"]  # m/s^2
    heading: Float[Array, ""]  # rad/s
    twist: Any = None  # (2,) m/s, rad/s: speed and yaw rate, of a law that drives a base; None: of no other
    inputs: Any = None  # {actuator: input}, of a law that allocates for itself; None: the plant does


@pytree
class Measurement:
    """What a controller measures of the vehicle."""

    position: Float[Array, "2"]  # m, the reference point (x_n, y_n), eq. (2)
    velocity: Float[Array, "2"]  # m/s
    heading: Float[Array, ""]  # rad
    yaw_rate: Float[Array, ""]  # rad/s
    steering_angle: Any = None  # rad, of a vehicle that steers a wheel; no other plant asks for it


@pytree
class Reference:
    """The reference of the path at one instant."""

    position: Float[Array, "2"]  # m
    velocity: Float[Array, "2"]  # m/s
    acceleration: Float[Array, "2"]  # m/s^2
    heading: Float[Array, ""]  # rad
    heading_rate: Float[Array, ""]  # rad/s
    arc: Any = None  # m along a route, by the clock; None on a path that is none
    route: Any = None  # the route itself, for laws that follow it by where they are


@pytree
class Start:
    """Where a run begins (section 4).

    Attributes:
        position: of the vehicle's reference point.
        velocity: of the reference point.
        heading: of the vehicle, from the x axis to the y axis.
    """

    position: Float[Array, "2"] = number((-0.5, 0.5), "m", ANY, "sec. 4", shape=(2,))
    velocity: Float[Array, "2"] = number((0.1, 0.1), "m/s", ANY, "sec. 4 (reading R15)", shape=(2,))
    heading: Real = number(0.1, "rad", ANY, "sec. 4")
