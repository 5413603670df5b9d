"""Laws of one's own, which compile quickly."""

import jax.numpy as jnp
import numpy as np

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


PERIOD = 0.05  # s, of `Sent`


@agvjax.pytree
class Sent(agvjax.Law):
    """A twist after the other, held for 50 ms each."""

    twists: np.ndarray

    def init(self, measurement, reference):
        return jnp.zeros_like(measurement.heading)

    def law(self, flow, memory, measurement, reference):
        twists = jnp.asarray(self.twists)
        index = jnp.clip(jnp.floor((flow + 1e-6) / PERIOD).astype(int), 0, len(twists) - 1)
        twist = twists[index]
        return agvjax.Command(position=twist, heading=jnp.zeros_like(flow), twist=twist), jnp.ones_like(flow)


def recorded(seed=0, turn=1.5):
    """Half a hundred twists: a slow walk, jumps, standing still, backwards, less than the deadzone."""
    random = np.random.default_rng(seed)
    v = np.r_[np.full(10, 0.8), random.uniform(-0.2, 0.9, 16), np.full(4, 0.03), np.full(4, 0.0), np.full(16, -0.5)]
    return np.column_stack([v, random.uniform(-turn, turn, 50) * np.r_[np.ones(10) / 3, np.ones(40)]])
