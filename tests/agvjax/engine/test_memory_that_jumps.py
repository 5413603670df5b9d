"""The protocol of `agvjax.loop` as a user would use it: sampled laws, delays, lags, noise, other plants."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
import reference
from reference import Parameters


@agvjax.pytree
class Sampled(agvjax.Law):
    """A law that looks only at control instants: it holds its command and steps the inner law's state by Euler."""

    inner: Any

    def init(self, measurement, ref):
        return ()

    def hold(self, measurement, ref):
        state = self.inner.init(measurement, ref)
        command, _ = self.inner.law(state, (), measurement, ref)
        return state, command, jnp.zeros_like(measurement.heading)

    def jump(self, flow, memory, measurement, ref, h):
        state, _, count = memory
        command, rate = self.inner.law(state, (), measurement, ref)
        return jax.tree.map(lambda s, r: s + h * r, state, rate), command, count + 1

    def law(self, flow, memory, measurement, ref):
        return memory[1], ()


def sampled_by_hand(p, dt, every, n_steps):
    """States of a zero-order-hold loop: the plant by Euler at dt, the law at every * dt."""
    s, states, commands = reference.initial_state(p), [], []
    for i in range(n_steps + 1):
        t = i * dt
        if i % every == 0:
            u = reference.commands(t, s, p)
            law_rate = reference.right_hand_side(t, s, p)[5:]
        states.append(s)
        commands.append(u)
        *push, omega = reference.delivered(u, p)
        delta = 0.2 * np.cos(0.5 * t)
        velocity = s[2:4]
        force = omega * np.array([-velocity[1], velocity[0]]) + push + delta
        rate = np.array([*velocity, *force, omega + delta])
        law = s[5:] + every * dt * law_rate if i % every == 0 else s[5:]
        s = np.concatenate([s[:5] + dt * rate, law])
    return np.array(states), np.array(commands)


@pytest.mark.parametrize("every", [1, 5])
def test_sampled_law_is_the_hand_written_loop(every):
    dt, n_steps = 5e-4, 1000
    states, commands = sampled_by_hand(Parameters(), dt, every, n_steps)
    settings = {"dt": dt, "n_steps": n_steps, "control_every": every, "integrator": agvjax.EULER}
    run = agvjax.simulate(Sampled(inner=agvjax.NeuroBackstepping()), agvjax.Scenario(), **settings)
    np.testing.assert_allclose(run.command, commands, rtol=0, atol=1e-8)
    np.testing.assert_allclose(np.column_stack([run.position, run.velocity, run.heading]), states[:, :5], atol=1e-9)
    changes = np.flatnonzero((np.diff(run.command, axis=0) != 0).any(axis=1)) + 1
    np.testing.assert_array_equal(changes, np.arange(every, n_steps + 1, every))  # held for exactly `every` steps
    assert run.weight_norm is None


def test_sampled_law_tends_to_the_continuous_law():
    # to t = .1 s, in the first order of the period
    exact = reference.solve(Parameters(), horizon=0.2, times=[0.0, 0.1])[1][1, :5]
    off = []
    for dt, at in ((2e-4, 500), (1e-4, 1000)):
        run = agvjax.simulate(Sampled(inner=agvjax.NeuroBackstepping()), agvjax.Scenario(), dt=dt, n_steps=1000)
        end = np.array([*run.position[at], *run.velocity[at], run.heading[at]])
        off.append(np.abs(end - exact).max())
    assert off[1] < 0.02
    assert 0.4 < off[1] / off[0] < 0.6


@pytest.mark.slow
def test_memory_jumps_when_saving_less_often_too():
    every = {"dt": 1e-3, "n_steps": 200, "control_every": 5}
    fine = agvjax.simulate(Sampled(inner=agvjax.NeuroBackstepping()), agvjax.Scenario(), **every)
    coarse = agvjax.simulate(Sampled(inner=agvjax.NeuroBackstepping()), agvjax.Scenario(), save_every=8, **every)
    np.testing.assert_allclose(coarse.position, fine.position[::8], atol=1e-13)
    # the command that is saved is the one in force: where saving and control instants meet, the new one
    np.testing.assert_allclose(coarse.command, fine.command[::8], atol=1e-10)


