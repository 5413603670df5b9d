"""Elements between command and vehicle: what each delivers, in what order, and with what slope."""

import os
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from agvjax import Backlash, Chain, Deadzone, Delay, Lag, Quantisation, RateLimit, Saturation, Scenario, Unicycle
from agvjax.hashed import uniform
from laws import OpenLoop


@agvjax.pytree
class Played(OpenLoop):
    """Asks the first actuator for a signal of time, the second for nothing."""

    amplitude: float = agvjax.number(1.0)
    omega: float = agvjax.number(2.0)

    def inputs(self, t):
        return {"acceleration": self.signal(t), "yaw_acceleration": jnp.zeros_like(t)}

    def signal(self, t):
        return self.amplitude * jnp.sin(self.omega * t)


@agvjax.pytree
class Stepped(Played):
    """0 for half a second, then the amplitude, held; back to half of it at 1 s."""

    def signal(self, t):
        return self.amplitude * jnp.where(t < 0.4999, 0.0, jnp.where(t < 0.9999, 1.0, 0.5))


def delivered(element, law=None, n_steps=2000, dt=1e-3, **deadzone):
    """What the first actuator delivers, and the instants."""
    idle = {"acceleration": Deadzone(**deadzone), "yaw_acceleration": Deadzone()}
    scenario = Scenario.of(Unicycle(), deadzone=idle, actuators={"acceleration": element})
    run = agvjax.simulate(Played() if law is None else law, scenario, dt=dt, n_steps=n_steps)
    return np.asarray(run.t), np.asarray(run.delivered[:, 0]), run


def test_saturation_clips_and_says_so():
    t, out, run = delivered(Chain(saturation=Saturation(upper=0.5, lower=-0.25)))
    np.testing.assert_allclose(out, np.clip(np.sin(2 * t), -0.25, 0.5), atol=1e-12)
    np.testing.assert_array_equal(run.limited, (np.sin(2 * t) > 0.5) | (np.sin(2 * t) < -0.25))
    limited = agvjax.measure(run, agvjax.Criteria(delivered=True)).limited
    assert limited == pytest.approx(np.mean(np.asarray(run.limited)), abs=1e-3)


def test_quantisation_rounds_to_the_nearest_multiple_and_has_the_slope_of_a_wire():
    t, out, _ = delivered(Chain(quantisation=Quantisation(step=0.25)))
    np.testing.assert_allclose(out, 0.25 * np.round(np.sin(2 * t) / 0.25), atol=1e-12)
    assert jax.grad(lambda u: Quantisation(step=0.25)(u))(0.3) == 1.0


def test_lag_answers_a_sine_as_its_frequency_response_says():
    t, out, _ = delivered(Chain(lag=Lag(time_constant=0.1)), n_steps=4000)
    response = 1 / (1 + 0.2j)  # at 2 rad/s
    steady = np.abs(response) * np.sin(2 * t + np.angle(response))
    np.testing.assert_allclose(out[2000:], steady[2000:], atol=1e-8)


def test_backlash_stands_still_until_the_gap_is_crossed():
    t, out, _ = delivered(Chain(backlash=Backlash(gap=0.4)), n_steps=6000)
    # from 0: follows sin - .2 up to .8, holds until the input has fallen to .6, then is pushed down as sin + .2
    u = np.sin(2 * t)
    up, fallen, down = t < np.pi / 4, (t > np.pi / 4) & (u > 0.6), (t < 3 * np.pi / 4) & (t > 1.25)
    np.testing.assert_allclose(out[up], np.maximum(u[up] - 0.2, 0), atol=1e-12)
    np.testing.assert_allclose(out[fallen & (t < 1.2)], 0.8, atol=1e-6)
    np.testing.assert_allclose(out[down], u[down] + 0.2, atol=1e-12)


