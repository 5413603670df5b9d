"""What vehicles that steer a front wheel have in common: limits, allocation, published parameters.

Althoff & Wuersching, "CommonRoad: Vehicle Models", 2020 (version 2020a, package commonroad-vehicle-models 3.0.2). The
reference point of the control laws is the centre of the FRONT axle, so that the L of eq. (2) is the wheelbase.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import ClassVar, Self

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from .._pytree import ANY, POSITIVE, Real, Rule, number, pytree
from ..actuators.deadzone import Deadzone
from ..geometry import into_body, into_plane
from ..messages import Command, Measurement, Start
from ..protocols import Inputs, Motion, Plant
from .road import GRAVITY
from .tyre import LinearTyre

STILL = 1e-6  # m/s, below which a velocity has no direction
NONPOSITIVE = Rule("<= 0", lambda x: x <= 0, high=0.0)


@pytree
class SteeringLimits:
    """Section 2 of CommonRoad: what wheel, drive and brakes can. The defaults are the BMW 320i's (vehicle 2)."""

    steering_angle: Real = number(1.066, "rad", POSITIVE, "steering max = -min")
    steering_rate: Real = number(0.4, "rad/s", POSITIVE, "steering v_max = -v_min")
    acceleration: Real = number(11.5, "m/s^2", POSITIVE, "longitudinal a_max")
    backward: Real = number(-13.9, "m/s", NONPOSITIVE, "longitudinal v_min")
    forward: Real = number(50.8, "m/s", POSITIVE, "longitudinal v_max")
    switch: Real = number(7.319, "m/s", POSITIVE, "longitudinal v_switch: faster, power is the limit")

    def turns(self, asked: Array, angle: Array) -> Float[Array, ""]:
        """The steering rate [rad/s] that follows from asking for one, at a steering angle [rad]."""
        stop = ((angle <= -self.steering_angle) & (asked <= 0)) | ((angle >= self.steering_angle) & (asked >= 0))
        return jnp.where(stop, 0.0, jnp.clip(asked, -self.steering_rate, self.steering_rate))

    def accelerates(self, asked: Array, speed: Array) -> Float[Array, ""]:
        """The acceleration [m/s^2] that follows from asking for one, at a speed [m/s]."""
        powerful = self.acceleration * self.switch / jnp.maximum(speed, self.switch)
        stop = ((speed <= self.backward) & (asked <= 0)) | ((speed >= self.forward) & (asked >= 0))
        return jnp.where(stop, 0.0, jnp.clip(asked, -self.acceleration, powerful))


