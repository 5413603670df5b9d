"""Plants, eqs. (1)-(10): how the vehicle moves under what its actuators deliver.

A plant is anything with `start(start) -> state`, `allocate(command, state) -> {actuator: input}`,
`derivative(state, memory, delivered, disturbance) -> state`, `output(state, delivered) -> Measurement` and a
`feedthrough` that says whether its output depends on what it delivers at the same instant.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from ._pytree import ANY, POSITIVE, number, pytree


@pytree
class Command:
    """What a controller asks for, before the actuators: U_bar and omega_bar."""

    position: Float[Array, "2"]  # m/s^2
    heading: Float[Array, ""]  # rad/s


@pytree
class Measurement:
    """What a controller sees of the vehicle."""

    position: Float[Array, "2"]  # m, the reference point (x_n, y_n), eq. (2)
    velocity: Float[Array, "2"]  # m/s
    heading: Float[Array, ""]  # rad
    yaw_rate: Float[Array, ""]  # rad/s


@pytree
class Start:
    """Where a run begins (section 4)."""

    position: Float[Array, "2"] = number((-0.5, 0.5), "m", ANY, "sec. 4", shape=(2,))
    velocity: Float[Array, "2"] = number((0.1, 0.1), "m/s", ANY, "sec. 4 (reading R15)", shape=(2,))
    heading: float = number(0.1, "rad", ANY, "sec. 4")


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

    def __call__(self, state: DecoupledState, delivered: dict[str, Array], L: Array) -> Float[Array, ""]:
        """Yaw rate [rad/s]."""
        return delivered["heading"]


@pytree
class KinematicYawRate:
    """Reading R9, selectable: the yaw rate that the velocities of the reference point imply."""

    feedthrough = False

    def __call__(self, state: DecoupledState, delivered: dict[str, Array], L: Array) -> Float[Array, ""]:
        """Yaw rate [rad/s]: w = (-x_n' sin psi + y_n' cos psi) / L."""
        sine, cosine = jnp.sin(state.heading), jnp.cos(state.heading)
        return (-state.velocity[0] * sine + state.velocity[1] * cosine) / L


def turned(velocity: Float[Array, "2"], yaw_rate: Float[Array, ""]) -> Float[Array, "2"]:
    """The acceleration of a velocity that turns at a yaw rate [m/s^2]; also the F that model-based laws cancel."""
    return yaw_rate * jnp.stack([-velocity[1], velocity[0]])


@pytree
class TurnedVelocity:
    """Reading R9, the default: F = w (-y_n', x_n'), which eq. (4) equals where the point's lateral velocity is L w."""

    def __call__(self, state: DecoupledState, yaw_rate: Float[Array, ""], L: Array) -> Float[Array, "2"]:
        """F [m/s^2]."""
        return turned(state.velocity, yaw_rate)


@pytree
class ForwardSpeed:
    """Eq. (4) as printed, v being the velocity along the heading (reading R9, selectable)."""

    def __call__(self, state: DecoupledState, yaw_rate: Float[Array, ""], L: Array) -> Float[Array, "2"]:
        """F [m/s^2]."""
        sine, cosine = jnp.sin(state.heading), jnp.cos(state.heading)
        v = state.velocity[0] * cosine + state.velocity[1] * sine
        return yaw_rate * jnp.stack([-v * sine - L * yaw_rate * cosine, v * cosine - L * yaw_rate * sine])


@pytree
class Decoupled:
    """Eq. (6), the plant the paper simulates: three independent inputs u_x, u_y, omega."""

    L: float = number(0.5, "m", POSITIVE, "eq. (2), reading R10")
    yaw_rate: DeliveredYawRate | KinematicYawRate = DeliveredYawRate()
    coupling: TurnedVelocity | ForwardSpeed = TurnedVelocity()

    actuators = ("position", "heading")  # the channels it takes, named as in the scenario's deadzones

    @property
    def feedthrough(self) -> bool:
        """Whether `output` needs what is delivered at the same instant."""
        return self.yaw_rate.feedthrough

    def start(self, start: Start) -> DecoupledState:
        """The state a run begins in."""
        return DecoupledState(position=start.position, velocity=start.velocity, heading=start.heading)  # pyright: ignore

    def allocate(self, command: Command, state: DecoupledState) -> dict[str, Array]:
        """The inputs of the actuators: `position` (2,) [m/s^2] and `heading` () [rad/s]."""
        return {"position": command.position, "heading": command.heading}

    def derivative(self, state: DecoupledState, memory: Any, delivered: dict[str, Array], disturbance: Array) -> Any:
        """Eqs. (6) and (55). Derivative of the state under the delivered inputs and a disturbance of shape (3,)."""
        yaw_rate = self.yaw_rate(state, delivered, self.L)  # pyright: ignore[reportArgumentType]
        F = self.coupling(state, yaw_rate, self.L)  # pyright: ignore[reportArgumentType]
        return DecoupledState(
            position=state.velocity,
            velocity=F + delivered["position"] + disturbance[:2],
            heading=delivered["heading"] + disturbance[2],
        )

    def output(self, state: DecoupledState, delivered: dict[str, Array]) -> Measurement:
        """What the controller sees; the yaw rate is the one that F of eq. (6) uses."""
        yaw_rate = self.yaw_rate(state, delivered, self.L)  # pyright: ignore[reportArgumentType]
        return Measurement(position=state.position, velocity=state.velocity, heading=state.heading, yaw_rate=yaw_rate)