def test_rate_limit_ramps_and_delivers_the_mean_of_its_ramp():
    t, out, _ = delivered(Chain(rate_limit=RateLimit(rate=4.0)), law=Stepped(amplitude=1.0), n_steps=1500)
    area = np.cumsum(out) * 1e-3  # held over a step, so this is the integral exactly
    exact = 0.5 * 4.0 * np.clip(t - 0.5, 0, 0.25) ** 2 + np.clip(t - 0.75, 0, 0.25)
    np.testing.assert_allclose(area[:999], exact[1:1000], atol=1e-9)
    assert np.abs(np.diff(out)).max() <= 4.0 * 1e-3 + 1e-12


@pytest.mark.parametrize("time, dt", [(0.02, 1e-3), (0.0125, 1e-3), (0.02, 5e-3), (0.0, 1e-3)])
def test_delay_moves_the_signal_by_its_time(time, dt):
    n_steps = round(2 / dt)
    t, out, _ = delivered(Chain(delay=Delay(time=time)), law=Stepped(), n_steps=n_steps, dt=dt)
    area = np.cumsum(out) * dt
    exact = np.clip(t + dt - 0.5 - time, 0, 0.5) + 0.5 * np.clip(t + dt - 1.0 - time, 0, None)
    np.testing.assert_allclose(area, exact, atol=1e-9)


MAPPED = """
import re, agvjax, jax, jax.numpy as jnp
from pathlib import Path
from agvjax import Base, Chain, Delay, PathPID, Route, Sampled, Scenario
chain = Chain(delay=Delay(slots=24))
scenario = Scenario.of(Base(), path=Route.through([[0.0, 0.0], [80.0, 0.0]]), actuators={"left": chain, "right": chain})
def last(time):
    one = agvjax.replace(scenario, {"actuators.left.delay.time": time})
    law = Sampled(inner=PathPID(), vehicle=Base())
    return agvjax.simulate(law, one, dt=0.005, n_steps=200, save_every=10).position[-1]
print(jax.vmap(last)(jnp.linspace(0.05, 0.2, 17)).shape)
print(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text()).group(1))
"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="memory is asked of Linux")
def test_a_delay_for_each_robot_is_compiled_within_two_gigabytes():
    """With agvjax's compiler options; a chain of slots that names each one twice took over nine."""
    environment = {k: v for k, v in os.environ.items() if k != "XLA_FLAGS"}
    environment |= {"AGVJAX_XLA": "", "JAX_ENABLE_COMPILATION_CACHE": "0"}
    done = subprocess.run([sys.executable, "-c", MAPPED], env=environment, capture_output=True, text=True, check=True)
    shape, kilobytes = done.stdout.split("\n")[:2]
    assert shape == "(17, 2)" and int(kilobytes) < 2_000_000


def test_delay_of_a_signal_that_changes_every_step_needs_the_slots_for_it():
    t, out, _ = delivered(Chain(delay=Delay(time=0.005, slots=7)))
    late = np.interp(t - 0.005, t, np.sin(2 * t))
    np.testing.assert_allclose(out[10:], late[10:], atol=1e-9)


def test_jitter_adds_a_part_of_itself_that_its_seed_decides():
    def arrival(seed, jitter=0.02):
        delay = Delay(time=0.02, jitter=jitter, seed=seed, slots=4)
        _, out, _ = delivered(Chain(delay=delay), law=Stepped(), n_steps=700)
        return 0.7 + 1e-3 - np.sum(out) * 1e-3 - 0.5  # when the step of height 1 came through

    found = np.array([arrival(seed) for seed in range(6)])
    assert (found >= 0.02 - 1e-9).all() and (found <= 0.04).all()
    assert len(set(np.round(found, 6))) == 6
    assert arrival(3) == found[3]
    assert arrival(3, 0.0) == pytest.approx(0.02, abs=1e-9)


def test_hashed_numbers_are_spread_evenly():
    drawn = np.asarray(jax.vmap(lambda i: uniform(7.0, i))(jnp.arange(20_000.0)))
    assert drawn.min() >= 0 and drawn.max() < 1
    np.testing.assert_allclose(np.histogram(drawn, 10, (0, 1))[0], 2000, atol=4 * np.sqrt(1800))
    assert abs(np.corrcoef(drawn[:-1], drawn[1:])[0, 1]) < 0.02


