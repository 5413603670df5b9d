"""Laws that follow a route by where the vehicle is: what they remember, and how they slow down and stop.

They run in a computer (`Sampled`), once a period, and ask for a twist: speed and yaw rate. Their speed is the route's
profile, slowed down in turns that they themselves steer, negative where the route is driven backwards, and 0 where it
has to stand: from where its end is reached, and at stops for as long as they last.
"""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree

from .._pytree import NONNEGATIVE, POSITIVE, Real, number, pytree
from ..geometry import into_body
from ..messages import Command, Measurement, Reference
from ..paths.place import Place
from ..paths.route import Route
from ..protocols import Law


@pytree
class Followed:
    """What a law that follows a route remembers."""

    place: Place
    own: PyTree  # of the law itself


@pytree
class Follower(Law):
    """A law that follows a route; each brings `steer`, and `own` where it remembers something."""

    def follows(self) -> bool:
        """It does."""
        return True

    def own(self, measurement: Measurement) -> PyTree:
        """What it remembers of its own at the start."""
        return ()

    def steer(
        self, own: PyTree, place: Place, route: Route, measurement: Measurement, period: Real
    ) -> tuple[Float[Array, "2"], PyTree]:
        """The twist [m/s, rad/s] for a vehicle at a place, and what the law remembers next."""
        raise NotImplementedError(f"{type(self).__name__} needs steer(own, place, route, measurement, period)")

    def init(self, measurement: Measurement, reference: Reference) -> Followed:
        """On the route, where it is nearest and goes the way that the vehicle looks."""
        place = _route(reference).search(measurement.position, measurement.heading)
        return Followed(place=place, own=self.own(measurement))

    def law(self, flow: PyTree, memory: PyTree, measurement: Measurement, reference: Reference) -> Any:
        """It has no form in continuous time.

        Raises:
            ValueError: always.
        """
        raise ValueError(f"{type(self).__name__} runs in a computer: put it into agvjax.Sampled(inner=...)")

    def advance(
        self, state: Followed, measurement: Measurement, reference: Reference, period: Real, limit: Real | None = None
    ) -> tuple[Command, Followed, Bool[Array, ""]]:
        """One period: progress, twist, and rest at stops and at the end of the route."""
        route = _route(reference)
        place = route.follow(measurement.position, state.place, measurement.velocity, jnp.asarray(period))
        twist, own = self.steer(state.own, place, route, measurement, period)
        rests = route.stands(place)
        twist = jnp.where(rests, 0.0, twist)
        own = jax.tree.map(functools.partial(jnp.where, rests), state.own, own)  # no integral winds up
        command = Command(position=twist, heading=jnp.zeros_like(measurement.heading), twist=twist)
        return command, Followed(place=place, own=own), jnp.zeros((), bool)


REGULATION = ("regulated_linear_scaling_min_radius", "regulated_linear_scaling_min_speed")


@pytree
class Regulated(Follower):
    """A follower that slows down where it turns, as Nav2's regulated pure pursuit does, under its names.

    Attributes:
        regulated_linear_scaling_min_radius: it slows down in turns of a smaller radius than this.
        regulated_linear_scaling_min_speed: lowest speed to which it slows down in turns.
        min_approach_linear_velocity: lowest speed until it has arrived; below the deadzone it would stop short of the
            end.
        max_angular_velocity: largest yaw rate; commands are clipped to it.
    """

    regulated_linear_scaling_min_radius: Real = number(0.9, "m", NONNEGATIVE, "Nav2")
    regulated_linear_scaling_min_speed: Real = number(0.25, "m/s", NONNEGATIVE, "Nav2")
    min_approach_linear_velocity: Real = number(0.15, "m/s", NONNEGATIVE, "Nav2")
    max_angular_velocity: Real = number(1.5, "rad/s", POSITIVE)

    def regulated(self, speed: Array, curvature: Array) -> Float[Array, ""]:
        """A speed >= 0 for a curvature [1/m] to be driven: in proportion to a radius below the least one."""
        share = jnp.minimum(1.0 / (jnp.abs(curvature) * self.regulated_linear_scaling_min_radius + 1e-9), 1.0)
        return jnp.maximum(speed * share, jnp.minimum(self.regulated_linear_scaling_min_speed, speed))

    def twist(self, speed: Array, sign: Array, curvature: Array) -> Float[Array, "2"]:
        """Of a speed >= 0 along travel and the curvature of travel.

        The speed is not below the least one: a route's profile falls to 0 where a leg ends, and motors with a deadzone
        would stand before it.
        """
        most, speed = self.max_angular_velocity, jnp.maximum(speed, self.min_approach_linear_velocity)
        return jnp.stack([sign * speed, jnp.clip(speed * curvature, -most, most)])


def _route(reference: Reference) -> Route:
    if not isinstance(reference.route, Route):
        raise ValueError("a law that follows a route needs a path that is one: Scenario(path=agvjax.Route.along(path))")
    return reference.route


def path_errors(place: Place, measurement: Measurement) -> tuple[Array, Array, Array]:
    """Deviation to the left of travel [m], heading error [rad], and speed along the heading of travel [m/s]."""
    along, _ = into_body(measurement.velocity, measurement.heading)
    return place.across(measurement.position), place.heading_error(measurement.heading), place.sign * along
