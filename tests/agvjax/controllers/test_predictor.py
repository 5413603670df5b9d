"""The predictor against SciPy, against a vehicle that really is late, and where its belief is wrong."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import agvjax
from agvjax import Base, Chain, Deadzone, Delay, Measurement, Predictor, Sampled, Scenario
from tuning.config import dump, load

PERIOD = 0.05
ZONE = Deadzone(slope_right=0.9, slope_left=0.8, threshold_right=0.06, threshold_left=0.04)
BASE = Base(time_constant=0.1, acceleration=1.2, drift=0.02)


def dead(u):
    """Eq. (11) of `ZONE`."""
    return 0.9 * max(u - 0.06, 0) + 0.8 * min(u + 0.04, 0)


def measured(x, y, heading, left, right):
    """What a base with these wheel speeds tells."""
    v, w = (left + right) / 2, (right - left) / 0.5 + 0.02
    velocity = jnp.array([v * np.cos(heading), v * np.sin(heading)])
    return Measurement(
        position=jnp.array([x, y]), velocity=velocity, heading=jnp.asarray(heading), yaw_rate=jnp.asarray(w)
    )


@pytest.mark.parametrize("delay", [0.0, 0.03, 0.05, 0.12, 0.2])
def test_a_base_is_where_scipy_says_it_will_be(delay):
    """Inputs of the last periods, each held for a period and late by the delay."""
    lines = {"left": [0.5, 0.1, -0.2, 0.3], "right": [0.7, 0.8, 0.1, -0.3]}  # the newest first
    start = np.array([0.3, -0.2, 0.7, 0.25, 0.4])  # x, y, heading, wheel speeds

    def held(name, t):
        """What was sent at t - delay, of instants at 0, -PERIOD, ...: at 0 itself nothing yet."""
        back = int(np.floor((delay - t) / PERIOD + 1e-12))
        return dead(lines[name][min(back, 3)])

    def motion(t, x, inputs):
        left, right = (np.clip((u - own) / 0.1, -1.2, 1.2) for u, own in zip(inputs, x[3:], strict=True))
        v, w = (x[3] + x[4]) / 2, (x[4] - x[3]) / 0.5 + 0.02
        return [v * np.cos(x[2]), v * np.sin(x[2]), w, left, right]

    cuts = sorted({0.0, delay, *(c for k in range(5) if 0 < (c := delay - k * PERIOD) < delay)})
    x = start
    for begin, end in zip(cuts[:-1], cuts[1:], strict=True):
        inputs = [held(name, (begin + end) / 2) for name in ("left", "right")]
        x = solve_ivp(lambda t, x, u=inputs: motion(t, x, u), (begin, end), x, rtol=1e-11, atol=1e-12).y[:, -1]
    memory = {name: jnp.array(line) for name, line in lines.items()}
    predictor = Predictor(delay=delay, believed={"left": ZONE, "right": ZONE}, slots=4)
    got = predictor.ahead(memory, BASE, measured(*start), PERIOD)
    np.testing.assert_allclose([*got.position, got.heading], x[:3], atol=2e-4)
    along = got.velocity @ jnp.array([jnp.cos(got.heading), jnp.sin(got.heading)])
    np.testing.assert_allclose([along, got.yaw_rate], [(x[3] + x[4]) / 2, (x[4] - x[3]) / 0.5 + 0.02], atol=2e-3)


@pytest.mark.slow
def test_a_late_vehicle_with_a_right_belief_drives_as_one_that_is_not_late():
    """The law of a late vehicle sees at t what that of a prompt one sees at t + delay, a delay of whole periods."""
    plant, delay = agvjax.Unicycle(), 0.1
    zones = plant.deadzones()
    calm = {"disturbance": agvjax.NoDisturbance(), "path": agvjax.Line(velocity=np.array([0.8, 0.0]))}
    begun = agvjax.Start(position=np.array([0.0, 0.1]), velocity=np.array([0.8, 0.0]), heading=0.0)
    late = Scenario.of(
        plant, actuators=dict.fromkeys(plant.actuators, Chain(d=Delay(time=delay, slots=4))), start=begun, **calm
    )
    law = Sampled(inner=agvjax.NeuroBackstepping(k1=1.5, k2=5.0, Lam=0.5, omega_n=20.0), vehicle=plant, period=PERIOD)
    knowing = dataclasses.replace(law, prediction=Predictor(delay=delay, believed=zones, slots=2))
    run = {"dt": 0.01, "n_steps": 500}
    # the prompt vehicle begins where the late one is when its first command arrives: it coasts along for the delay
    coasted = agvjax.Start(position=np.array([0.8 * delay, 0.1]), velocity=np.array([0.8, 0.0]), heading=0.0)
    ahead = agvjax.Line(velocity=np.array([0.8, 0.0]), origin=np.array([0.8 * delay, 0.0]))
    prompt = dataclasses.replace(late, actuators={}, start=coasted, path=ahead)
    one, other = agvjax.simulate(knowing, late, **run), agvjax.simulate(law, prompt, **run)
    shift = round(delay / 0.01)
    np.testing.assert_allclose(one.position[shift:], other.position[: 501 - shift], atol=1e-6)
    np.testing.assert_allclose(one.command[1 : 501 - shift], other.command[1 : 501 - shift], atol=1e-5)
    plain = agvjax.simulate(law, late, **run)
    assert float(np.abs(np.asarray(plain.position[shift:] - other.position[: 501 - shift])).max()) > 0.01


def test_a_gradient_in_the_delay_is_that_of_differences():
    predictor = Predictor(believed={"left": ZONE, "right": ZONE}, slots=4)
    memory = {"left": jnp.array([0.5, 0.3, 0.2, 0.3]), "right": jnp.array([0.7, 0.8, 0.4, 0.3])}

    def heading(delay):
        known = dataclasses.replace(predictor, delay=delay)
        return known.ahead(memory, BASE, measured(0.0, 0.0, 0.3, 0.3, 0.4), PERIOD).heading

    difference = (heading(0.12 + 1e-5) - heading(0.12 - 1e-5)) / 2e-5
    np.testing.assert_allclose(jax.grad(heading)(0.12), difference, rtol=1e-5)


def test_it_is_named_in_toml_and_believes_what_the_scenario_says(tmp_path):
    config = load(["base"], ['controller.prediction={type="predictor", delay=0.2, slots=5}'])
    predictor = config.controller.prediction
    assert predictor.believed["left"].threshold_right == 0.06 and predictor.slots == 5
    file = tmp_path / "again.toml"
    file.write_text(dump(config))
    assert agvjax.leaves(load([str(file)]).controller) == agvjax.leaves(config.controller)


@pytest.mark.parametrize(
    ("setting", "key"),
    [
        ('controller.prediction={type="predictor", delay=0.3}', r"prediction\.slots = 4: must be at least 6"),
        ('controller.prediction={type="predictor", slots=100}', r"prediction\.slots"),
        ('controller.prediction={type="predictor", delay=-0.1}', r"prediction\.delay"),
        ('controller.prediction={type="predictor", believed={middle={}}}', r"prediction\.believed"),
    ],
)
def test_bad_settings_are_refused_by_name(setting, key):
    with pytest.raises(agvjax.InputError, match=key):
        load(["base"], [setting])