@agvjax.pytree
class Delay(agvjax.Element):
    """Delivers the command of three control instants ago, and before that the first one."""

    line: Any = None

    def hold(self, u):
        return jnp.stack([u] * 4)

    def deliver(self, flow, memory, u):
        return memory[-1], ()

    def jump(self, flow, memory, u, h):
        return jnp.concatenate([u[None], memory[:-1]])


def test_delay_line_delivers_the_command_of_three_steps_ago():
    scenario = agvjax.Scenario(deadzone={"position": Delay(), "heading": agvjax.Decoupled().deadzones()["heading"]})
    run = agvjax.simulate(agvjax.NeuroBackstepping(), scenario, n_steps=200)
    np.testing.assert_allclose(run.delivered[3:, :2], run.command[:-3, :2], rtol=1e-12)
    np.testing.assert_allclose(run.delivered[:3, :2], np.broadcast_to(run.command[0, :2], (3, 2)), rtol=1e-12)
    np.testing.assert_allclose(run.delivered[:, 2], reference.deadzone(run.command[:, 2], 0.91, 0.72, 0.66, 0.53))


@agvjax.pytree
class Lag(agvjax.Element):
    """A first-order lag, at rest at the start."""

    time_constant: Any = 0.05

    def init(self, u):
        return jnp.zeros_like(u)

    def deliver(self, flow, memory, u):
        return flow, (u - flow) / self.time_constant


@agvjax.pytree
class Constant(agvjax.Law):
    """Asks for the same always."""

    level: Any = 2.0

    def init(self, measurement, ref):
        return ()

    def law(self, flow, memory, measurement, ref):
        u = jnp.zeros_like(measurement.heading) + self.level
        return agvjax.Command(position=jnp.stack([u, -u]), heading=0.5 * u), ()


def test_lag_answers_a_step_as_the_exponential_does():
    lags = {"position": Lag(), "heading": Lag(time_constant=0.2)}
    scenario = agvjax.Scenario(deadzone=lags, disturbance=agvjax.NoDisturbance())
    run = agvjax.simulate(Constant(), scenario, n_steps=400)
    t = np.asarray(run.t)
    np.testing.assert_allclose(run.delivered[:, 0], 2 * (1 - np.exp(-t / 0.05)), atol=1e-8)
    np.testing.assert_allclose(run.delivered[:, 1], -2 * (1 - np.exp(-t / 0.05)), atol=1e-8)
    np.testing.assert_allclose(run.delivered[:, 2], 1 - np.exp(-t / 0.2), atol=1e-9)
    # psi' = delivered, so psi = .1 + t - .2 (1 - exp(-t / .2))
    np.testing.assert_allclose(run.heading, 0.1 + t - 0.2 * (1 - np.exp(-t / 0.2)), atol=1e-9)


@agvjax.pytree
class NoisyCompass(agvjax.Sensor):
    """Adds a new random offset to the heading at every control instant; the key travels in the memory."""

    key: Any
    level: Any = 0.01

    def hold(self, measurement):
        return self.key, jnp.zeros_like(measurement.heading)

    def jump(self, memory, measurement, h):
        key, now = jax.random.split(memory[0])
        return key, self.level * jax.random.normal(now, (), measurement.heading.dtype)

    def __call__(self, memory, measurement):
        return dataclasses.replace(measurement, heading=measurement.heading + memory[1])


@agvjax.pytree
class HeadingEcho(agvjax.Law):
    """Commands the heading it is shown, so that the trajectory says what the sensor said."""

    unused: Any = 0.0

    def init(self, measurement, ref):
        return ()

    def law(self, flow, memory, measurement, ref):
        return agvjax.Command(position=jnp.zeros_like(measurement.position), heading=measurement.heading), ()


