"""Describing functions against textbooks, limit cycles against simulations that share nothing with their prediction."""

import dataclasses
import math

import control
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

import agvjax
from agvjax import Backlash, Chain, Deadzone, Delay, Inverse, Lag, RateLimit, Sampled, Saturation
from tuning.config import load
from tuning.studies.margins.cycles import Loop, crossings, predict
from tuning.studies.margins.describing import Inverted, Way, describing, wanted, way
from tuning.studies.margins.study import study

ZONE = Deadzone(slope_right=0.8, slope_left=0.8, threshold_right=0.1, threshold_left=0.1)
DT = 0.01  # s


def alone(**parts):
    return Way(Chain(), Chain(**parts), (), 0)


def by_textbook(A, slope, threshold):
    """Slotine and Li, eq. (5.32): 0 within the threshold."""
    x = np.minimum(threshold / A, 1)
    return slope * (1 - 2 / np.pi * (np.arcsin(x) + x * np.sqrt(1 - x**2)))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_deadzone_has_the_describing_function_of_the_textbook(dtype):
    A = np.geomspace(0.05, 3, 40).astype(dtype)
    N, mean = describing(alone(zone=ZONE), 0.0, 1.0, A)
    np.testing.assert_allclose(N, by_textbook(A, 0.8, 0.1), atol=3e-4)
    np.testing.assert_allclose(mean[A > 0.11], 0, atol=2e-4)


def test_backlash_and_saturation_have_those_of_python_control():
    A = np.geomspace(0.12, 3, 20)
    for element, known in (
        (Backlash(gap=0.2), control.friction_backlash_nonlinearity(0.2)),
        (Saturation(upper=0.3, lower=-0.3), control.saturation_nonlinearity(0.3)),
    ):
        N, _ = describing(alone(element=element), 0.0, 1.0, A)
        np.testing.assert_allclose(N, [known.describing_function(a) for a in A], atol=5e-4)


def test_about_a_mean_input_it_is_the_integral_of_one_period():
    """With share 0 the mean of the input is given."""
    b, A = 0.07, np.array([0.05, 0.2, 0.6])
    zone = Deadzone(slope_right=0.8, slope_left=0.5, threshold_right=0.1, threshold_left=0.04)

    def y(u):
        return 0.8 * max(u - 0.1, 0.0) + 0.5 * min(u + 0.04, 0.0)

    expected = [
        quad(lambda th, a=a: y(b + a * math.sin(th)) * math.sin(th), 0, 2 * np.pi, limit=200)[0] / (np.pi * a)
        for a in A
    ]
    N, mean = describing(alone(zone=zone), b, 0.0, A)
    np.testing.assert_allclose(mean, b, atol=1e-6)
    np.testing.assert_allclose(N, expected, atol=5e-4)


def test_a_loop_that_integrates_keeps_what_is_delivered_on_average():
    """Beyond the threshold on one side only, 0.8 (0.5 - 0.1) = 0.32; once it also reaches the other side, less."""
    A = np.array([0.1, 0.3, 2.0])
    _, mean = describing(alone(zone=ZONE), 0.32, 1.0, A)
    np.testing.assert_allclose(mean[:2], 0.5, atol=1e-3)
    turn = 2 * np.pi * np.arange(20000) / 20000
    u = mean[2] + 2.0 * np.sin(turn)
    assert np.mean(0.8 * (np.maximum(u - 0.1, 0) + np.minimum(u + 0.1, 0))) == pytest.approx(0.32, abs=1e-3)


def looped(element, gains, late=0.0):
    """The loop of a mass, x'' = what is delivered `late` s ago, under u = -k x - c x' - k_i int x."""
    k, c, ki = gains
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    space = control.sample_system(control.ss(A, [[0.0], [1.0], [0.0]], [[k, c, ki]], [[0.0]]), DT)
    if late:
        slots = round(late / DT)
        line = control.ss(np.eye(slots, k=-1), np.eye(slots)[:, :1], np.eye(slots)[-1:], [[0.0]], DT)
        space = space * line
    nothing = np.zeros(4000)
    return Loop(space, 0.0, alone(element=element), 1.0, nothing, nothing, 2000, 0, DT)


