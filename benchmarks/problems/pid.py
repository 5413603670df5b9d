"""Laws that people bring along: PID on the position, and the same with gains that depend on how large the error is."""

import jax.numpy as jnp

import agvjax
from agvjax import POSITIVE, number


@agvjax.pytree
class PID(agvjax.Law):
    """Acceleration of the path, and PID on the error of the position."""

    kp: float = number(2.0, "1/s^2", POSITIVE)
    ki: float = number(0.2, "1/s^3", POSITIVE)
    kd: float = number(2.0, "1/s", POSITIVE)

    def init(self, measurement, reference):
        """The integral of the error."""
        return jnp.zeros(2)

    def law(self, flow, memory, measurement, reference):
        """The command, and what is integrated."""
        error = measurement.position - reference.position
        rate = measurement.velocity - reference.velocity
        position = reference.acceleration - self.kp * error - self.kd * rate - self.ki * flow
        return agvjax.Command(position=position, heading=reference.heading_rate), error


@agvjax.pytree
class Scheduled(agvjax.Law):
    """PID of each axis with gains for large, middling and small errors, and a heading loop of the same kind."""

    xp1: float = number(4.0, "1/s^2", POSITIVE)
    xp2: float = number(4.0, "1/s^2", POSITIVE)
    xp3: float = number(4.0, "1/s^2", POSITIVE)
    xd1: float = number(4.0, "1/s", POSITIVE)
    xd2: float = number(4.0, "1/s", POSITIVE)
    xd3: float = number(4.0, "1/s", POSITIVE)
    xi1: float = number(0.5, "1/s^3", POSITIVE)
    xi2: float = number(0.5, "1/s^3", POSITIVE)
    xi3: float = number(0.5, "1/s^3", POSITIVE)
    yp1: float = number(4.0, "1/s^2", POSITIVE)
    yp2: float = number(4.0, "1/s^2", POSITIVE)
    yp3: float = number(4.0, "1/s^2", POSITIVE)
    yd1: float = number(4.0, "1/s", POSITIVE)
    yd2: float = number(4.0, "1/s", POSITIVE)
    yd3: float = number(4.0, "1/s", POSITIVE)
    yi1: float = number(0.5, "1/s^3", POSITIVE)
    yi2: float = number(0.5, "1/s^3", POSITIVE)
    yi3: float = number(0.5, "1/s^3", POSITIVE)
    turn1: float = number(3.0, "1/s", POSITIVE)
    turn2: float = number(3.0, "1/s", POSITIVE)
    turn3: float = number(3.0, "1/s", POSITIVE)
    still: float = number(0.5, "1/s^2", POSITIVE)

    def init(self, measurement, reference):
        """The integrals of the errors."""
        return jnp.zeros(3)

    def law(self, flow, memory, measurement, reference):
        """The command, and what is integrated."""
        e = measurement.position - reference.position
        rate = measurement.velocity - reference.velocity
        turned = agvjax.wrap(measurement.heading - reference.heading)

        def gain(x, large, middle, small):
            near, mid = jnp.exp(-((x / 0.05) ** 2)), jnp.exp(-((x / 0.25) ** 2))
            return large * (1 - mid) + middle * (mid - near) + small * near

        kp = jnp.stack([gain(e[0], self.xp1, self.xp2, self.xp3), gain(e[1], self.yp1, self.yp2, self.yp3)])
        kd = jnp.stack([gain(e[0], self.xd1, self.xd2, self.xd3), gain(e[1], self.yd1, self.yd2, self.yd3)])
        ki = jnp.stack([gain(e[0], self.xi1, self.xi2, self.xi3), gain(e[1], self.yi1, self.yi2, self.yi3)])
        turn = gain(turned, self.turn1, self.turn2, self.turn3) * turned + self.still * flow[2]
        command = agvjax.Command(
            position=reference.acceleration - kp * e - kd * rate - ki * flow[:2],
            heading=reference.heading_rate - turn,
        )
        return command, jnp.append(e, turned)
