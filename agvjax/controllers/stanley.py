"""The steering law of Stanley, the car that won the Grand Challenge of 2005."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._pytree import NONNEGATIVE, POSITIVE, Real, number, pytree
from ..geometry import into_plane
from ..messages import Measurement
from ..paths.place import Place
from ..paths.route import Route
from .following import REGULATION, Regulated, path_errors

STANLEY = "Hoffmann et al., ACC 2007"


@pytree
class Stanley(Regulated):
    """delta = -(e_psi - k_yaw (w_d - w)) - atan(k e / (k_soft + v)), w = v tan(delta) / wheelbase + w_d.

    e [m] is the deviation of the front axle to the left of the route and e_psi [rad] the heading's, both where the
    front axle is nearest; w_d is the yaw rate of the route there, so that a curve needs no deviation. For a base
    without a steered wheel the front axle is a point `wheelbase` ahead.

    Attributes:
        k: gain on the deviation of the front axle.
        k_soft: speed added in the denominator, so that it does not steer hard at rest.
        k_yaw: damping of the yaw rate.
        wheelbase: from the reference point to the front axle.
        largest_angle: largest steering angle, either way.
    """

    k: Real = number(2.0, "1/s", POSITIVE, STANLEY)
    k_soft: Real = number(0.3, "m/s", POSITIVE, STANLEY)
    k_yaw: Real = number(0.1, "s", NONNEGATIVE, STANLEY)
    wheelbase: Real = number(0.4, "m", POSITIVE)
    largest_angle: Real = number(0.6, "rad", POSITIVE)

    def gains_to_tune(self, heading: bool = True) -> tuple[str, ...]:
        """Its own and those of the regulation; not the angle it may steer."""
        return ("k", "k_soft", "k_yaw", "wheelbase", *REGULATION)

    def steer(
        self, own: tuple[()], place: Place, route: Route, measurement: Measurement, period: Real
    ) -> tuple[Float[Array, "2"], tuple[()]]:
        """Twist."""
        nose = measurement.position + place.sign * into_plane(
            jnp.asarray(self.wheelbase), jnp.zeros_like(measurement.heading), measurement.heading
        )
        front = route.at(place.arc + self.wheelbase, place.leg)
        arc = front.arc + front.ahead(nose) / jnp.maximum(1 - front.curvature * front.across(nose), 0.3)
        front = route.at(arc, place.leg)
        _, e_psi, speed = path_errors(front, measurement)
        pace = jnp.abs(speed)
        wanted_yaw_rate = pace * front.curvature
        angle = -(e_psi - self.k_yaw * (wanted_yaw_rate - measurement.yaw_rate))
        angle = angle - jnp.arctan(self.k * front.across(nose) / (self.k_soft + pace))
        angle = jnp.clip(angle, -self.largest_angle, self.largest_angle)
        curvature = front.curvature + jnp.tan(angle) / self.wheelbase
        return self.twist(self.regulated(place.speed, curvature), place.sign, curvature), ()
