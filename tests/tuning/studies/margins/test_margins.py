"""Margins of loops: against formulas, against delays and gains at which simulated loops lose their stability."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from agvjax import Chain, Delay, Lag, Timing
from agvjax.linear import input_names, instants, linearised, steady
from agvjax.margins import growth
from agvjax.margins import margins as tightest
from claimed import meant
from commands import run
from mass import Mass, Spring, by_formula, mass
from tuning.config import load
from tuning.studies.margins.loops import margins, spaces
from tuning.studies.margins.rules import faults
from tuning.studies.margins.study import matrices


def found(law, scenario, timing, first=1.0, count=2):
    loops = linearised(law, scenario, timing=timing, first=first, count=count)
    period = float(loops.period)
    return [
        [margins(space, period, float(growth(period, *parts))) for space in spaces(*parts, period)]
        for parts in (matrices(loops, k) for k in range(count))
    ]


@pytest.mark.parametrize(
    "delay, slope", [(0.0, 1.0), (0.0, 0.6), *(pytest.param(T, 0.8, marks=pytest.mark.slow) for T in (0.1, 0.0125))]
)
def test_in_continuous_time_margins_are_those_of_the_formula(delay, slope):
    """A step of the integrator holds its input: half a step more of delay."""
    dt = 5e-3
    slots = 2 + math.ceil(delay / dt)
    (m,), _ = found(Spring(), mass(delay, slope, slots), Timing(dt=dt, n_steps=400))
    w, phase, left = by_formula(4.0, 2.0, delay + dt / 2, slope)
    np.testing.assert_allclose([m.crossover, m.phase, m.delay], [w, phase, left], rtol=3e-3)


def test_a_computer_holds_its_input_for_a_period():
    """The period's hold is a delay of half of it, nearly; the exact answer is that of the sampled double integrator."""
    P, k, c = 0.1, 4.0, 2.0
    law = agvjax.Sampled(inner=Spring(k=k, c=c), vehicle=Mass(), period=P)
    (m,), _ = found(law, mass(), Timing(dt=0.01, n_steps=400))
    w = np.linspace(1.0, 4.0, 300_001)
    z = np.exp(1j * w * P)
    L = k * P**2 / 2 * (z + 1) / (z - 1) ** 2 + c * P / (z - 1)
    at = np.argmin(np.abs(np.abs(L) - 1))
    phase = np.pi + np.angle(L[at])
    np.testing.assert_allclose([m.crossover, m.phase, m.delay], [w[at], phase, phase / w[at]], rtol=3e-3)
    most = 1 / np.min(np.abs(1 + L))
    assert most <= m.sensitivity * 1.001


def straight(extra=0.0):
    settings = [
        'controller.inner="path_pid"',
        'scenario.path={type="route",points=[[0.0,0.0],[80.0,0.0]],closed=false,speed=0.8}',
        "scenario.start={position=[0.0,1e-4],heading=0.0}",
        "simulate.horizon=80.0",
    ]
    config = load(["base"], settings)
    chains = {n: Chain(delay=Delay(time=0.08 + (extra if n == "left" else 0.0), slots=24)) for n in ("left", "right")}
    return config, dataclasses.replace(config.scenario, actuators=chains)


