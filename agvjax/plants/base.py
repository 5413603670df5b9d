"""Vehicles that are driven by velocities: a twist or two wheel speeds sent to motors that do what they can.

A motor controller has a deadzone, a delay (both before it, in `Scenario.deadzone` and `Scenario.actuators`), and here a
lag and an acceleration limit; the body rolls without slip about the middle of its fixed axle, its reference point.
What pushes it along is added to the acceleration of its wheels, what pushes it aside they hold; the disturbance's third
component adds to its yaw rate.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from .._pytree import ANY, POSITIVE, Real, number, pytree, structure
from ..actuators.deadzone import Deadzone
from ..geometry import direction, into_body
from ..messages import Command, Measurement, Reference, Start
from ..protocols import Inputs, Motion, Plant


@pytree
class BaseState:
    """State of a vehicle that is driven by velocities."""

    position: Float[Array, "2"]  # m, of the middle of the fixed axle
    heading: Float[Array, ""]  # rad
    reached: Float[Array, "2"]  # what its two motors have reached, in the unit of their inputs


@pytree
class Driven(Plant):
    """What vehicles have in common whose two motors are sent velocities; each brings `twist` and `asked`."""

    commands_heading = False
    command_units: ClassVar[tuple[str, ...]] = ("m/s", "rad/s")  # a twist

    def body(self, reached: Float[Array, "2"]) -> tuple[Array, Array]:
        """Speed [m/s] and yaw rate [rad/s] of what the motors have reached."""
        raise NotImplementedError

    def asked(self, twist: Float[Array, "2"]) -> Float[Array, "2"]:
        """What to send to the motors for a speed [m/s] and a yaw rate [rad/s]."""
        raise NotImplementedError

    def rates(self, reached: Array, delivered: Array, push: Array) -> Array:
        """How fast the motors change, pushed along by `push` [m/s^2]."""
        raise NotImplementedError

    def start(self, start: Start) -> BaseState:
        """At rest, whatever velocity the start has: motors begin with what is sent to them."""
        return BaseState(
            position=jnp.asarray(start.position),
            heading=jnp.asarray(start.heading),
            reached=jnp.zeros_like(jnp.asarray(start.position)),
        )

    def seen(self, measurement: Measurement) -> BaseState:
        """Its motors have reached what moves it so, besides its drift."""
        along, _ = into_body(measurement.velocity, measurement.heading)
        _, drift = self.body(jnp.zeros_like(measurement.position))
        reached = self.asked(jnp.stack([along, measurement.yaw_rate - drift]))
        return BaseState(position=measurement.position, heading=measurement.heading, reached=reached)

    def allocate(self, command: Command, measurement: Measurement) -> Inputs:
        """What to send for a law's twist.

        Raises:
            ValueError: the law gives none; `VelocityReference` makes one of accelerations.
        """
        if command.twist is None:
            kind = type(self).__name__
            raise ValueError(f"{kind} is driven by speed and yaw rate: put the law into agvjax.VelocityReference")
        first, second = self.asked(command.twist)
        return dict(zip(self.actuators, (first, second), strict=True))

    def derivative(
        self, state: BaseState, memory: PyTree, delivered: Inputs, disturbance: Float[Array, "3"]
    ) -> BaseState:
        """X' = v cos psi, y' = v sin psi, psi' = w; see `rates`."""
        speed, yaw_rate = self.body(state.reached)
        push, _ = into_body(disturbance[:2], state.heading)
        sent = jnp.stack([delivered[name] for name in self.actuators])
        return BaseState(
            position=speed * direction(state.heading),
            heading=yaw_rate + disturbance[2],
            reached=self.rates(state.reached, sent, push),
        )

    def output(self, state: BaseState, delivered: Inputs) -> Measurement:
        """Pose and odometry."""
        speed, yaw_rate = self.body(state.reached)
        velocity = speed * direction(state.heading)
        return Measurement(position=state.position, velocity=velocity, heading=state.heading, yaw_rate=yaw_rate)

    def needs(self, motion: Motion) -> dict[str, np.ndarray]:
        """What must be delivered to drive along a path, its axle on it."""
        if motion.asked is None:
            return {}
        inputs = np.asarray(jax.vmap(self.asked)(self._twists(motion.asked)))
        return dict(zip(self.actuators, inputs.T, strict=True))

    def _twists(self, asked: Reference) -> Float[Array, "n 2"]:
        """Speed and yaw rate along a path, at n instants."""
        speed = np.sum(np.asarray(asked.velocity) * np.asarray(_along(asked.heading)), axis=-1)
        return jnp.stack([jnp.asarray(speed), jnp.asarray(asked.heading_rate)], axis=-1)


