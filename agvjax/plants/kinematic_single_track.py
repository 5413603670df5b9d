"""CommonRoad's kinematic single-track model (KS): a car whose axles do not slip sideways.

Althoff & Wuersching, "CommonRoad: Vehicle Models", 2020 (version 2020a, package commonroad-vehicle-models 3.0.2).
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from .._pytree import pytree
from ..geometry import direction, into_body, into_plane
from ..messages import Measurement, Start
from ..protocols import Inputs
from .steered import Steered


@pytree
class KinematicState:
    """State of CommonRoad's KS."""

    position: Float[Array, "2"]  # of the rear axle's centre, m
    steering_angle: Float[Array, ""]  # delta, rad
    speed: Float[Array, ""]  # v, m/s, along the car
    heading: Float[Array, ""]  # psi, rad


@pytree
class KinematicSingleTrack(Steered):
    """CommonRoad's KS: neither axle slips sideways.

    A disturbance's first two components [m/s^2] and the slope of the road push the car; what of them lies along it
    changes v, what lies across it the tyres hold. The third [rad/s] adds to the heading's rate, eq. (55).
    """

    def start(self, start: Start) -> KinematicState:
        """The state in which the front point moves as the start says, see `_begin`."""
        speed, delta, _ = self._begin(start)
        return KinematicState(
            position=jnp.asarray(start.position) - self.L * direction(jnp.asarray(start.heading)),
            steering_angle=delta,
            speed=speed,
            heading=jnp.asarray(start.heading),
        )

    def derivative(
        self, state: KinematicState, memory: PyTree, delivered: Inputs, disturbance: Array
    ) -> KinematicState:
        """CommonRoad, section 5, under what is delivered and a disturbance of shape (3,)."""
        push, _ = into_body(self._outside(disturbance), state.heading)
        return KinematicState(
            position=state.speed * direction(state.heading),
            steering_angle=self.limits.turns(delivered["steering_rate"], state.steering_angle),
            speed=self.limits.accelerates(delivered["acceleration"], state.speed) + push,
            heading=self._yaw_rate(state) + disturbance[2],
        )

    def output(self, state: KinematicState, delivered: Inputs) -> Measurement:
        """The front axle's centre, eq. (2), and its rate."""
        r = self._yaw_rate(state)
        return Measurement(
            position=state.position + self.L * direction(state.heading),
            velocity=into_plane(state.speed, self.L * r, state.heading),
            heading=state.heading,
            yaw_rate=r,
            steering_angle=state.steering_angle,
        )

    def _yaw_rate(self, state: KinematicState) -> Float[Array, ""]:
        return state.speed * jnp.tan(state.steering_angle) / self.L
