"""Vehicles that steer a front wheel: CommonRoad's kinematic (KS) and dynamic (ST) single-track models.

Althoff & Wuersching, "CommonRoad: Vehicle Models", 2020 (version 2020a, package commonroad-vehicle-models 3.0.2). The
reference point of the control laws is the centre of the FRONT axle, so that the L of eq. (2) is the wheelbase.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._pytree import ANY, NONNEGATIVE, POSITIVE, Rule, number, pytree
from ..actuators.deadzone import Deadzone
from ..geometry import into_body, into_plane
from ..messages import Command, Measurement, Start
from ..protocols import Motion, Plant
from .tyre import LinearTyre, SaturatingTyre

GRAVITY = 9.81  # m/s^2
STILL = 1e-6  # m/s, below which a velocity has no direction
CRAWL = 0.1  # m/s, below which CommonRoad's ST rolls without slip
NONPOSITIVE = Rule("<= 0", lambda x: x <= 0, high=0.0)


@pytree
class SteeringLimits:
    """Section 2 of CommonRoad: what wheel, drive and brakes can. The defaults are the BMW 320i's (vehicle 2)."""

    steering_angle: float = number(1.066, "rad", POSITIVE, "steering max = -min")
    steering_rate: float = number(0.4, "rad/s", POSITIVE, "steering v_max = -v_min")
    acceleration: float = number(11.5, "m/s^2", POSITIVE, "longitudinal a_max")
    backward: float = number(-13.9, "m/s", NONPOSITIVE, "longitudinal v_min")
    forward: float = number(50.8, "m/s", POSITIVE, "longitudinal v_max")
    switch: float = number(7.319, "m/s", POSITIVE, "longitudinal v_switch: faster, power is the limit")

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
class KinematicState:
    """State of CommonRoad's KS."""

    position: Float[Array, "2"]  # of the rear axle's centre, m
    steering_angle: Float[Array, ""]  # delta, rad
    speed: Float[Array, ""]  # v, m/s, along the car
    heading: Float[Array, ""]  # psi, rad


@pytree
class SingleTrackState:
    """State of CommonRoad's ST."""

    position: Float[Array, "2"]  # of the centre of gravity, m
    steering_angle: Float[Array, ""]  # delta, rad
    speed: Float[Array, ""]  # v, m/s, of the centre of gravity, along its motion
    heading: Float[Array, ""]  # psi, rad
    yaw_rate: Float[Array, ""]  # r, rad/s
    slip_angle: Float[Array, ""]  # beta, rad, from the heading to the motion


def _unit(angle: Array) -> Float[Array, "2"]:
    return jnp.stack([jnp.cos(angle), jnp.sin(angle)])


