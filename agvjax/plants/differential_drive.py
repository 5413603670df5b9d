"""A vehicle on two driven wheels side by side: torques or wheel speeds in, friction at each wheel."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, cast

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from .._pytree import NONNEGATIVE, POSITIVE, Real, number, pytree
from ..actuators.deadzone import Deadzone
from ..geometry import into_body, into_plane
from ..messages import Command, Measurement
from ..protocols import Inputs, Motion
from .road import GRAVITY
from .unicycle import Rolling, RollingState


@pytree
class TorqueDrive:
    """Motors that are given torques [Nm]."""

    actuators = ("torque_left", "torque_right")

    def torque(self, delivered: Array, wheel_speed: Array) -> Array:
        """What is delivered."""
        return delivered

    def request(self, torque: Array, wheel_speed: Array) -> Array:
        """What to ask for."""
        return torque

    def granted(self, asked: Array, wheel_speed: Array) -> Array:
        """The torque that asking for it amounts to."""
        return asked


@pytree
class SpeedDrive:
    """Motors with their own speed loop, which receive wheel speeds [rad/s]: torque = gain (reference - actual).

    Attributes:
        gain: gain of the motors' own speed loop.
    """

    gain: Real = number(2.0, "Nm s/rad", POSITIVE)

    actuators = ("wheel_speed_left", "wheel_speed_right")

    def torque(self, delivered: Array, wheel_speed: Array) -> Array:
        """What the speed loop makes of the speed it is given [Nm]."""
        return self.gain * (delivered - wheel_speed)

    def request(self, torque: Array, wheel_speed: Array) -> Array:
        """The speed to ask for so that the loop gives this torque [rad/s]."""
        return wheel_speed + torque / self.gain

    def granted(self, asked: Array, wheel_speed: Array) -> Array:
        """The torque that asking for this speed amounts to [Nm]."""
        return self.gain * (asked - wheel_speed)


@pytree
class DifferentialDrive(Rolling):
    """Two driven wheels on one axle: M v' = (t_r + t_l) / R, I w' = (t_r - t_l) track / (2 R), less friction.

    Its centre of mass is on the axle. `mass` and `inertia` hold the wheels' own inertia too: mass + 2 J / R^2, and yaw
    inertia + J track^2 / (2 R^2). Friction at each wheel is Coulomb's, smoothed below `creep`, and viscous. Casters
    that slide, half of them ahead of the axle and half behind, resist along their own motion. The defaults are those of
    the robot in `tuning/vehicles/robot.xml`, the friction of its casters counted at the wheels.

    Attributes:
        mass: mass, including the wheels' inertia.
        inertia: yaw inertia, including that of the wheels.
        wheel_radius: radius of the driven wheels.
        track: distance between the wheels.
        viscous: viscous friction of a wheel.
        road_slope: rise of the floor along x and y.
        drive: what is sent to the motors: torques, or wheel speeds.
    """

    L: Real = number(0.15, "m", POSITIVE, "eq. (2)")
    mass: Real = number(12.7, "kg", POSITIVE)
    inertia: Real = number(0.33, "kg m^2", POSITIVE)
    wheel_radius: Real = number(0.1, "m", POSITIVE)
    track: Real = number(0.34, "m", POSITIVE)
    friction: Real = number(0.1, "Nm", NONNEGATIVE, "Coulomb")
    viscous: Real = number(0.01, "Nm s/rad", NONNEGATIVE)
    creep: Real = number(0.1, "rad/s", POSITIVE, "wheel speed by which Coulomb friction has 76 % of its size")
    caster_friction: Real = number(0.0, "N", NONNEGATIVE, "Coulomb, of all casters together")
    caster_distance: Real = number(0.17, "m", POSITIVE, "of every caster from the middle of the axle")
    road_slope: Float[Array, "2"] = number((0.0, 0.0), "m/m, rise along x and y", shape=(2,))
    drive: TorqueDrive | SpeedDrive = TorqueDrive()

    units: ClassVar[Mapping[str, str]] = {
        "torque_left": "Nm",
        "torque_right": "Nm",
        "wheel_speed_left": "rad/s",
        "wheel_speed_right": "rad/s",
    }

    @property
    def actuators(self) -> tuple[str, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Those of the drive, left and right."""
        return self.drive.actuators

    def deadzones(self) -> dict[str, Deadzone]:
        """The same at both wheels, slopes as in section 4."""
        least = 0.15 if isinstance(self.drive, TorqueDrive) else 0.3
        one = Deadzone(slope_right=0.6, slope_left=0.8, threshold_right=least, threshold_left=0.8 * least)
        return dict.fromkeys(self.actuators, one)

    def wheel_speeds(self, speed: Array, yaw_rate: Array) -> tuple[Array, Array]:
        """Left and right [rad/s]."""
        half = yaw_rate * self.track / 2
        return (speed - half) / self.wheel_radius, (speed + half) / self.wheel_radius

    def wheel_torques(self, a: Array, alpha: Array) -> tuple[Array, Array]:
        """Left and right [Nm], for accelerations a [m/s^2] and alpha [rad/s^2], friction aside."""
        common, turning = self.mass * a / 2, self.inertia * alpha / self.track
        return self.wheel_radius * (common - turning), self.wheel_radius * (common + turning)

    def allocate(self, command: Command, measurement: Measurement) -> Inputs:
        """Inputs of the left and the right wheel for R(psi)^T U_bar = (a, L alpha); friction is not compensated."""
        along, across = into_body(command.position, measurement.heading)
        asked = map(self.drive.request, self.wheel_torques(along, across / self.L), self._seen(measurement))
        return dict(zip(self.actuators, asked, strict=True))

    def achieved(self, inputs: Inputs, measurement: Measurement) -> Float[Array, "2"]:
        """The position command [m/s^2] that inputs amount to."""
        asked = (inputs[name] for name in self.actuators)
        left, right = map(self.drive.granted, asked, self._seen(measurement))
        a, alpha = self._accelerations(left, right)
        return into_plane(a, self.L * alpha, measurement.heading)

    def _seen(self, measurement: Measurement) -> tuple[Array, Array]:
        along, across = into_body(measurement.velocity, measurement.heading)
        return self.wheel_speeds(along, across / self.L)

    def _accelerations(self, left: Array, right: Array) -> tuple[Array, Array]:
        a = (right + left) / (self.wheel_radius * self.mass)
        return a, (right - left) * self.track / (2 * self.wheel_radius * self.inertia)

    def derivative(self, state: RollingState, memory: PyTree, delivered: Inputs, disturbance: Array) -> RollingState:
        """Torques, friction and the slope of the road into `Rolling.move`."""
        torques = []
        for name, turning in zip(self.actuators, self.wheel_speeds(state.speed, state.yaw_rate), strict=True):
            drag = self.friction * jnp.tanh(turning / self.creep) + self.viscous * turning
            torques.append(self.drive.torque(delivered[name], turning) - drag)
        a, alpha = self._accelerations(*torques)
        force, moment = self._casters(state.speed, state.yaw_rate)
        a, alpha = a - force / self.mass, alpha - moment / self.inertia
        downhill, _ = into_body(-GRAVITY * jnp.asarray(self.road_slope), state.heading)  # the wheels hold it sideways
        return self.move(state, a + downhill, alpha, disturbance)

    def _casters(self, speed: Array, yaw_rate: Array) -> tuple[Array, Array]:
        """Force [N] along the heading and moment [Nm] with which casters resist; smoothed as at the wheels."""
        side, slowest = yaw_rate * self.caster_distance, self.creep * self.wheel_radius
        share = self.caster_friction / (speed**2 + side**2 + slowest**2) ** 0.5
        return share * speed, share * side * self.caster_distance

    def needs(self, motion: Motion) -> dict[str, np.ndarray]:
        """What must be delivered for speed v, yaw rate w and their rates."""
        v, w, a, alpha = (cast(Array, part) for part in motion[:4])  # NumPy's arrays, whose digits are kept
        force, moment = self._casters(v, w)
        torques = self.wheel_torques(a + force / self.mass, alpha + moment / self.inertia)
        inputs = {}
        for name, turning, torque in zip(self.actuators, self.wheel_speeds(v, w), torques, strict=True):
            drag = self.friction * np.tanh(turning / self.creep) + self.viscous * turning
            inputs[name] = np.asarray(self.drive.request(torque + drag, turning))
        return inputs