@pytest.mark.slow
def test_the_delay_margin_is_the_delay_at_which_a_simulated_robot_begins_to_weave():
    config, scenario = straight()
    timing = Timing(dt=0.005, n_steps=16000)
    bears = found(config.controller, scenario, timing, first=20.0)[0][0].delay
    extras = bears + np.linspace(-0.08, 0.08, 17)
    many = agvjax.batch(scenario, {"actuators.left.delay.time": 0.08 + extras})

    def sways(delay):
        one = agvjax.replace(scenario, {"actuators.left.delay.time": delay})
        run = agvjax.simulate(config.controller, one, save_every=10, **timing)
        return jnp.std(run.position[800:1200, 1]), jnp.std(run.position[1200:, 1])

    early, late = jax.vmap(sways)(many.values["actuators.left.delay.time"])
    grows = np.log(np.asarray(late) / np.asarray(early))  # falls below 0 where the loop is stable
    at = int(np.argmax(grows > 0))
    edge = np.interp(0.0, grows[at - 1 : at + 1], extras[at - 1 : at + 1])
    assert edge == pytest.approx(bears, rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("nested", [False, True])
def test_all_delays_of_a_chain_add_up_and_what_else_is_in_it_stays(nested):
    """A lag of T adds -atan(w T); also of an element without a chain, or in a chain within a chain."""
    dt, T = 5e-3, 0.05
    late = {"first": Delay(time=0.04, slots=12), "second": Delay(time=0.06, slots=16)}
    chain = Chain(late=Chain(**late), lag=Lag(time_constant=T)) if nested else Chain(**late, lag=Lag(time_constant=T))
    scenario = dataclasses.replace(mass(), actuators={"push": chain})
    (m,), _ = found(Spring(k=2.0, c=2.0), scenario, Timing(dt=dt, n_steps=400))
    w = np.linspace(1.0, 4.0, 300_001)
    L = (2 + 2j * w) / (1j * w) ** 2 / (1 + 1j * w * T) * np.exp(-1j * w * (0.1 + dt / 2))
    at = np.argmin(np.abs(np.abs(L) - 1))
    phase = np.pi + np.angle(L[at])
    np.testing.assert_allclose([m.crossover, m.phase], [w[at], phase], rtol=3e-3)
    alone = dataclasses.replace(mass(), actuators={"push": Lag(time_constant=T)})
    (m,), _ = found(Spring(k=2.0, c=2.0), alone, Timing(dt=dt, n_steps=400))
    phase = np.pi + np.angle(L[at] * np.exp(1j * w[at] * 0.1))
    np.testing.assert_allclose([m.crossover, m.phase], [w[at], phase], rtol=3e-3)


def test_without_python_control_the_way_to_install_it_is_said(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    (fault,) = faults(load(["base"], []))
    assert fault.key == "margins" and "agvjax[margins]" in fault.rule


def test_an_unstable_loop_bears_nothing():
    (m,), _ = found(Spring(k=4.0, c=-1.0), mass(), Timing(dt=5e-3, n_steps=400))
    assert m.growth == pytest.approx(0.5, rel=0.01)
    assert (m.gain, m.phase, m.delay, m.sensitivity) == (0.0, 0.0, 0.0, math.inf)


def test_within_a_threshold_a_deadzone_counts_with_its_slope():
    near = agvjax.replace(mass(), {"start.position": jnp.array([1e-3, 0.0]), "start.velocity": jnp.zeros(2)})
    (m,), _ = found(Spring(), near, Timing(dt=5e-3, n_steps=400))
    assert m.delay == pytest.approx(by_formula(4.0, 2.0, 2.5e-3, 1.0)[2], rel=3e-3)


def test_inputs_are_named_in_order():
    timing = Timing(dt=1e-3, n_steps=100)
    names = input_names(agvjax.NeuroBackstepping(), agvjax.Scenario(), timing)
    assert names == ["position[0]", "position[1]", "heading"]
    assert input_names(Spring(), mass(), timing) == ["push"]


def test_more_instants_than_a_run_has_are_refused():
    with pytest.raises(ValueError, match="12 instants"):
        instants(Spring(), Timing(dt=5e-3, n_steps=10), 0.0, 12)


@pytest.mark.slow
def test_a_report_of_a_robot_is_written(tmp_path):
    out = tmp_path / "out"
    options = ["--set", 'controller.inner="path_pid"', "--set", "margins.vehicles=4", "--set", "margins.instants=4"]
    said, _ = run(["margins", "--config", "base", "--out", str(out), *options], 0)
    assert "The tightest loop" in said and "more delay" in said
    assert meant((out / "report.md").read_text()) == ["tightest"]
    assert {
        "report.html",
        "report.md",
        "margins.csv",
        "cycles.csv",
        "cycles.png",
        "bode.png",
        "along.png",
        "config.toml",
    } <= {file.name for file in out.iterdir()}
    rows = (out / "margins.csv").read_text().splitlines()
    assert len(rows) == 1 + 5 * 4 * 2


@pytest.mark.slow
@pytest.mark.parametrize("k_y, k_psi, first, lasts", [(6.0, 4.0, 9.58, True), (60.0, 25.0, 4.0, False)])
def test_behind_a_corner_a_loop_is_stable_if_a_pushed_robot_comes_back_to_its_route(k_y, k_psi, first, lasts):
    """Its law asks for more speed as it gets on, at .4 m/s^2 / .5 m/s = .8 1/s: a lead grows, and nothing else does.

    With the other gains it weaves, on the straight line too.
    """
    settings = [
        'controller.inner="path_pid"',
        'scenario.path={type="route",points=[[0.0,0.0],[3.0,0.0],[3.0,3.0]],closed=false,speed=0.5,radius=0.6,'
        "limits={acceleration=0.4,deceleration=0.4,lateral_acceleration=0.25}}",
        "scenario.start={position=[0.0,0.0],heading=0.0}",
        "scenario.plant.time_constant=0.25",
    ]
    config, timing = load(["base"], settings), Timing(dt=0.01, n_steps=1000)
    law = agvjax.replace(config.controller, {"inner.k_y": k_y, "inner.k_psi": k_psi})
    loops = linearised(law, config.scenario, timing=timing, first=first, count=8)
    kept = np.flatnonzero(steady(loops))
    fastest = max(float(growth(float(loops.period), *matrices(loops, k))) for k in kept)
    assert fastest == pytest.approx(0.8, rel=0.15)
    assert (tightest(loops).delay_margin > 0) == lasts
    pushed = agvjax.replace(config.scenario, {"start.position": jnp.array([0.0, 0.02])})
    one, other = (np.asarray(agvjax.simulate(law, x, **timing).position) for x in (config.scenario, pushed))
    away = np.min(np.linalg.norm(other[-100:, None] - one[None], axis=2), axis=1)
    assert (np.max(away) < 5e-3) == lasts