@pytree
class Steered(Plant):
    """What vehicles that steer a front wheel have in common. The defaults are the BMW 320i's (vehicle 2)."""

    lf: float = number(1.1561957064, "m", POSITIVE, "a: from the centre of gravity to the front axle")
    lr: float = number(1.4227170936, "m", POSITIVE, "b: from the centre of gravity to the rear axle")
    limits: SteeringLimits = SteeringLimits()
    road_slope: Float[Array, "2"] = number((0.0, 0.0), "m/m, rise along x and y", ANY, shape=(2,))
    slowest: float = number(1.0, "m/s", POSITIVE, "speed below which `allocate` steers as at this one; less for models")

    actuators = ("acceleration", "steering_rate")
    feedthrough = False
    commands_heading = False  # the heading follows from the motion of the reference point

    @property
    def L(self) -> Any:
        """Wheelbase [m]: from the rear axle to the reference point, eq. (2)."""
        return self.lf + self.lr

    def deadzones(self) -> dict[str, Deadzone]:
        """Slopes as in section 4; acceleration [m/s^2], steering rate [rad/s]."""
        return {
            "acceleration": Deadzone(slope_right=0.6, slope_left=0.8, threshold_right=0.5, threshold_left=0.4),
            "steering_rate": Deadzone(slope_right=0.91, slope_left=0.72, threshold_right=0.03, threshold_left=0.025),
        }

    def allocate(self, command: Command, measurement: Measurement) -> dict[str, Array]:
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

    def achieved(self, inputs: dict[str, Array], measurement: Measurement) -> Float[Array, "2"]:
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
        (v, w, a, alpha), L = motion, float(self.L)
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
        along, across = into_body(jnp.asarray(start.velocity), start.heading)  # pyright: ignore[reportArgumentType]
        moves = jnp.abs(along) > STILL
        wanted = across / jnp.where(moves, along, jnp.where(along < 0, -STILL, STILL))
        most = jnp.tan(self.limits.steering_angle)
        tangent = jnp.clip(wanted, -most, most)
        return along, jnp.arctan(tangent), tangent

    def _outside(self, disturbance: Array) -> Float[Array, "2"]:
        """What accelerates the car besides its tyres [m/s^2]: a push, and gravity where the road is not level."""
        return disturbance[:2] - GRAVITY * jnp.asarray(self.road_slope)

    @classmethod
    def bmw_320i(cls, **changes: Any) -> Any:
        """CommonRoad's vehicle 2, which is the default; `changes` as to the constructor."""
        return cls(**changes)

    @classmethod
    def ford_escort(cls, **changes: Any) -> Any:
        """CommonRoad's vehicle 1."""
        return cls._published(FORD_ESCORT, changes)

    @classmethod
    def vw_vanagon(cls, **changes: Any) -> Any:
        """CommonRoad's vehicle 3."""
        return cls._published(VW_VANAGON, changes)

    @classmethod
    def f1tenth(cls, **changes: Any) -> Any:
        """A car at a tenth of the scale: the default parameters of f1tenth_gym, whose equations are nearly these."""
        return cls._published(F1TENTH, changes)

    @classmethod
    def _published(cls, facts: dict[str, Any], changes: dict[str, Any]) -> Any:
        """Of the facts those that this class has a field for."""
        names = {f.name for f in dataclasses.fields(cls)}
        return cls(**({name: value for name, value in facts.items() if name in names} | changes))


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
            position=jnp.asarray(start.position) - self.L * _unit(start.heading),  # pyright: ignore
            steering_angle=delta,
            speed=speed,
            heading=start.heading,  # pyright: ignore[reportArgumentType]
        )

    def derivative(self, state: KinematicState, memory: Any, delivered: dict[str, Array], disturbance: Array) -> Any:
        """CommonRoad, section 5, under what is delivered and a disturbance of shape (3,)."""
        push, _ = into_body(self._outside(disturbance), state.heading)
        return KinematicState(
            position=state.speed * _unit(state.heading),
            steering_angle=self.limits.turns(delivered["steering_rate"], state.steering_angle),
            speed=self.limits.accelerates(delivered["acceleration"], state.speed) + push,
            heading=self._yaw_rate(state) + disturbance[2],
        )

    def output(self, state: KinematicState, delivered: dict[str, Array]) -> Measurement:
        """The front axle's centre, eq. (2), and its rate."""
        r = self._yaw_rate(state)
        return Measurement(
            position=state.position + self.L * _unit(state.heading),
            velocity=into_plane(state.speed, self.L * r, state.heading),
            heading=state.heading,
            yaw_rate=r,
            steering_angle=state.steering_angle,
        )

    def _yaw_rate(self, state: KinematicState) -> Float[Array, ""]:
        return state.speed * jnp.tan(state.steering_angle) / self.L


