"""A vehicle of one's own with three actuators, integrated by SciPy: its deadzones are found in its log."""

import csv

import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from scipy.integrate import solve_ivp

import agvjax
from agvjax import Measurement
from agvjax.geometry import into_body, into_plane
from tuning import Config
from tuning.config.settings import Identify
from tuning.identify import first_drive, identify
from tuning.identify.task import task

WHEELS = 2 * np.pi * np.arange(3) / 3  # rad, where they stand around the body
ARM, NAMES = 0.2, ("first", "second", "third")  # m
PUSH = np.column_stack([-np.sin(WHEELS), np.cos(WHEELS), np.full(3, 1 / ARM)]).T  # [m/s^2, m/s^2, rad/s^2] of each
PARTS = ("slope_right", "slope_left", "threshold_right", "threshold_left")
TRUE = np.array([[0.8, 0.9, 0.5, 0.4], [0.7, 0.75, 0.3, 0.6], [0.95, 0.65, 0.45, 0.35]])  # by actuator, PARTS
STEP = 0.02  # s


@agvjax.pytree
class State:
    position: object
    velocity: object
    heading: object
    yaw_rate: object


@agvjax.pytree
class Omni(agvjax.Plant):
    """Three wheels at 120 degrees, each pushes along its own rim."""

    actuators = NAMES
    units = dict.fromkeys(NAMES, "m/s^2")

    def start(self, start):
        zero = jnp.zeros_like(jnp.asarray(start.heading))
        return State(position=start.position, velocity=start.velocity, heading=start.heading, yaw_rate=zero)

    def allocate(self, command, measurement):
        body = jnp.stack([*into_body(command.position, measurement.heading), command.heading])
        return dict(zip(NAMES, jnp.asarray(np.linalg.inv(PUSH)) @ body, strict=True))

    def derivative(self, state, memory, delivered, disturbance):
        body = jnp.asarray(PUSH) @ jnp.stack([delivered[name] for name in NAMES])
        pushed = into_plane(body[0], body[1], state.heading) + disturbance[:2]
        return State(position=state.velocity, velocity=pushed, heading=state.yaw_rate, yaw_rate=body[2])

    def output(self, state, delivered):
        return Measurement(
            position=state.position, velocity=state.velocity, heading=state.heading, yaw_rate=state.yaw_rate
        )

    def deadzones(self):
        return {name: agvjax.Deadzone() for name in NAMES}


def commanded(t):
    """What is told to the wheels, held for a step: sines that cross every threshold."""
    t = np.floor(np.asarray(t) / STEP + 1e-9)[..., None] * STEP
    return 1.4 * np.sin(np.array([0.9, 1.3, 1.9]) * t + [0.2, 1.5, 3.1]) + 0.7 * np.sin(np.array([3.1, 2.3, 2.7]) * t)


def dead(u):
    """Eq. (3): what the true actuators deliver."""
    right, left, high, low = TRUE.T
    return np.where(u > high, right * (u - high), np.where(u < -low, left * (u + low), 0.0))


def motion(t, x):
    ax, ay, turning = PUSH @ dead(commanded(t))
    c, s = np.cos(x[4]), np.sin(x[4])
    return [x[2], x[3], c * ax - s * ay, s * ax + c * ay, x[5], turning]


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    t, states = np.arange(0, 16, STEP), [np.zeros(6)]
    for a, b in zip(t[:-1], t[1:], strict=True):  # a command is constant within a step
        u = (a + b) / 2
        states.append(solve_ivp(lambda _, x, u=u: motion(u, x), (a, b), states[-1], rtol=1e-9, atol=1e-11).y[:, -1])
    x = np.array(states)
    seen = x[:, [0, 1, 4, 2, 3]] + np.random.default_rng(0).normal(size=(t.size, 5)) * [2e-3, 2e-3, 1e-3, 4e-3, 4e-3]
    file = tmp_path_factory.mktemp("omni") / "log.csv"
    with file.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["t", "x", "y", "heading", "vx", "vy", *NAMES])
        writer.writerows(np.column_stack([t, seen, commanded(t)]).tolist())
    return str(file)


def config(**more):
    return Config(scenario=agvjax.Scenario.of(Omni()), identify=Identify(fit=("deadzone",), starts=1, **more))


@pytest.mark.slow
def test_deadzones_of_three_actuators_of_ones_own_are_found(log):
    result = identify([log], config())
    estimates = {e.name: e for e in result.verdict.estimates}
    true = {f"deadzone.{n}.{p}": x for n, row in zip(NAMES, TRUE, strict=True) for p, x in zip(PARTS, row, strict=True)}
    assert set(estimates) == set(true)
    for name, value in true.items():
        assert estimates[name].identified, name
        assert abs(estimates[name].value - value) < max(4 * estimates[name].deviation, 0.02), name
    assert result.drive is None  # the plant does not say what a motion needs


def test_without_a_log_such_a_plant_is_refused():
    with pytest.raises(agvjax.InputError, match="needs"):
        first_drive(config())


def test_a_wish_that_names_nothing_is_refused(log):
    with pytest.raises(agvjax.InputError, match="identify.fit"):
        identify([log], Config(scenario=agvjax.Scenario.of(Omni()), identify=Identify(fit=("deadzones",))))


def test_the_first_guess_of_a_stretch_spins_as_the_heading_says(log):
    model = task([log], config()).model
    state = ravel_pytree(Omni().start(agvjax.Start()))[1](model.start(jnp.array([1.0, 2.0, 0.3, 0.4, 0.5, 6.0])))
    told = [*state.position, state.heading, *state.velocity]
    np.testing.assert_allclose(told, [1.0, 2.0, 0.3, 0.4, 0.5], atol=1e-6)
    assert abs(state.yaw_rate - 6.0) < 0.1  # `start` alone has it stand still
