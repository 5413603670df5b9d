"""The model that is fitted, beside another program: what arrives within a step moves the vehicle from then on."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from reference_bases import Motor, TwoWheels, run
from tuning.identify.model import Model, arrivals
from tuning.identify.segments import Segments

STEP = 0.02
RNG = np.random.default_rng(0)
TWISTS = np.repeat(RNG.uniform([-0.6, -1.2], [0.8, 1.2], (6, 2)), 10, axis=0)
STILL = np.array([0.0, 0.0, 0.3, 0.0, 0.0])  # x, y, heading, what the wheels have reached
NAMES = ("actuators.left.delay.time", "actuators.right.delay.time")


def rows(inputs, steps=None):
    """A stretch that moves from its first row on."""
    n = len(inputs)
    h = np.full(n, STEP) if steps is None else steps
    t, nothing = np.cumsum(h) - h, np.zeros((n, 3))
    return Segments(t, h, inputs, np.ones(n), nothing, nothing, np.arange(n), np.zeros((), int))


@functools.cache
def model():
    zone = agvjax.Deadzone(slope_right=0.9, slope_left=0.95, threshold_right=0.05, threshold_left=0.07)
    scenario = agvjax.Scenario.of(
        agvjax.Base(),
        deadzone={"left": zone, "right": zone},
        disturbance=agvjax.NoDisturbance(),
        actuators={side: agvjax.Chain(delay=agvjax.Delay(time=0.1, slots=30)) for side in ("left", "right")},
    )
    return Model(agvjax.check(scenario), NAMES, ("x", "y", "heading"), ("left", "right"), 2)


@functools.cache
def predict():
    return jax.jit(model().predict)


@pytest.mark.parametrize("late", [(0.25, 0.25), (0.1137, 0.04), (0.0, 0.0061)])
def test_the_prediction_is_that_of_another_program_whenever_commands_arrive(late):
    """Through a limit of the acceleration, whose corners Runge and Kutta's steps of 10 ms cut by some micrometres."""
    motors = [Motor(0.9, 0.95, 0.05, 0.07, delay=time) for time in late]
    vehicle = TwoWheels(motors=(motors[0], motors[1]))
    wheels = np.array([vehicle.asked(v, w) for v, w in TWISTS])
    seen = predict()(jnp.array(late), STILL, rows(wheels))
    states = run(vehicle, TWISTS.tolist(), STEP, np.array([0.0, 0.0, 0.3]), STEP * np.arange(60))
    np.testing.assert_allclose(seen, states[:, :3], atol=2e-4)


def test_a_stretch_begins_with_its_motors_as_the_commands_before_it_made_them():
    """Whatever is guessed of them: in its last 0.4 s it goes where the vehicle of the other program goes."""
    motors = Motor(0.9, 0.95, 0.05, 0.07, delay=0.1)
    vehicle, twists = TwoWheels(motors=(motors, motors)), TWISTS * (np.arange(60) >= 10)[:, None]
    states = run(vehicle, twists.tolist(), STEP, np.array([0.0, 0.0, 0.3]), STEP * np.arange(60))
    late = rows(np.array([vehicle.asked(v, w) for v, w in twists]))
    late = late._replace(live=np.repeat([0.0, 1.0], [40, 20]), rows=np.arange(100, 160))
    for guess in ([0.0, 0.0], [0.9, -0.9]):
        seen = predict()(jnp.array([0.1, 0.1]), np.r_[states[40, :3], guess], late)
        np.testing.assert_allclose(seen[:41], np.tile(states[40, :3], (41, 1)), atol=1e-9)
        np.testing.assert_allclose(seen[40:], states[40:, :3], atol=2e-4)
    begun = late._replace(rows=np.arange(60), live=np.repeat([0.0, 1.0], [5, 55]))  # 0.1 s after the log begins
    still, fast = (predict()(jnp.array([0.1, 0.1]), np.r_[STILL[:3], guess, guess], begun) for guess in (0.0, 0.5))
    assert np.linalg.norm(fast[-1, :2] - still[-1, :2]) > 0.01


@pytest.mark.slow
def test_the_slope_in_a_delay_is_that_of_small_differences_also_where_steps_begin():
    """At 0.1 s both delays and the steps' begins come together; the vehicle speeds up as fast as it can."""
    inputs = np.repeat([[0.0, 0.0], [0.7, 0.5], [-0.6, 0.3]], 20, axis=0)
    place = lambda p: predict()(p, STILL, rows(inputs))[-1]  # noqa: E731
    slopes = jax.jit(jax.jacfwd(place))
    for at in (0.1, 0.0837):
        p = jnp.array([at, 0.1])
        slope = slopes(p)
        for i in range(2):
            step = 2e-3 * jnp.eye(2)[i]
            rough = (place(p + step) - place(p - step)) / 4e-3
            np.testing.assert_allclose(slope[:, i], rough, rtol=0.03, atol=2e-3)


def test_commands_hold_from_their_arrival_to_the_next_one():
    """Rows of 20 ms in steps of 10, and 33 ms of delay: the command of a row arrives 13 ms into the next but one."""
    inputs = np.arange(1.0, 6.0)[:, None]
    begins, lengths, held = arrivals(rows(inputs), 2, lambda u: {"a": u[0]}, {"a": jnp.array(0.033)})
    np.testing.assert_allclose(begins[1], [0.0, 0.01, 0.013], atol=1e-6)
    np.testing.assert_allclose(lengths[1], [0.01, 0.003, 0.007], atol=1e-6)
    np.testing.assert_allclose(held["a"][:3], [[0, 0, 0], [0, 0, 1], [1, 1, 2]])


def test_more_than_one_command_may_arrive_in_a_long_row():
    """Rows of 20, 20, 20, 100 and 20 ms, 30 ms late: in the long row, from 60 ms on, two arrive, at 70 and 90 ms."""
    steps = np.array([0.02, 0.02, 0.02, 0.1, 0.02])
    stretch = rows(np.arange(1.0, 6.0)[:, None], steps)
    begins, lengths, held = arrivals(stretch, 10, lambda u: {"a": u[0]}, {"a": jnp.array(0.03)})
    np.testing.assert_allclose(np.sum(lengths, axis=1), steps, atol=1e-6)
    np.testing.assert_allclose(np.interp([0.005, 0.015, 0.035], begins[3], held["a"][3]), [2, 3, 4], atol=0.6)
    assert [int(u) for u in np.unique(held["a"][3])] == [2, 3, 4]