@pytree
class SingleTrack(Steered):
    """CommonRoad's ST: tyres that slip, load that shifts with acceleration; it rolls without slip below 0.1 m/s.

    A disturbance's first two components [m/s^2] and the slope of the road push the centre of gravity. What of them lies
    along the motion adds to v', what lies across it turns the motion: it adds to beta' what it is divided by v, and
    nothing below 0.1 m/s, where the tyres hold it. The third component [rad/s] adds to the heading's rate, eq. (55).
    They shift no load. Driving backwards faster than 0.1 m/s the published equations are unstable.

    `surface` is the road's factor of the friction coefficient, place by place, see `agvjax.plants.road`; it is asked
    at each axle, and matters to tyres that saturate.
    """

    mass: float = number(1093.2952334674046, "kg", POSITIVE, "m")
    inertia: float = number(1791.5995300122856, "kg m^2", POSITIVE, "I_z")
    height: float = number(0.61373004, "m", NONNEGATIVE, "h_s, of the centre of gravity")
    tyre: LinearTyre | SaturatingTyre = LinearTyre()
    surface: Any = None

    def start(self, start: Start) -> SingleTrackState:
        """The state in which the front point moves as the start says and the rear axle does not slip, see `_begin`."""
        along, delta, tangent = self._begin(start)
        drift = tangent * self.lr / self.L  # tan(beta) = l_r r / v_l
        return SingleTrackState(
            position=jnp.asarray(start.position) - self.lf * _unit(start.heading),  # pyright: ignore
            steering_angle=delta,
            speed=along * jnp.sqrt(1.0 + drift**2),
            heading=start.heading,  # pyright: ignore[reportArgumentType]
            yaw_rate=along * tangent / self.L,
            slip_angle=jnp.arctan(drift),
        )

    def derivative(self, state: SingleTrackState, memory: Any, delivered: dict[str, Array], disturbance: Array) -> Any:
        """CommonRoad, section 6, under what is delivered and a disturbance of shape (3,)."""
        turn = self.limits.turns(delivered["steering_rate"], state.steering_angle)
        a = self.limits.accelerates(delivered["acceleration"], state.speed)
        crawls = jnp.abs(state.speed) < CRAWL
        rolling = jnp.arctan(jnp.tan(state.steering_angle) * self.lr / self.L)  # the slip angle of the crawling car
        motion = state.heading + jnp.where(crawls, rolling, state.slip_angle)
        push, side = into_body(self._outside(disturbance), motion)
        swing, drift = self._slides(state, jnp.where(crawls, 1.0, state.speed), a, side)
        swings, drifts = self._crawls(state, a + push, turn)
        rolls = state.speed * jnp.cos(rolling) * jnp.tan(state.steering_angle) / self.L
        return SingleTrackState(
            position=state.speed * _unit(motion),
            steering_angle=turn,
            speed=a + push,
            heading=jnp.where(crawls, rolls, state.yaw_rate) + disturbance[2],
            yaw_rate=jnp.where(crawls, swings, swing),
            slip_angle=jnp.where(crawls, drifts, drift),
        )

    def _slides(self, state: SingleTrackState, v: Array, a: Array, side: Array) -> tuple[Array, Array]:
        """Derivatives of yaw rate and slip angle at a speed v, by the lateral forces of its axles."""
        front, rear = self._lateral(state, v, a)
        return (self.lf * front - self.lr * rear) * self.mass / self.inertia, (front + rear + side) / v - state.yaw_rate

    def _lateral(self, state: SingleTrackState, v: Array, a: Array) -> tuple[Array, Array]:
        """Lateral forces of front and rear axle over the mass [m/s^2], slip angles and loads CommonRoad's."""
        beta, r = state.slip_angle, state.yaw_rate
        slips = state.steering_angle - beta - self.lf * r / v, self.lr * r / v - beta
        loads = (GRAVITY * self.lr - a * self.height) / self.L, (GRAVITY * self.lf + a * self.height) / self.L
        ahead, behind = self._grounds(state)
        return self.tyre.front(slips[0], loads[0], ahead), self.tyre.rear(slips[1], loads[1], behind)

    def _grounds(self, state: SingleTrackState) -> tuple[Any, Any]:
        """The road's factor of the friction coefficient under front and rear axle."""
        if self.surface is None:
            return 1.0, 1.0
        direction = _unit(state.heading)
        return self.surface(state.position + self.lf * direction), self.surface(state.position - self.lr * direction)

    def _crawls(self, state: SingleTrackState, a: Array, turn: Array) -> tuple[Array, Array]:
        """Derivatives of yaw rate and slip angle below 0.1 m/s, as in the package.

        The derivative of atan(l_r / l tan(delta)) has (l_r / l tan(delta))^2 where the package has
        (l_r / l tan(delta)^2)^2: a slip of theirs, kept so that both give the same. It is noticed at large angles only.
        """
        v, beta, delta = state.speed, state.slip_angle, state.steering_angle
        tangent, ratio = jnp.tan(delta), self.lr / self.L
        opened = turn / jnp.cos(delta) ** 2  # the rate of the tangent
        drift = ratio * opened / (1.0 + (tangent**2 * ratio) ** 2)
        along, across = jnp.cos(beta), jnp.sin(beta)
        return (a * along * tangent - v * across * drift * tangent + v * along * opened) / self.L, drift

    def output(self, state: SingleTrackState, delivered: dict[str, Array]) -> Measurement:
        """The front axle's centre, eq. (2), and its rate."""
        beta, r = state.slip_angle, state.yaw_rate
        along, across = state.speed * jnp.cos(beta), state.speed * jnp.sin(beta) + self.lf * r
        return Measurement(
            position=state.position + self.lf * _unit(state.heading),
            velocity=into_plane(along, across, state.heading),
            heading=state.heading,
            yaw_rate=r,
            steering_angle=state.steering_angle,
        )

    def reach(self) -> dict[str, tuple[float, float]]:
        """What the plant itself can; mu g for the lateral acceleration, whether or not the tyre's model ends there."""
        grip = GRAVITY * float(self.tyre.peak())
        return super().reach() | {"lateral_acceleration": (-grip, grip)}

    def poles(self, speed: float) -> np.ndarray:
        """Poles of slip angle and yaw rate [1/s] driving straight at a speed [m/s] above 0.1; fastest when slowest."""

        def rates(x: Any) -> Any:
            zero = jnp.zeros_like(x[0])
            state = SingleTrackState(
                position=jnp.stack([zero, zero]),
                steering_angle=zero,
                speed=zero + speed,
                heading=zero,
                yaw_rate=x[0],
                slip_angle=x[1],
            )
            return jnp.stack(self._slides(state, zero + speed, zero, zero))

        return np.linalg.eigvals(np.asarray(jax.jacfwd(rates)(jnp.zeros(2)), float))
