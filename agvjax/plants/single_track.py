"""CommonRoad's dynamic single-track model (ST): a car with tyres that slip.

Althoff & Wuersching, "CommonRoad: Vehicle Models", 2020 (version 2020a, package commonroad-vehicle-models 3.0.2).
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from .._pytree import NONNEGATIVE, POSITIVE, Real, number, pytree
from ..geometry import direction, into_body, into_plane
from ..messages import Measurement, Start
from ..protocols import Inputs
from .road import GRAVITY
from .steered import Steered
from .tyre import LinearTyre, SaturatingTyre

CRAWL = 0.1  # m/s, below which it rolls without slip


@pytree
class SingleTrackState:
    """State of CommonRoad's ST."""

    position: Float[Array, "2"]  # of the centre of gravity, m
    steering_angle: Float[Array, ""]  # delta, rad
    speed: Float[Array, ""]  # v, m/s, of the centre of gravity, along its motion
    heading: Float[Array, ""]  # psi, rad
    yaw_rate: Float[Array, ""]  # r, rad/s
    slip_angle: Float[Array, ""]  # beta, rad, from the heading to the motion


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

    mass: Real = number(1093.2952334674046, "kg", POSITIVE, "m")
    inertia: Real = number(1791.5995300122856, "kg m^2", POSITIVE, "I_z")
    height: Real = number(0.61373004, "m", NONNEGATIVE, "h_s, of the centre of gravity")
    tyre: LinearTyre | SaturatingTyre = LinearTyre()
    surface: Callable[[Float[Array, "2"]], Real] | None = None

    def start(self, start: Start) -> SingleTrackState:
        """The state in which the front point moves as the start says and the rear axle does not slip, see `_begin`."""
        along, delta, tangent = self._begin(start)
        drift = tangent * self.lr / self.L  # tan(beta) = l_r r / v_l
        return SingleTrackState(
            position=jnp.asarray(start.position) - self.lf * direction(jnp.asarray(start.heading)),
            steering_angle=delta,
            speed=along * jnp.sqrt(1.0 + drift**2),
            heading=jnp.asarray(start.heading),
            yaw_rate=along * tangent / self.L,
            slip_angle=jnp.arctan(drift),
        )

    def derivative(
        self, state: SingleTrackState, memory: PyTree, delivered: Inputs, disturbance: Array
    ) -> SingleTrackState:
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
            position=state.speed * direction(motion),
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

    def _grounds(self, state: SingleTrackState) -> tuple[Real, Real]:
        """The road's factor of the friction coefficient under front and rear axle."""
        if self.surface is None:
            return 1.0, 1.0
        along = direction(state.heading)
        return self.surface(state.position + self.lf * along), self.surface(state.position - self.lr * along)

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

    def output(self, state: SingleTrackState, delivered: Inputs) -> Measurement:
        """The front axle's centre, eq. (2), and its rate."""
        beta, r = state.slip_angle, state.yaw_rate
        along, across = state.speed * jnp.cos(beta), state.speed * jnp.sin(beta) + self.lf * r
        return Measurement(
            position=state.position + self.lf * direction(state.heading),
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

        def rates(x: Array) -> Array:
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
