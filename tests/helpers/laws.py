"""Laws of one's own, which compile quickly."""

import jax.numpy as jnp

import agvjax


@agvjax.pytree
class Proportional(agvjax.Law):
    """A law as a user would write it: plain fields, no rule, no bounds, a gain that may be negative."""

    stiffness: float = 30.0
    damping: float = 8.0
    turn: float = 4.0
    lean: float = -0.1

    def init(self, measurement, reference):
        return ()

    def law(self, flow, memory, measurement, reference):
        e, de = measurement.position - reference.position, measurement.velocity - reference.velocity
        u = reference.acceleration - self.stiffness * e - self.damping * de + self.lean
        turn = reference.heading_rate - self.turn * (measurement.heading - reference.heading)
        return agvjax.Command(position=u, heading=turn), ()


class OpenLoop(agvjax.Law):
    """Asks the actuators for signals of time, `inputs(t)`, whatever the vehicle does."""

    def init(self, measurement, reference):
        return jnp.zeros_like(measurement.heading)

    def law(self, flow, memory, measurement, reference):
        zero = jnp.zeros_like(flow)
        command = agvjax.Command(position=jnp.stack([zero, zero]), heading=zero, inputs=self.inputs(flow))
        return command, jnp.ones_like(flow)
