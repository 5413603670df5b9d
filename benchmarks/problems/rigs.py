"""Loops of textbooks, posed as plants of one's own: a drive with play in its gear, ball and beam, a pole on a cart."""

import jax.numpy as jnp

import agvjax
from agvjax import POSITIVE, number


@agvjax.pytree
class Sway(agvjax.Path):
    """Back and forth along x; `along` says how far y goes with it."""

    amplitude: float = number(0.5, "m", POSITIVE)
    omega: float = number(1.5, "rad/s", POSITIVE)
    along: float = number(0.0, "1")

    def __call__(self, t):
        """Position."""
        x = self.amplitude * jnp.sin(self.omega * t)
        return jnp.stack([x, self.along * x])


@agvjax.pytree
class Level(agvjax.Heading):
    """No heading is asked for."""

    def __call__(self, path, t):
        """Heading."""
        return jnp.zeros_like(t)


@agvjax.pytree
class RigState:
    """Two positions, their rates, an angle and its rate."""

    position: object
    velocity: object
    heading: object
    yaw_rate: object


class Rig(agvjax.Plant):
    """One input; what a law calls its command along x."""

    actuators = ("drive",)
    commands_heading = False

    def start(self, start):
        """At rest."""
        zero = jnp.zeros_like(jnp.asarray(start.heading))
        rest = jnp.zeros_like(jnp.asarray(start.velocity))
        return RigState(position=start.position, velocity=rest, heading=jnp.asarray(start.heading), yaw_rate=zero)

    def deadzones(self):
        """None to speak of."""
        return {"drive": agvjax.Deadzone(slope_right=1.0, slope_left=1.0, threshold_right=0.0, threshold_left=0.0)}

    def allocate(self, command, measurement):
        """The command itself."""
        return {"drive": command.position[0]}

    def output(self, state, delivered):
        """All of it."""
        return agvjax.Measurement(
            position=state.position, velocity=state.velocity, heading=state.heading, yaw_rate=state.yaw_rate
        )


@agvjax.pytree
class TwoMass(Rig):
    """A load (x) on a soft shaft with play behind a motor (y), angles in rad, the torque per motor inertia."""

    stiffness: float = number(400.0, "1/s^2", POSITIVE)
    damping: float = number(1.0, "1/s", POSITIVE)
    gap: float = number(0.02, "rad", POSITIVE)
    ratio: float = number(2.0, "1", POSITIVE)  # inertia of the load by that of the motor
    friction: float = number(0.5, "1/s", POSITIVE)

    def derivative(self, state, memory, delivered, disturbance):
        """Shaft torque only where the play is used up."""
        (load, motor), (slow, fast) = state.position, state.velocity
        twist = motor - load
        over = twist - jnp.clip(twist, -self.gap / 2, self.gap / 2)
        shaft = jnp.where(over != 0, self.stiffness * over + self.damping * (fast - slow), 0.0)
        rates = jnp.stack(
            [
                shaft / self.ratio - self.friction * slow + disturbance[0],
                delivered["drive"] - shaft - self.friction * fast,
            ]
        )
        zero = jnp.zeros_like(state.heading)
        return RigState(position=state.velocity, velocity=rates, heading=zero, yaw_rate=zero)


@agvjax.pytree
class BallBeam(Rig):
    """A ball that rolls along a beam (x), whose angle (heading) a servo turns at the rate asked for, lagging."""

    lag: float = number(0.08, "s", POSITIVE)
    rolling: float = number(0.1, "1/s", POSITIVE)

    def derivative(self, state, memory, delivered, disturbance):
        """Five sevenths of gravity's pull."""
        pull = -5 / 7 * 9.81 * jnp.sin(state.heading) - self.rolling * state.velocity[0] + disturbance[0]
        turn = (delivered["drive"] - state.yaw_rate) / self.lag
        return RigState(
            position=state.velocity, velocity=jnp.stack([pull, 0 * pull]), heading=state.yaw_rate, yaw_rate=turn
        )


@agvjax.pytree
class CartPole(Rig):
    """A cart (x) of 1 kg that carries a pole (heading is its angle from upright) and is pushed [N]."""

    pole: float = number(0.1, "kg", POSITIVE)
    half: float = number(0.5, "m", POSITIVE)
    friction: float = number(0.1, "N s/m", POSITIVE)

    def derivative(self, state, memory, delivered, disturbance):
        """Barto, Sutton and Anderson's equations."""
        sine, cosine, whole = jnp.sin(state.heading), jnp.cos(state.heading), 1.0 + self.pole
        push = delivered["drive"] - self.friction * state.velocity[0] + whole * disturbance[0]
        inner = (push + self.pole * self.half * state.yaw_rate**2 * sine) / whole
        turn = (9.81 * sine - cosine * inner) / (self.half * (4 / 3 - self.pole * cosine**2 / whole))
        cart = inner - self.pole * self.half * turn * cosine / whole
        return RigState(
            position=state.velocity, velocity=jnp.stack([cart, 0 * cart]), heading=state.yaw_rate, yaw_rate=turn
        )


class OneInput(agvjax.Law):
    """A law whose state is the integral of the error along x."""

    def init(self, measurement, reference):
        """The integral."""
        return jnp.zeros(())

    def law(self, flow, memory, measurement, reference):
        """The command, and what is integrated."""
        error = (measurement.position - reference.position)[0]
        rate = (measurement.velocity - reference.velocity)[0]
        u = self.input(error, rate, flow, measurement, reference)
        return agvjax.Command(position=jnp.stack([u, 0 * u]), heading=jnp.zeros_like(u)), error


@agvjax.pytree
class Cascade(OneInput):
    """Position and integral of the load, speed of the motor."""

    kp: float = number(20.0, "1/s^2", POSITIVE)
    ki: float = number(5.0, "1/s^3", POSITIVE)
    kd: float = number(2.0, "1/s", POSITIVE)
    kv: float = number(5.0, "1/s", POSITIVE)

    def input(self, error, rate, integral, measurement, reference):
        """Torque per inertia."""
        fast = measurement.velocity[1] - reference.velocity[1]
        return 3 * reference.acceleration[0] - self.kp * error - self.ki * integral - self.kd * rate - self.kv * fast


@agvjax.pytree
class Tilt(OneInput):
    """The error of the ball asks for an angle of the beam, which a second loop turns to."""

    kp: float = number(0.3, "rad/m", POSITIVE)
    kd: float = number(0.3, "rad s/m", POSITIVE)
    ki: float = number(0.05, "rad/(m s)", POSITIVE)
    turn: float = number(5.0, "1/s", POSITIVE)

    def input(self, error, rate, integral, measurement, reference):
        """Rate of the beam."""
        angle = self.kp * error + self.kd * rate + self.ki * integral - reference.acceleration[0] * 7 / 5 / 9.81
        return self.turn * (angle - measurement.heading)


@agvjax.pytree
class Balance(OneInput):
    """Feedback of the cart-pole's four states; the cart's act the wrong way round, as they must."""

    cart: float = number(1.0, "N/m", POSITIVE)
    speed: float = number(2.0, "N s/m", POSITIVE)
    angle: float = number(30.0, "N/rad", POSITIVE)
    turning: float = number(5.0, "N s/rad", POSITIVE)

    def input(self, error, rate, integral, measurement, reference):
        """Force on the cart."""
        pole = self.angle * measurement.heading + self.turning * measurement.yaw_rate
        return self.cart * error + self.speed * rate + pole