@pytree
class Base(Driven):
    """A base on two driven wheels side by side, sent the speed of each wheel's rim.

    A law uses the `track` of its own model (`Sampled.vehicle`): a different one here is a calibration error, as are
    `left` and `right`, the true wheel sizes relative to the assumed ones.

    Attributes:
        track: distance between the wheels.
        time_constant: time constant of each motor's speed.
        acceleration: largest acceleration of each wheel's speed.
        drift: added to the yaw rate.
        left: true size of the left wheel, relative to the assumed size.
        right: true size of the right wheel, relative to the assumed size.
    """

    track: Real = number(0.5, "m", POSITIVE)
    time_constant: Real = number(0.15, "s", POSITIVE)
    acceleration: Real = number(1.0, "m/s^2", POSITIVE)
    drift: Real = number(0.0, "rad/s", ANY)
    left: Real = number(1.0, "1", POSITIVE)
    right: Real = number(1.0, "1", POSITIVE)

    actuators = ("left", "right")
    units: ClassVar[Mapping[str, str]] = {"left": "m/s", "right": "m/s"}

    def deadzones(self) -> dict[str, Deadzone]:
        """A wheel that does not turn below 6 cm/s, as carts under ROS do."""
        zone = Deadzone(slope_right=0.95, slope_left=0.95, threshold_right=0.06, threshold_left=0.06)
        return {"left": zone, "right": zone}

    def asked(self, twist: Float[Array, "2"]) -> Float[Array, "2"]:
        """V -+ w track / 2."""
        turn = twist[1] * self.track / 2
        return jnp.stack([twist[0] - turn, twist[0] + turn])

    def body(self, reached: Float[Array, "2"]) -> tuple[Array, Array]:
        """v, and w with its drift."""
        left, right = reached[0] * self.left, reached[1] * self.right
        return (left + right) / 2, (right - left) / self.track + self.drift

    def rates(self, reached: Array, delivered: Array, push: Array) -> Array:
        """A lag, no faster than the acceleration."""
        return jnp.clip((delivered - reached) / self.time_constant, -self.acceleration, self.acceleration) + push


@pytree
class TwistBase(Driven):
    """A base whose motor controller is sent the twist itself: deadzones on speed and on yaw rate.

    Attributes:
        time_constants: time constants of speed and yaw rate.
        accelerations: largest acceleration and yaw acceleration.
        drift: added to the yaw rate.
    """

    time_constants: Array | np.ndarray = number((0.15, 0.15), "s", POSITIVE, shape=(2,))
    accelerations: Array | np.ndarray = number((1.0, 3.0), "m/s^2, rad/s^2", POSITIVE, shape=(2,))
    drift: Real = number(0.0, "rad/s", ANY)

    actuators = ("speed", "yaw_rate")
    units: ClassVar[Mapping[str, str]] = {"speed": "m/s", "yaw_rate": "rad/s"}

    def deadzones(self) -> dict[str, Deadzone]:
        """Nothing below 6 cm/s and .1 rad/s."""
        return {
            "speed": Deadzone(slope_right=0.95, slope_left=0.95, threshold_right=0.06, threshold_left=0.06),
            "yaw_rate": Deadzone(slope_right=0.95, slope_left=0.95, threshold_right=0.1, threshold_left=0.1),
        }

    def asked(self, twist: Float[Array, "2"]) -> Float[Array, "2"]:
        """The twist."""
        return twist

    def body(self, reached: Float[Array, "2"]) -> tuple[Array, Array]:
        """v, and w with its drift."""
        return reached[0], reached[1] + self.drift

    def rates(self, reached: Array, delivered: Array, push: Array) -> Array:
        """Lags, no faster than the accelerations."""
        most = jnp.asarray(self.accelerations)
        rate = jnp.clip((delivered - reached) / jnp.asarray(self.time_constants), -most, most)
        return rate + jnp.stack([push, jnp.zeros_like(push)])


