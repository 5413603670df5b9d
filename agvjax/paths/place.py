"""A place on a route: what a law that follows one remembers and looks at."""

from __future__ import annotations

from jaxtyping import Array, Float

from .._pytree import pytree
from ..geometry import bearing, wrap


@pytree
class Place:
    """A place on a route, and the route there."""

    arc: Float[Array, ""]  # m from the route's beginning; of a closed one within its length
    leg: Float[Array, ""]  # number of the leg, from 0
    position: Float[Array, "2"]  # m
    tangent: Float[Array, "2"]  # unit vector of travel
    curvature: Float[Array, ""]  # 1/m, positive in a turn to the left of travel
    speed: Float[Array, ""]  # m/s of the profile, >= 0
    sign: Float[Array, ""]  # 1 forwards, -1 backwards
    remaining: Float[Array, ""]  # m to the end of the leg; infinite on a closed route
    waited: Float[Array, ""]  # control instants at which it has stood at the end of the leg
    room: tuple[Array, Array] | None  # m of the corridor to the left and to the right; None without one

    def heading(self) -> Float[Array, ""]:
        """The heading [rad] of a vehicle that drives along it; backwards it looks back."""
        return bearing(self.sign * self.tangent[1], self.sign * self.tangent[0])

    def across(self, position: Float[Array, "2"]) -> Float[Array, ""]:
        """How far [m] to the left of travel a position is."""
        away = position - self.position
        return self.tangent[0] * away[1] - self.tangent[1] * away[0]

    def ahead(self, position: Float[Array, "2"]) -> Float[Array, ""]:
        """How far [m] ahead along the tangent a position is."""
        away = position - self.position
        return self.tangent[0] * away[0] + self.tangent[1] * away[1]

    def heading_error(self, heading: Float[Array, ""]) -> Float[Array, ""]:
        """By how much [rad] a heading is turned to the left of what the route asks for, within half a turn."""
        return wrap(heading - self.heading())