@pytest.mark.parametrize("every", [1, 4])
def test_noise_is_what_its_key_says(every):
    key, n_steps = jax.random.key(7), 40
    scenario = agvjax.Scenario(sensor=NoisyCompass(key=key))
    run = agvjax.simulate(HeadingEcho(), scenario, n_steps=n_steps, control_every=every)
    noise, drawn = np.asarray(run.command[:, 2] - run.heading), []
    for _ in range(n_steps // every + 1):
        key, now = jax.random.split(key)
        drawn.append(0.01 * float(jax.random.normal(now)))
    np.testing.assert_allclose(noise, np.repeat(drawn, every)[: n_steps + 1], rtol=0, atol=1e-14)
    again = agvjax.simulate(HeadingEcho(), scenario, n_steps=n_steps, control_every=every)
    np.testing.assert_array_equal(run.command, again.command)
    scenario = agvjax.Scenario(sensor=NoisyCompass(key=jax.random.key(8)))
    other = agvjax.simulate(HeadingEcho(), scenario, n_steps=n_steps, control_every=every)
    assert (np.asarray(other.command) != np.asarray(run.command))[:, 2].all()


@agvjax.pytree
class CartState:
    """A cart on a rail and what it has counted."""

    position: Any
    velocity: Any
    heading: Any


@agvjax.pytree
class Cart(agvjax.Plant):
    """Mass on a spring along x, pushed by `motor`, slowed by `brake` that takes the heading command."""

    stiffness: Any = 9.0
    actuators = ("motor", "brake")
    feedthrough = False

    def start(self, start):
        return CartState(position=start.position[0], velocity=start.velocity[0], heading=start.heading)

    def allocate(self, command, state):
        return {"motor": command.position[0], "brake": command.heading}

    def hold(self, state):
        return jnp.zeros_like(state.position)

    def jump(self, state, memory, delivered, h):
        return memory + h * delivered["motor"]  # impulse counted at control instants

    def derivative(self, state, memory, delivered, disturbance):
        force = delivered["motor"] - self.stiffness * state.position - delivered["brake"] * state.velocity
        return CartState(position=state.velocity, velocity=force, heading=memory)

    def output(self, state, delivered):
        zero = jnp.zeros_like(state.position)
        position, velocity = jnp.stack([state.position, zero]), jnp.stack([state.velocity, zero])
        return agvjax.Measurement(position=position, velocity=velocity, heading=state.heading, yaw_rate=zero)


def test_plant_with_other_actuators_follows_its_own_closed_form():
    dz = agvjax.Deadzone(slope_right=0.5, threshold_right=1.0)
    scenario = agvjax.Scenario(plant=Cart(), deadzone={"motor": dz, "brake": agvjax.Deadzone()})
    run = agvjax.simulate(Constant(), scenario, n_steps=500)
    # x'' = .5 (2 - 1) - 9 x - 1 x'; x(0) = -.5, x'(0) = .1
    rest, decay, omega = 0.5 / 9.0, 0.5, np.sqrt(9.0 - 0.25)
    t, a = np.asarray(run.t), -0.5 - rest
    x = rest + np.exp(-decay * t) * (a * np.cos(omega * t) + (0.1 + decay * a) / omega * np.sin(omega * t))
    np.testing.assert_allclose(run.position[:, 0], x, atol=1e-11)
    assert run.delivered.shape == (501, 2)
    np.testing.assert_allclose(run.delivered, np.broadcast_to([0.5, 1.0], (501, 2)))
    # step i runs with the impulse (i + 1) h .5, so the heading adds up h^2 .5 (1 + 2 + ... + n)
    n = np.arange(501)
    np.testing.assert_allclose(run.heading, 0.1 + 1e-6 * 0.5 * n * (n + 1) / 2, atol=1e-13)