def test_a_chain_runs_in_its_order_and_keeps_it():
    first = Chain(saturation=Saturation(upper=1.0, lower=-1.0), deadzone=Deadzone(threshold_right=0.5))
    last = Chain(deadzone=Deadzone(threshold_right=0.5), saturation=Saturation(upper=1.0, lower=-1.0))
    for chain, top in ((first, 0.5), (last, 1.0)):
        chain = jax.tree.map(lambda x: x, chain)  # JAX takes trees apart and puts them together again
        _, out, _ = delivered(chain, law=Played(amplitude=3.0))
        assert out.max() == pytest.approx(top)
    scenario = Scenario.of(Unicycle(), actuators={"acceleration": last})
    assert "actuators.acceleration.saturation.upper" in agvjax.leaves(scenario)
    changed = agvjax.replace(scenario, {"actuators.acceleration.saturation.upper": 2.0})
    assert list(changed.actuators["acceleration"]) == ["deadzone", "saturation"]
    assert changed.actuators["acceleration"]["saturation"].upper == 2.0


def test_an_element_may_have_any_name():
    chain = Chain(self=Saturation(), parts=Delay())
    assert list(chain) == list(jax.tree.map(lambda x: x, chain)) == ["self", "parts"]


def test_the_deadzone_comes_before_the_chain():
    stop = Chain(saturation=Saturation(upper=1.0, lower=-1.0))
    t, out, _ = delivered(stop, Played(amplitude=3.0), threshold_right=0.5)
    u = 3 * np.sin(2 * t)
    np.testing.assert_allclose(out, np.clip(np.maximum(u - 0.5, 0) + np.minimum(u, 0), -1, 1), atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    "leaf, chain",
    [
        ("saturation.upper", Chain(saturation=Saturation(upper=0.52, lower=-0.31))),
        ("lag.time_constant", Chain(lag=Lag(time_constant=0.08))),
        ("backlash.gap", Chain(backlash=Backlash(gap=0.31))),
        ("rate_limit.rate", Chain(rate_limit=RateLimit(rate=0.7))),
        ("delay.time", Chain(delay=Delay(time=0.0123, slots=16))),
        ("lag.time_constant", Chain(saturation=Saturation(upper=0.6), delay=Delay(time=0.003, slots=5), lag=Lag())),
    ],
    ids=str,
)
def test_slopes_agree_with_differences(leaf, chain):
    idle = {"acceleration": Deadzone(), "yaw_acceleration": Deadzone()}
    scenario = Scenario.of(Unicycle(), deadzone=idle, actuators={"acceleration": chain})
    name = f"actuators.acceleration.{leaf}"
    value = float(agvjax.leaves(scenario)[name])

    @jax.jit
    def speed(x):
        run = agvjax.simulate(Played(), agvjax.replace(scenario, {name: x}), dt=2e-3, n_steps=500)
        return jnp.sum(run.velocity[-1] ** 2)

    step = 1e-6
    difference = (speed(value + step) - speed(value - step)) / (2 * step)
    np.testing.assert_allclose(jax.jacfwd(speed)(value), difference, rtol=2e-5, atol=1e-8)
    if leaf.startswith("delay"):  # the one with a memory that is a line
        np.testing.assert_allclose(jax.grad(speed)(value), difference, rtol=2e-5, atol=1e-8)
    assert abs(difference) > 1e-4


def test_single_precision_too():
    late = {"delay": Delay(jitter=0.005), "backlash": Backlash(), "lag": Lag()}
    chain = Chain(quantisation=Quantisation(), **late, limit=Saturation())
    scenario = Scenario.of(Unicycle(), actuators={"acceleration": chain, "yaw_acceleration": chain})
    run = agvjax.simulate(Played(), scenario, dt=5e-3, n_steps=100, dtype=jnp.float32)
    assert run.delivered.dtype == jnp.float32 and np.isfinite(run.delivered).all()
