"""A vehicle that rolls without slip, eqs. (1)-(4), its inputs the two it really has."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from .._pytree import POSITIVE, Real, number, pytree
from ..actuators.deadzone import Deadzone
from ..geometry import into_body, into_plane
from ..messages import Command, Measurement, Start
from ..protocols import Inputs, Motion, Plant


@pytree
class RollingState:
    """State of a body that rolls without slip, its position that of the reference point, eq. (2)."""

    position: Float[Array, "2"]  # (x_n, y_n), m
    heading: Float[Array, ""]  # psi, rad
    speed: Float[Array, ""]  # v, m/s, of the axle, along the heading
    yaw_rate: Float[Array, ""]  # w, rad/s


@pytree
class Rolling(Plant):
    """What all vehicles that roll without slip have in common; each brings an `L`."""

    L: Real = number(0.5, "m", POSITIVE, "eq. (2), reading R10")

    commands_heading = False  # the heading follows from the motion of the reference point

    def start(self, start: Start) -> RollingState:
        """The state a run begins in: what the velocity of the reference point says of speed and yaw rate."""
        along, across = into_body(jnp.asarray(start.velocity), jnp.asarray(start.heading))
        return RollingState(
            position=start.position,
            heading=jnp.asarray(start.heading),
            speed=along,
            yaw_rate=across / self.L,
        )

    def seen(self, measurement: Measurement) -> RollingState:
        """The state that a measurement tells, its yaw rate as it was measured."""
        return dataclasses.replace(super().seen(measurement), yaw_rate=measurement.yaw_rate)

    def move(self, state: RollingState, a: Array, alpha: Array, disturbance: Array) -> RollingState:
        """The body, eqs. (1)-(4), under accelerations a [m/s^2] and alpha [rad/s^2] and a disturbance (3,).

        The disturbance's delta_x, delta_y [m/s^2] push the reference point, eq. (6): what of it lies along the heading
        changes v, what lies across it w, by a lever of L. Its delta_psi [rad/s] adds to the heading's rate, eq. (55),
        as a growing slip angle would: the body turns, v and w stay, and so the velocity turns with it.
        """
        push, side = into_body(disturbance[:2], state.heading)
        return RollingState(
            position=into_plane(state.speed, self.L * state.yaw_rate, state.heading),  # (1), (2)
            heading=state.yaw_rate + disturbance[2],  # (1), (55)
            speed=a + push,
            yaw_rate=alpha + side / self.L,
        )

    def lever(self) -> Real:
        """L of eq. (2) [m]."""
        return self.L

    def output(self, state: RollingState, delivered: Inputs) -> Measurement:
        """What the controller sees: eq. (2) and its rate."""
        velocity = into_plane(state.speed, self.L * state.yaw_rate, state.heading)
        return Measurement(position=state.position, velocity=velocity, heading=state.heading, yaw_rate=state.yaw_rate)


@pytree
class Unicycle(Rolling):
    """The vehicle of eqs. (1)-(4): its inputs are the two it has, v' and w', each behind its own deadzone.

    The heading is internal: it follows from how the reference point moves, and is stable while that moves forward.
    """

    actuators = ("acceleration", "yaw_acceleration")
    units: ClassVar[Mapping[str, str]] = {"acceleration": "m/s^2", "yaw_acceleration": "rad/s^2"}

    def deadzones(self) -> dict[str, Deadzone]:
        """Section 4, the position's on v' [m/s^2] and the heading's on w' [rad/s^2]."""
        return {
            "acceleration": Deadzone(slope_right=0.6, slope_left=0.8, threshold_right=0.5, threshold_left=0.4),
            "yaw_acceleration": Deadzone(slope_right=0.91, slope_left=0.72, threshold_right=0.66, threshold_left=0.53),
        }

    def allocate(self, command: Command, measurement: Measurement) -> Inputs:
        """Eq. (4). (a, L alpha) = R(psi)^T U_bar [m/s^2, rad/s^2]; the heading's command has no actuator."""
        along, across = into_body(command.position, measurement.heading)
        return {"acceleration": along, "yaw_acceleration": across / self.L}

    def achieved(self, inputs: Inputs, measurement: Measurement) -> Float[Array, "2"]:
        """The position command [m/s^2] that inputs amount to, eq. (4)."""
        return into_plane(inputs["acceleration"], self.L * inputs["yaw_acceleration"], measurement.heading)

    def derivative(self, state: RollingState, memory: PyTree, delivered: Inputs, disturbance: Array) -> RollingState:
        """See `Rolling.move`."""
        return self.move(state, delivered["acceleration"], delivered["yaw_acceleration"], disturbance)

    def needs(self, motion: Motion) -> dict[str, np.ndarray]:
        """What must be delivered for speed v, yaw rate w and their rates."""
        return {"acceleration": motion.acceleration, "yaw_acceleration": motion.yaw_acceleration}
