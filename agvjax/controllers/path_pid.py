"""Curvature feed-forward with proportional, derivative and integral terms in the route's own frame."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._pytree import NONNEGATIVE, POSITIVE, Real, number, pytree
from ..messages import Measurement
from ..paths.place import Place
from ..paths.route import Route
from .following import REGULATION, Regulated, path_errors

NEAR = 0.3  # least of 1 - curvature x deviation


@pytree
class PathPID(Regulated):
    """kappa = kappa_d(s + |v| ahead) cos e_psi / (1 - kappa_d e) - k_y e - k_psi sin e_psi - k_i I, w = v kappa.

    e [m] is the deviation to the left of travel, e_psi [rad] that of the heading, kappa_d the route's curvature, used
    `ahead` seconds early. I is the integral of e, kept within +-`windup`.

    Attributes:
        k_y: gain on the deviation from the route.
        k_psi: gain on the heading error.
        k_i: gain on the integral of the deviation.
        ahead: how early the route's curvature is used, to make up for delay and lag.
        windup: largest size of the integral.
    """

    k_y: Real = number(6.0, "1/m^2", POSITIVE)
    k_psi: Real = number(4.0, "1/m", POSITIVE)
    k_i: Real = number(1.0, "1/(m^2 s)", NONNEGATIVE)
    ahead: Real = number(0.35, "s", NONNEGATIVE)
    windup: Real = number(0.3, "m s", POSITIVE)

    tunable = ("k_y", "k_psi", "k_i", "ahead", *REGULATION)

    def own(self, measurement: Measurement) -> Float[Array, ""]:
        """The integral [m s]."""
        return jnp.zeros_like(measurement.heading)

    def steer(
        self, own: Array, place: Place, route: Route, measurement: Measurement, period: Real
    ) -> tuple[Float[Array, "2"], Array]:
        """Twist and the next integral."""
        e, e_psi, speed = path_errors(place, measurement)
        later = route.at(place.arc + jnp.abs(speed) * self.ahead, place.leg)
        integral = jnp.clip(own + period * e, -self.windup, self.windup)
        turn = later.curvature * jnp.cos(e_psi) / jnp.maximum(1 - later.curvature * e, NEAR)
        curvature = turn - self.k_y * e - self.k_psi * jnp.sin(e_psi) - self.k_i * integral
        wanted = self.regulated(place.speed, curvature)
        return self.twist(wanted, place.sign, curvature), integral
