"""A mass that is pushed, by a spring and a damper: the double integrator, whose loop has a formula."""

import math

import jax.numpy as jnp

import agvjax
from agvjax import Chain, Command, Deadzone, Delay, Measurement


@agvjax.pytree
class Mass(agvjax.Plant):
    """A mass that is pushed along x: x'' = u."""

    actuators = ("push",)
    commands_heading = False

    def start(self, start):
        return MassState(x=jnp.asarray(start.position)[0], v=jnp.asarray(start.velocity)[0], heading=jnp.zeros(()))

    def allocate(self, command, measurement):
        return {"push": command.position[0]}

    def derivative(self, state, memory, delivered, disturbance):
        return MassState(x=state.v, v=delivered["push"] + disturbance[0], heading=jnp.zeros_like(state.x))

    def output(self, state, delivered):
        zero = jnp.zeros_like(state.x)
        position, velocity = jnp.stack([state.x, zero]), jnp.stack([state.v, zero])
        return Measurement(position=position, velocity=velocity, heading=state.heading, yaw_rate=zero)


@agvjax.pytree
class MassState:
    x: object
    v: object
    heading: object


@agvjax.pytree
class Spring(agvjax.Law):
    """u = -k x - c v."""

    k: float = 4.0
    c: float = 2.0

    def init(self, measurement, reference):
        return ()

    def law(self, flow, memory, measurement, reference):
        push = -self.k * measurement.position[0] - self.c * measurement.velocity[0]
        return Command(position=jnp.stack([push, jnp.zeros_like(push)]), heading=jnp.zeros(())), ()


def mass(delay=0.0, slope=1.0, slots=3):
    return agvjax.Scenario(
        plant=Mass(),
        deadzone={"push": Deadzone(slope_right=slope, slope_left=slope, threshold_right=0.1, threshold_left=0.1)},
        actuators={"push": Chain(delay=Delay(time=delay, slots=slots))} if delay else {},
        disturbance=agvjax.NoDisturbance(),
        path=agvjax.Line(),
        limit=1e9,
    )


def by_formula(k, c, late, slope):
    """L = m (c s + k) / s^2 e^(-s T): where its gain is 1, and what is left of half a turn there."""
    a, b = (slope * c) ** 2, (slope * k) ** 2
    w = math.sqrt((a + math.sqrt(a**2 + 4 * b)) / 2)
    phase = math.atan2(c * w, k) - w * late
    return w, phase, phase / w
