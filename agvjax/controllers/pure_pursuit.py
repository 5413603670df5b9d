"""Regulated pure pursuit, under the names, units and defaults of Nav2's controller of that name."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._pytree import NONNEGATIVE, POSITIVE, Real, number, pytree, structure
from ..geometry import into_body, safe_sqrt
from ..messages import Measurement
from ..paths.place import Place
from ..paths.route import Route
from .following import REGULATION, Regulated

STEPS = 3  # of Newton's method to the carrot
NEAR = 1e-3  # m^2, least squared distance of the carrot; Nav2 steers straight on below it
NAV2 = "Nav2, nav2_regulated_pure_pursuit_controller"


@pytree
class RegulatedPurePursuit(Regulated):
    """Steers along the arc through a point ahead, the carrot, and slows down in turns and at the end.

    The carrot is the first point of the route ahead of the nearest one whose distance is the look-ahead; beyond the end
    of a leg it is the end. kappa = 2 y / distance^2, y across the vehicle; w = v kappa.

    Attributes:
        desired_linear_vel: desired speed; the route's speed profile limits it too.
        lookahead_dist: look-ahead distance to the carrot, unless it grows with speed.
        min_lookahead_dist: smallest look-ahead distance, where it grows with speed; above the largest that counts, and
            tuned gains are written so, for Nav2 does not say what it does.
        max_lookahead_dist: largest look-ahead distance, where it grows with speed.
        lookahead_time: look-ahead distance divided by speed, where it grows with speed.
        approach_velocity_scaling_dist: distance before the end over which it slows down.
        use_velocity_scaled_lookahead_dist: whether the look-ahead distance grows with speed.
        use_regulated_linear_velocity_scaling: whether it slows down in turns.
    """

    desired_linear_vel: Real = number(0.5, "m/s", POSITIVE, NAV2)
    lookahead_dist: Real = number(0.6, "m", POSITIVE, NAV2)
    min_lookahead_dist: Real = number(0.3, "m", POSITIVE, NAV2)
    max_lookahead_dist: Real = number(0.9, "m", POSITIVE, NAV2)
    lookahead_time: Real = number(1.5, "s", NONNEGATIVE, NAV2)
    min_approach_linear_velocity: Real = number(0.05, "m/s", NONNEGATIVE, NAV2)
    approach_velocity_scaling_dist: Real = number(0.6, "m", NONNEGATIVE, NAV2)
    use_velocity_scaled_lookahead_dist: bool = structure(False)
    use_regulated_linear_velocity_scaling: bool = structure(True)

    def gains_to_tune(self, heading: bool = True) -> tuple[str, ...]:
        """Those that count: the look-ahead by time or by distance, and the regulation."""
        scaled, fixed = ("lookahead_time", "min_lookahead_dist", "max_lookahead_dist"), ("lookahead_dist",)
        regulation = REGULATION if self.use_regulated_linear_velocity_scaling else ()
        return (*(scaled if self.use_velocity_scaled_lookahead_dist else fixed), *regulation)

    def faster(self, factor: float) -> RegulatedPurePursuit:
        """With the speed that it wants so many times as high."""
        return dataclasses.replace(self, desired_linear_vel=factor * self.desired_linear_vel)

    def canonical(self) -> RegulatedPurePursuit:
        """With a smallest look-ahead not above the largest."""
        least, largest = self.min_lookahead_dist, self.max_lookahead_dist
        if not self.use_velocity_scaled_lookahead_dist or not np.any(np.asarray(least) > np.asarray(largest)):
            return self
        return dataclasses.replace(self, min_lookahead_dist=jnp.minimum(least, largest))

    def look_ahead(self, speed: Array) -> Float[Array, ""]:
        """The look-ahead [m] at a speed [m/s]."""
        if not self.use_velocity_scaled_lookahead_dist:
            return jnp.asarray(self.lookahead_dist) + jnp.zeros_like(speed)
        return jnp.clip(jnp.abs(speed) * self.lookahead_time, self.min_lookahead_dist, self.max_lookahead_dist)

    def carrot(self, place: Place, route: Route, position: Float[Array, "2"], look: Array) -> Float[Array, "2"]:
        """The point ahead at that distance: Newton's method, from where it would be on a straight route."""
        square = look**2 - place.across(position) ** 2
        arc = place.arc + jnp.sqrt(jnp.maximum(square, (look / 4) ** 2))
        for _ in range(STEPS):
            point = route.at(arc, place.leg)
            away = point.position - position
            distance = safe_sqrt(jnp.sum(away**2))
            grows = jnp.sum(away * point.tangent) / jnp.maximum(distance, 1e-9)
            arc = jnp.maximum(arc + jnp.clip((look - distance) / jnp.maximum(grows, 0.3), -look / 2, look), place.arc)
        return route.at(arc, place.leg).position

    def steer(
        self, own: tuple[()], place: Place, route: Route, measurement: Measurement, period: Real
    ) -> tuple[Float[Array, "2"], tuple[()]]:
        """Twist."""
        along, _ = into_body(measurement.velocity, measurement.heading)
        carrot = self.carrot(place, route, measurement.position, self.look_ahead(along))
        away = carrot - measurement.position
        _, across = into_body(away, measurement.heading)
        square = jnp.sum(away**2)
        curvature = place.sign * 2 * across / jnp.maximum(square, NEAR)  # of travel: w = |v| curvature
        wanted = self.slowed(jnp.minimum(jnp.asarray(self.desired_linear_vel), place.speed), curvature, place)
        return self.twist(wanted, place.sign, curvature), ()

    def slowed(self, speed: Array, curvature: Array, place: Place) -> Array:
        """A speed reduced in Nav2's order: in turns, to no less than the least, before the end; and never raised."""
        slow = self.regulated(speed, curvature) if self.use_regulated_linear_velocity_scaling else speed
        slow = jnp.maximum(slow, self.regulated_linear_scaling_min_speed)
        return jnp.minimum(self._approaching(slow, place), speed)

    def _approaching(self, speed: Array, place: Place) -> Array:
        """Slower within the approach distance of the end of a leg, in proportion to what is left of it."""
        near = self.approach_velocity_scaling_dist
        share = jnp.minimum(place.remaining / jnp.maximum(near, 1e-9), 1.0)
        slow = jnp.maximum(speed * share, self.min_approach_linear_velocity)
        return jnp.where(place.remaining < near, jnp.minimum(speed, slow), speed)