def simulated(element, gains, late=0.0, seconds=400.0):
    """Half the range of u and its frequency [rad/s] once settled; `element` a function of u and of what it was."""
    k, c, ki = gains
    x, v, total, y, us = 0.4, 0.0, 0.0, 0.0, []
    line = [0.0] * max(1, round(late / DT))
    for _ in range(round(seconds / DT)):
        u = -(k * x + c * v + ki * total)
        y = element(u, y)
        line.append(y)
        push = line.pop(0) if late else line.pop()
        total += DT * x + DT**2 / 2 * v + DT**3 / 6 * push
        x, v = x + DT * v + DT**2 / 2 * push, v + DT * push
        us.append(u)
    u = np.array(us[len(us) * 2 // 3 :])
    return measured(u, DT)


def measured(u, dt):
    """Half the range, and the frequency [rad/s] by where it rises through its mean."""
    u = u - u.mean()
    up = np.flatnonzero((u[:-1] < 0) & (u[1:] >= 0))
    at = (up - u[up] / (u[up + 1] - u[up])) * dt
    assert len(at) > 3
    return np.ptp(u) / 2, 2 * np.pi * (len(at) - 1) / (at[-1] - at[0])


def dead(u, y):
    return max(u - 0.1, 0.0) + min(u + 0.1, 0.0)


def play(u, y):
    return min(max(y, u - 0.1), u + 0.1)


def cut(u, y):
    return min(max(u, -0.5), 0.5)


SYMMETRIC = Deadzone(threshold_right=0.1, threshold_left=0.1)


def test_integral_action_and_a_deadzone_hunt_as_found_by_hand():
    """s^3 + N (c s^2 + k s + k_i) has +-jw for w^2 = k_i / c, N = k_i / (c k) (Routh)."""
    k, c, ki = 4.0, 2.0, 4.0
    curve = looped(SYMMETRIC, (k, c, ki)).curve(1.0)
    ((a, w, along_a, along_w, stable),) = [h for h in crossings(curve) if curve.amplitude[h[0]] > 0.1]
    assert stable
    assert np.interp(w + along_w, range(300), curve.omega) == pytest.approx(
        math.sqrt(ki / c), rel=1e-2
    )  # less half a step of hold
    A = np.interp(a + along_a, range(len(curve.amplitude)), curve.amplitude)
    assert by_textbook(A, 1.0, 0.1) == pytest.approx(ki / (c * k), rel=2e-2)


@pytest.mark.parametrize(
    "element, function, gains, late",
    [
        (SYMMETRIC, dead, (4.0, 2.0, 4.0), 0.0),
        (SYMMETRIC, dead, (4.0, 2.0, 6.5), 0.0),
        (Backlash(gap=0.2), play, (4.0, 2.0, 0.0), 0.0),
        (Saturation(upper=0.5, lower=-0.5), cut, (1.0, 1.0, 0.0), 0.75),
    ],
)
def test_limit_cycles_are_those_of_a_simulation_by_hand(element, function, gains, late):
    stable = [c for c in looped(element, gains, late).cycles()[0] if c.stable]
    (cycle,) = stable
    amplitude, frequency = simulated(function, gains, late)
    assert cycle.harmonics
    assert cycle.amplitude == pytest.approx(amplitude, rel=0.1)
    assert cycle.frequency == pytest.approx(frequency, rel=0.05)


def test_a_loop_without_integral_action_does_not_hunt_in_a_deadzone():
    """Its L, (c s + k) / s^2, never crosses the negative axis but at its far end."""
    assert not [c for c in looped(SYMMETRIC, (4.0, 2.0, 0.0)).cycles()[0] if c.stable]


def test_what_an_inverse_was_asked_for_is_found_from_what_it_sent():
    inverse = Inverse(believed={"left": ZONE})
    d = np.array([-0.5, -0.02, 0.0, 0.003, 0.3])
    sent = np.asarray(inverse.inverted({"left": jnp.asarray(d)})["left"])
    one = Way(Chain(inverse=Inverted(inverse=inverse)), Chain(deadzone=ZONE), (), 0)
    found, slope = wanted(one, sent)
    np.testing.assert_allclose(found, d, atol=1e-6)
    steps = [np.asarray(inverse.inverted({"left": jnp.asarray(d + s)})["left"]) for s in (1e-6, -1e-6)]
    np.testing.assert_allclose(slope[[0, 1, 4]], ((steps[0] - steps[1]) / 2e-6)[[0, 1, 4]], rtol=1e-3)


def test_what_is_not_covered_is_named():
    base = load(["base"], [])
    rest = {
        "RateLimit": Chain(rate=RateLimit()),
        "Backlash behind a lag": Chain(lag=Lag(), play=Backlash()),
        "": Chain(play=Backlash(), delay=Delay(), lag=Lag()),
    }
    for reason, chain in rest.items():
        scenario = dataclasses.replace(base.scenario, actuators={"left": chain})
        found = way(base.controller, scenario, "left", 0, ())
        assert isinstance(found, Way) if not reason else found == reason
    learning = Sampled(vehicle=base.scenario.plant, compensation=agvjax.AdaptiveInverse(believed={"left": ZONE}))
    assert way(learning, base.scenario, "left", 0, ()) == "AdaptiveInverse"


SIDEWAYS = [
    'scenario.path={type="route",points=[[0.0,0.0],[80.0,0.0]],closed=false,speed=0.8}',
    "scenario.start={position=[0.0,0.05],heading=0.0}",
    "simulate.horizon=75.0",
    "criteria.late=40.0",
    "margins.instants=2",
    "margins.vehicles=0",
]
PLAY = "scenario.actuators.steering_angle={delay={time=0.08,slots=4},play={type='backlash',gap=0.05}}"
INVERSE = 'controller.compensation={type="inverse",threshold=0.4}'  # believes in too little


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        ["controller.inner.k_i=2.0"],
        ["controller.inner.k_i=4.0"],
        ["controller.inner.k_i=0.0", PLAY],
        ["controller.inner.k_i=2.0", INVERSE],
    ],
    ids=["deadzone", "nearer", "play", "inverse"],
)
def test_a_forklift_that_hunts_on_a_straight_route_does_so_as_predicted(settings):
    config = load(["forklift"], SIDEWAYS + settings)
    predicted = predict(config, study(config))
    cycle = [c for now in predicted.cycles[0] for c in now[1] if c.stable][-1]
    assert not any(c.stable for now in predicted.cycles[0] for c in now[0])
    timing = config.timing("tune")
    run = jax.jit(lambda: agvjax.simulate(config.controller, config.scenario, **timing))()
    sent = np.asarray(run.inputs)[round(40 / float(timing.dt)) :, 1]
    one = way(config.controller, config.scenario, "steering_angle", 0, ())
    amplitude, frequency = measured(wanted(one, sent)[0], float(timing.dt))
    assert cycle.amplitude == pytest.approx(amplitude, rel=0.1)
    assert cycle.frequency == pytest.approx(frequency, rel=0.05)
