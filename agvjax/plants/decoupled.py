"""The plant that the paper simulates, eqs. (4)-(10): three independent inputs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from .._pytree import POSITIVE, Real, number, pytree
from ..actuators.deadzone import Deadzone
from ..geometry import turned
from ..messages import Command, Measurement, Start
from ..protocols import Inputs, Motion, Plant


@pytree
class DecoupledState:
    """State of eq. (6)."""

    position: Float[Array, "2"]  # chi1, m
    velocity: Float[Array, "2"]  # chi2, m/s
    heading: Float[Array, ""]  # psi, rad


@pytree
class DeliveredYawRate:
    """Reading R9, the default: the yaw rate is the delivered omega = dz_psi(omega_bar)."""

    feedthrough = True

    def __call__(self, state: DecoupledState, delivered: Inputs, L: Real) -> Float[Array, ""]:
        """Yaw rate [rad/s]."""
        return delivered["heading"]


@pytree
class KinematicYawRate:
    """Reading R9, selectable: the yaw rate that the velocities of the reference point imply."""

    feedthrough = False

    def __call__(self, state: DecoupledState, delivered: Inputs, L: Real) -> Float[Array, ""]:
        """Yaw rate [rad/s]: w = (-x_n' sin psi + y_n' cos psi) / L."""
        sine, cosine = jnp.sin(state.heading), jnp.cos(state.heading)
        return (-state.velocity[0] * sine + state.velocity[1] * cosine) / L


@pytree
class TurnedVelocity:
    """Reading R9, the default: F = w (-y_n', x_n'), which eq. (4) equals where the point's lateral velocity is L w."""

    def __call__(self, state: DecoupledState, yaw_rate: Float[Array, ""], L: Real) -> Float[Array, "2"]:
        """F [m/s^2]."""
        return turned(state.velocity, yaw_rate)


@pytree
class ForwardSpeed:
    """Eq. (4) as printed, v being the velocity along the heading (reading R9, selectable)."""

    def __call__(self, state: DecoupledState, yaw_rate: Float[Array, ""], L: Real) -> Float[Array, "2"]:
        """F [m/s^2]."""
        sine, cosine = jnp.sin(state.heading), jnp.cos(state.heading)
        v = state.velocity[0] * cosine + state.velocity[1] * sine
        return yaw_rate * jnp.stack([-v * sine - L * yaw_rate * cosine, v * cosine - L * yaw_rate * sine])


@pytree
class Decoupled(Plant):
    """Eq. (6), the plant the paper simulates: three independent inputs u_x, u_y, omega."""

    L: Real = number(0.5, "m", POSITIVE, "eq. (2), reading R10")
    yaw_rate: DeliveredYawRate | KinematicYawRate = DeliveredYawRate()
    coupling: TurnedVelocity | ForwardSpeed = TurnedVelocity()

    actuators = ("position", "heading")  # the channels it takes, named as in the scenario's deadzones
    units: ClassVar[Mapping[str, str]] = {"position_x": "m/s^2", "position_y": "m/s^2", "heading": "rad/s"}

    def deadzones(self) -> dict[str, Deadzone]:
        """Section 4: one deadzone for x and y, one for the heading."""
        return {
            "position": Deadzone(slope_right=0.6, slope_left=0.8, threshold_right=0.5, threshold_left=0.4),
            "heading": Deadzone(slope_right=0.91, slope_left=0.72, threshold_right=0.66, threshold_left=0.53),
        }

    @property
    def feedthrough(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Whether `output` needs what is delivered at the same instant."""
        return self.yaw_rate.feedthrough

    def start(self, start: Start) -> DecoupledState:
        """The state a run begins in."""
        return DecoupledState(position=start.position, velocity=start.velocity, heading=jnp.asarray(start.heading))

    def allocate(self, command: Command, measurement: Measurement) -> Inputs:
        """The inputs of the actuators: `position` (2,) [m/s^2] and `heading` () [rad/s]."""
        return {"position": command.position, "heading": command.heading}

    def parts(self, actuator: str) -> tuple[str, ...]:
        """The names of what an actuator delivers: the position's are two."""
        return ("position_x", "position_y") if actuator == "position" else (actuator,)

    def achieved(self, inputs: Inputs, measurement: Measurement) -> Float[Array, "2"]:
        """The position command [m/s^2] that inputs amount to."""
        return inputs["position"]

    def derivative(
        self, state: DecoupledState, memory: PyTree, delivered: Inputs, disturbance: Array
    ) -> DecoupledState:
        """Eqs. (6) and (55). Derivative of the state under the delivered inputs and a disturbance of shape (3,)."""
        F = self._coupled(state, delivered)
        return DecoupledState(
            position=state.velocity,
            velocity=F + delivered["position"] + disturbance[:2],
            heading=delivered["heading"] + disturbance[2],
        )

    def _coupled(self, state: DecoupledState, delivered: Inputs) -> Float[Array, "2"]:
        """F [m/s^2]."""
        return self.coupling(state, self.yaw_rate(state, delivered, self.L), self.L)

    def needs(self, motion: Motion) -> dict[str, np.ndarray]:
        """The path's acceleration less F of eq. (6) [m/s^2], and the rate of the heading that is asked for [rad/s]."""
        asked = motion.asked
        if asked is None:
            return {}
        states = DecoupledState(position=asked.position, velocity=asked.velocity, heading=asked.heading)
        F = jax.vmap(self._coupled)(states, {"heading": asked.heading_rate})
        push = np.asarray(asked.acceleration - F)
        return {"position_x": push[:, 0], "position_y": push[:, 1], "heading": np.asarray(asked.heading_rate)}

    def output(self, state: DecoupledState, delivered: Inputs) -> Measurement:
        """What the controller sees; the yaw rate is the one that F of eq. (6) uses."""
        yaw_rate = self.yaw_rate(state, delivered, self.L)
        return Measurement(position=state.position, velocity=state.velocity, heading=state.heading, yaw_rate=yaw_rate)
