"""How a vehicle lies to the route that is its path, between the instants at which its place is looked for."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._pytree import pytree
from ..geometry import wrap
from ..messages import Measurement
from ..paths.place import Place
from ..paths.route import Route


@pytree
class Beside:
    """How a vehicle lies to the route that it follows."""

    arc: Float[Array, "*N"]  # m along the route
    cross_track: Float[Array, "*N"]  # m, to the left of travel
    heading_error: Float[Array, "*N"]  # rad, by which the heading is turned to the left of the route's
    speed: Float[Array, "*N"]  # m/s along the route
    yaw_rate: Float[Array, "*N"]  # rad/s
    wanted: Float[Array, "*N"]  # m/s, the profile's
    ahead: Float[Array, "*N"]  # m, of where it would be by the clock; behind it negative
    arrived: Bool[Array, "*N"]  # whether it is at the end of an open route
    position: Float[Array, "*N 2"]  # m, the nearest point
    room: tuple[Array, Array] | None  # m of the corridor to the left and to the right

    @classmethod
    def of(cls, route: Route, place: Place, seen: Measurement, clock: Float[Array, ""]) -> Beside:
        """A vehicle beside the place that was nearest at a control instant, its curve continued to second order.

        Until the next instant a vehicle goes on by v h, of which the curve is off by curvature' (v h)^3 / 6. `clock` is
        the arc length [m] at which it would be by the clock.
        """
        ahead = place.ahead(seen.position)
        bend = place.curvature * ahead
        left = jnp.stack([-place.tangent[1], place.tangent[0]])
        last = place.leg >= route.legs.shape[1] - 1
        return cls(
            arc=place.arc + ahead,
            cross_track=place.across(seen.position) - bend * ahead / 2,
            heading_error=wrap(place.heading_error(seen.heading) - bend),
            speed=jnp.sum(seen.velocity * (place.tangent + bend * left)),
            yaw_rate=seen.yaw_rate,
            wanted=jnp.where(route.stands(place), 0, place.speed),
            ahead=route.ahead_of_clock(place.arc + ahead, clock),
            arrived=last & (place.remaining - ahead <= route.reached),
            position=place.position + ahead * place.tangent + bend * ahead / 2 * left,
            room=place.room,
        )