@pytree
class Steered(Plant):
    """What vehicles that steer a front wheel have in common. The defaults are the BMW 320i's (vehicle 2)."""

    lf: Real = number(1.1561957064, "m", POSITIVE, "a: from the centre of gravity to the front axle")
    lr: Real = number(1.4227170936, "m", POSITIVE, "b: from the centre of gravity to the rear axle")
    limits: SteeringLimits = SteeringLimits()
    road_slope: Float[Array, "2"] = number((0.0, 0.0), "m/m, rise along x and y", ANY, shape=(2,))
    slowest: Real = number(1.0, "m/s", POSITIVE, "speed below which `allocate` steers as at this one; less for models")

    actuators = ("acceleration", "steering_rate")
    commands_heading = False  # the heading follows from the motion of the reference point
    units: ClassVar[Mapping[str, str]] = {
        "acceleration": "m/s^2",
        "steering_rate": "rad/s",
        "steering_angle": "rad",
        "lateral_acceleration": "m/s^2",
        "speed": "m/s",
    }

    @property
    def L(self) -> Real:
        """Wheelbase [m]: from the rear axle to the reference point, eq. (2)."""
        return self.lf + self.lr

    def seen(self, measurement: Measurement) -> PyTree:
        """The state that a measurement tells, its wheel where it was measured to be."""
        state, angle = super().seen(measurement), measurement.steering_angle
        return state if angle is None else dataclasses.replace(state, steering_angle=angle)

    def lever(self) -> Real:
        """L of eq. (2) [m]."""
        return self.L

    def deadzones(self) -> dict[str, Deadzone]:
        """Slopes as in section 4; acceleration [m/s^2], steering rate [rad/s]."""
        return {
            "acceleration": Deadzone(slope_right=0.6, slope_left=0.8, threshold_right=0.5, threshold_left=0.4),
            "steering_rate": Deadzone(slope_right=0.91, slope_left=0.72, threshold_right=0.03, threshold_left=0.025),
        }

    def allocate(self, command: Command, measurement: Measurement) -> Inputs:
        """Acceleration [m/s^2] and steering rate [rad/s] that give the front point the command as its acceleration.

        In the body's axes, with (v_l, v_t) the point's velocity, r the yaw rate and (u_l, u_t) the command, the point
        accelerates by (v_l' - r v_t, v_t' + r v_l). So a = u_l + r v_t, l alpha = u_t - r v_l, and the angle that rolls
        without slip, tan(delta) = l r / v_l, has to turn by l cos^2(delta) / v_l (alpha - a tan(delta) / l).

        The command is thus the whole acceleration: a law that subtracts F of eq. (4) of its own subtracts it twice.
        Exact for `KinematicSingleTrack` from `slowest` upwards; driving backwards it steers the wrong way.
        """
        along, across, push, side = self._seen(measurement, command.position)
        r, tangent = measurement.yaw_rate, jnp.tan(measurement.steering_angle)
        a = push + r * across
        alpha = (side - r * along) / self.L
        turn = self._lever(along, tangent) * (alpha - a * tangent / self.L)
        return {"acceleration": a, "steering_rate": turn}

    def achieved(self, inputs: Inputs, measurement: Measurement) -> Float[Array, "2"]:
        """The position command [m/s^2] that inputs amount to: `allocate` read backwards."""
        along, across, _, _ = self._seen(measurement, measurement.velocity)
        r, tangent = measurement.yaw_rate, jnp.tan(measurement.steering_angle)
        a = inputs["acceleration"]
        alpha = inputs["steering_rate"] / self._lever(along, tangent) + a * tangent / self.L
        return into_plane(a - r * across, self.L * alpha + r * along, measurement.heading)

    def _seen(self, measurement: Measurement, vector: Array) -> tuple[Array, Array, Array, Array]:
        """The point's velocity and another vector, along the car and across it."""
        return (*into_body(measurement.velocity, measurement.heading), *into_body(vector, measurement.heading))

    def _lever(self, along: Array, tangent: Array) -> Array:
        """What turns rad/s^2 into a steering rate: l cos^2(delta) / max(|v|, slowest) [s]."""
        return self.L / ((1.0 + tangent**2) * jnp.maximum(jnp.abs(along), self.slowest))

    def needs(self, motion: Motion) -> dict[str, np.ndarray]:
        """What must be delivered for speed v, yaw rate w and their rates, without slip, and how that loads the car."""
        (v, w, a, alpha, _), L = motion, float(self.L)
        square = np.maximum(v**2 + (L * w) ** 2, np.finfo(float).tiny)  # cos^2(delta) = v^2 / square
        return {
            "acceleration": a,
            "steering_rate": L * (v * alpha - a * w) / square,
            "steering_angle": np.arctan2(L * w * np.copysign(1.0, v), np.abs(v)),
            "lateral_acceleration": v * w,  # of the rear axle
            "speed": v,
        }

    def reach(self) -> dict[str, tuple[float, float]]:
        """What the plant itself can of what `needs` names; above `limits.switch` it can accelerate less."""
        limits = self.limits
        ends = {name: float(getattr(limits, name)) for name in ("acceleration", "steering_rate", "steering_angle")}
        return {name: (-end, end) for name, end in ends.items()} | {
            "speed": (float(limits.backward), float(limits.forward))
        }

    def _begin(self, start: Start) -> tuple[Array, Array, Array]:
        """Speed of the rear axle [m/s], steering angle [rad] and its tangent, by the velocity of the front point.

        An angle beyond the limit becomes the limit: then, and where the car only moves sideways, the velocity across
        is not the one asked for.
        """
        along, across = into_body(jnp.asarray(start.velocity), jnp.asarray(start.heading))
        moves = jnp.abs(along) > STILL
        wanted = across / jnp.where(moves, along, jnp.where(along < 0, -STILL, STILL))
        most = jnp.tan(self.limits.steering_angle)
        tangent = jnp.clip(wanted, -most, most)
        return along, jnp.arctan(tangent), tangent

    def _outside(self, disturbance: Array) -> Float[Array, "2"]:
        """What accelerates the car besides its tyres [m/s^2]: a push, and gravity where the road is not level."""
        return disturbance[:2] - GRAVITY * jnp.asarray(self.road_slope)

    @classmethod
    def bmw_320i(cls, **changes: PyTree) -> Self:
        """CommonRoad's vehicle 2, which is the default; `changes` as to the constructor."""
        return cls(**changes)

    @classmethod
    def ford_escort(cls, **changes: PyTree) -> Self:
        """CommonRoad's vehicle 1."""
        return cls._published(FORD_ESCORT, changes)

    @classmethod
    def vw_vanagon(cls, **changes: PyTree) -> Self:
        """CommonRoad's vehicle 3."""
        return cls._published(VW_VANAGON, changes)

    @classmethod
    def f1tenth(cls, **changes: PyTree) -> Self:
        """A car at a tenth of the scale: the default parameters of f1tenth_gym, whose equations are nearly these."""
        return cls._published(F1TENTH, changes)

    @classmethod
    def _published(cls, facts: Mapping[str, PyTree], changes: Mapping[str, PyTree]) -> Self:
        """Of the facts those that this class has a field for."""
        names = {f.name for f in dataclasses.fields(cls)}
        return cls(**({name: value for name, value in facts.items() if name in names} | dict(changes)))


FORD_ESCORT = {
    "lf": 0.88392,
    "lr": 1.50876,
    "height": 0.59436,
    "mass": 1225.8878467253344,
    "inertia": 1538.8533713561394,
    "limits": SteeringLimits(steering_angle=0.91, forward=45.8, switch=4.755),
}
VW_VANAGON = {
    "lf": 1.1507916024,
    "lr": 1.3211363976000001,
    "height": 0.804490644,
    "mass": 1478.8979637767998,
    "inertia": 2473.1176915564442,
    "limits": SteeringLimits(steering_angle=1.023, backward=-11.2, forward=41.7, switch=7.824),
}
# github.com/f1tenth/f1tenth_gym, gym/f110_gym/envs/f110_env.py, "params" of default_config, commit 0030945
F1TENTH = {
    "lf": 0.15875,
    "lr": 0.17145,
    "height": 0.074,
    "mass": 3.74,
    "inertia": 0.04712,
    "limits": SteeringLimits(
        steering_angle=0.4189, steering_rate=3.2, acceleration=9.51, backward=-5.0, forward=20.0, switch=7.319
    ),
    "tyre": LinearTyre(mu=1.0489, stiffness_front=4.718, stiffness_rear=5.4562),
    "slowest": 0.3,  # a choice: the wheelbase is an eighth of a car's
}
