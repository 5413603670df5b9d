"""Classes of one's own, one of each kind that `--import` brings."""

import jax.numpy as jnp
import numpy as np

import agvjax

WHEELS = ("wheel_1", "wheel_2", "wheel_3")
ANGLES = np.deg2rad([90.0, 210.0, 330.0])  # where the wheels stand on the body, seen from its x axis


@agvjax.pytree
class OmniState:
    """Of the middle of the body."""

    position: jnp.ndarray  # (2,), m
    velocity: jnp.ndarray  # (2,), m/s
    heading: jnp.ndarray  # (), rad
    yaw_rate: jnp.ndarray  # (), rad/s


@agvjax.pytree
class Omni(agvjax.Plant):
    """A platform on three omni wheels, which moves along x and y and turns, all at once.

    A wheel at angle b on the body drives along (-sin b, cos b): its acceleration is that of the body along that line,
    plus R times the angular acceleration.
    """

    R: float = agvjax.number(0.2, "m")
    stiffness: float = agvjax.number(20.0, "1/s")  # of the loop that makes the yaw rate what the law asks for

    actuators = WHEELS
    units = dict.fromkeys(WHEELS, "m/s^2")

    def deadzones(self):
        """The same for every wheel."""
        nominal = {"slope_right": 0.9, "slope_left": 0.8, "threshold_right": 0.2, "threshold_left": 0.3}
        return {wheel: agvjax.Deadzone(**nominal) for wheel in WHEELS}

    def start(self, start):
        """At rest in turning."""
        still = jnp.zeros_like(start.heading)
        return OmniState(position=start.position, velocity=start.velocity, heading=start.heading, yaw_rate=still)

    def allocate(self, command, measurement):
        """Each wheel's share of a command (2,) [m/s^2] and a yaw rate [rad/s]."""
        turn = self.stiffness * (command.heading - measurement.yaw_rate)
        x, y = command.position
        lines = measurement.heading + ANGLES
        wheels = -jnp.sin(lines) * x + jnp.cos(lines) * y + self.R * turn
        return dict(zip(WHEELS, wheels, strict=True))

    def achieved(self, inputs, measurement):
        """The command (2,) [m/s^2] that the wheels' accelerations amount to."""
        lines, wheels = measurement.heading + ANGLES, jnp.stack([inputs[name] for name in WHEELS])
        return 2 / 3 * jnp.stack([-jnp.sin(lines) @ wheels, jnp.cos(lines) @ wheels])

    def derivative(self, state, memory, delivered, disturbance):
        """The body under what the wheels deliver."""
        turn = sum(delivered[name] for name in WHEELS) / (3 * self.R)
        push = self.achieved(delivered, self.output(state, delivered)) + disturbance[:2]
        rate = state.yaw_rate + disturbance[2]
        return OmniState(position=state.velocity, velocity=push, heading=rate, yaw_rate=turn)

    def output(self, state, delivered):
        """All of the state."""
        return agvjax.Measurement(**vars(state))


@agvjax.pytree
class Spring(agvjax.Law):
    """A spring and a damper to the path."""

    kp: float = agvjax.number(9.0, "1/s^2")
    kd: float = agvjax.number(6.0, "1/s")
    kpsi: float = agvjax.number(5.0, "1/s")

    def init(self, measurement, reference):
        """It remembers nothing."""
        return ()

    def law(self, flow, memory, measurement, reference):
        """Command (2,) [m/s^2] and yaw rate [rad/s]."""
        error, rate = measurement.position - reference.position, measurement.velocity - reference.velocity
        turned = jnp.sin(measurement.heading - reference.heading)
        position = reference.acceleration - self.kp * error - self.kd * rate
        return agvjax.Command(position=position, heading=reference.heading_rate - self.kpsi * turned), ()


@agvjax.pytree
class Spiral(agvjax.Path):
    """A circle whose radius grows."""

    radius: float = agvjax.number(1.0, "m")
    growth: float = agvjax.number(0.05, "m/s")

    def __call__(self, t):
        """Position (2,) [m]."""
        return (self.radius + self.growth * t) * jnp.stack([jnp.cos(0.5 * t), jnp.sin(0.5 * t)])


@agvjax.pytree
class Upright(agvjax.Heading):
    """The same heading all the time."""

    angle: float = agvjax.number(0.3, "rad")

    def __call__(self, path, t):
        """Heading [rad]."""
        return self.angle + 0 * t


@agvjax.pytree
class Gust(agvjax.Disturbance):
    """A push along x that comes and goes."""

    amplitude: float = agvjax.number(0.2, "m/s^2")

    def __call__(self, t):
        """Disturbance (3,) [m/s^2, m/s^2, rad/s]."""
        return self.amplitude * jnp.exp(-((t - 1) ** 2)) * jnp.array([1.0, 0, 0])


@agvjax.pytree
class Wear(agvjax.Element):
    """An actuator that delivers a share of what it is asked for."""

    share: float = agvjax.number(0.8, "1")

    def __call__(self, u):
        """What is delivered."""
        return self.share * u


@agvjax.pytree
class Offset(agvjax.Sensor):
    """A heading measured with a constant error."""

    angle: float = agvjax.number(0.02, "rad")

    def __call__(self, memory, measurement):
        """What the law is told."""
        return agvjax.replace(measurement, {"heading": measurement.heading + self.angle})