@pytree
class Ackermann(Driven):
    """A vehicle with a steered wheel, sent a speed and a steering angle; a forklift steers behind its fixed axle.

    The steering angle follows with a lag and no faster than `steering_rate`, within `largest_angle`; where the wheel is
    `behind`, a positive angle turns the vehicle to the right when it drives forwards, and so is sent negative.

    Attributes:
        wheelbase: from the fixed axle to the steered one.
        time_constant: time constant of the speed.
        acceleration: largest acceleration.
        steering_time: time constant of the steering.
        steering_rate: largest steering rate.
        largest_angle: largest steering angle, either way; below a quarter turn.
        drift: added to the yaw rate.
        behind: whether the steered wheel is behind the fixed axle, as that of a forklift.
    """

    wheelbase: Real = number(1.2, "m", POSITIVE)
    time_constant: Real = number(0.2, "s", POSITIVE)
    acceleration: Real = number(1.0, "m/s^2", POSITIVE)
    steering_time: Real = number(0.1, "s", POSITIVE)
    steering_rate: Real = number(0.8, "rad/s", POSITIVE)
    largest_angle: Real = number(1.0, "rad", POSITIVE)
    drift: Real = number(0.0, "rad/s", ANY)
    behind: bool = structure(False)

    actuators = ("speed", "steering_angle")
    units: ClassVar[Mapping[str, str]] = {"speed": "m/s", "steering_angle": "rad"}

    def deadzones(self) -> dict[str, Deadzone]:
        """Nothing below 5 cm/s; a steering with 1 degree of it."""
        return {
            "speed": Deadzone(slope_right=0.95, slope_left=0.95, threshold_right=0.05, threshold_left=0.05),
            "steering_angle": Deadzone(threshold_right=0.0175, threshold_left=0.0175),
        }

    def asked(self, twist: Float[Array, "2"]) -> Float[Array, "2"]:
        """V and atan(L w / v), within the largest angle; 0 where it is to stand."""
        return jnp.stack([twist[0], jnp.clip(self._steered(twist), -self.largest_angle, self.largest_angle)])

    def _steered(self, twist: Float[Array, "2"]) -> Float[Array, ""]:
        """The steering angle that a twist takes, whether or not the wheel turns so far."""
        v, w = twist
        stands, side = jnp.abs(v) < CREEP, -1.0 if self.behind else 1.0
        angle = jnp.arctan(self.wheelbase * w / jnp.where(stands, 1.0, v))
        return jnp.where(stands, 0.0, side * angle)

    def needs(self, motion: Motion) -> dict[str, np.ndarray]:
        """What must be delivered to drive along a path, its fixed axle on it; an angle beyond the stops too."""
        if motion.asked is None:
            return {}
        twists = self._twists(motion.asked)
        return super().needs(motion) | {"steering_angle": np.asarray(jax.vmap(self._steered)(twists))}

    def reach(self) -> dict[str, tuple[float, float]]:
        """How far the wheel turns."""
        return super().reach() | {"steering_angle": (-float(self.largest_angle), float(self.largest_angle))}

    def body(self, reached: Float[Array, "2"]) -> tuple[Array, Array]:
        """v, and v tan(angle) / L with its drift."""
        side = -1.0 if self.behind else 1.0
        return reached[0], side * reached[0] * jnp.tan(reached[1]) / self.wheelbase + self.drift

    def rates(self, reached: Array, delivered: Array, push: Array) -> Array:
        """Lags, no faster than acceleration and steering rate; the angle kept within its stops."""
        speed = jnp.clip((delivered[0] - reached[0]) / self.time_constant, -self.acceleration, self.acceleration)
        wanted = jnp.clip(delivered[1], -self.largest_angle, self.largest_angle)
        turn = jnp.clip((wanted - reached[1]) / self.steering_time, -self.steering_rate, self.steering_rate)
        return jnp.stack([speed + push, turn])


_along = jax.vmap(direction)  # unit vectors of headings (n,)
CREEP = 1e-3  # m/s, below which a steered vehicle is not steered: there is no turning on the spot
