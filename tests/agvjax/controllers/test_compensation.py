"""The inverse of a deadzone in the computer: numbers by hand, what it composes to, and what it does to a loop."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from agvjax import BackCalculation, Base, Deadzone, Inverse, Measurement, Sampled, Scenario
from tuning.config import dump, load

ZONE = Deadzone(slope_right=0.8, slope_left=1.25, threshold_right=0.06, threshold_left=0.1)
ZERO = jnp.zeros(())
STILL = Measurement(position=jnp.zeros(2), velocity=jnp.zeros(2), heading=ZERO, yaw_rate=ZERO)


def sent(inverse, *demands, period=0.05):
    """What is sent in periods one after the other."""
    memory, answers = inverse.hold({"a": ZERO}, STILL), []
    for d in demands:
        inputs, memory = inverse.sent(memory, {"a": jnp.asarray(d)}, period)
        answers.append(float(inputs["a"]))
    return answers


def test_what_is_sent_by_hand():
    inverse = Inverse(believed={"a": ZONE}, slope=1.1, threshold=0.9, width=0.2, quiet=0.1)
    right = 0.02 / 0.88 + 0.054 * np.tanh((0.02 - 0.006) / 0.012)
    left = -0.3 / 1.375 - 0.09 * np.tanh((0.3 - 0.01) / 0.02)
    np.testing.assert_allclose(sent(inverse, 0.02, -0.3, 0.0), [right, left, 0.0], rtol=1e-13)
    assert sent(inverse, 0.005) == [pytest.approx(0.005 / 0.88, rel=1e-13)]  # about zero no step
    led = dataclasses.replace(inverse, lead=0.1)  # 0.5 + 0.1 (0.5 - 0) / 0.05, then 0.6 + 0.1 (0.6 - 0.5) / 0.05
    np.testing.assert_allclose(sent(led, 0.5, 0.6), sent(inverse, 1.5, 0.8), rtol=1e-13)


def test_the_deadzone_of_what_is_sent_is_what_was_wanted():
    inverse, demands = Inverse(believed={"a": ZONE}), jnp.linspace(-0.5, 0.5, 2001)
    delivered = ZONE(inverse.inverted({"a": demands})["a"])
    threshold = np.where(demands > 0, 0.06, 0.1)
    far = np.abs(demands) > (0.1 + 5 * 0.2) * threshold  # tanh(5) is 1 - 9e-5
    off = np.abs(delivered - demands)
    assert np.max(off[far] / threshold[far]) < 1.25 * 1e-4
    assert np.max(off / threshold) < 0.1 + 0.2 * 1.5  # at most the quiet part and the rounding of the step
    assert np.all(np.diff(delivered) >= 0)


def test_a_believed_threshold_of_zero_has_no_step_and_finite_slopes():
    def at(d, s):
        zone = Deadzone(threshold_right=s, threshold_left=s)
        return Inverse(believed={"a": zone}).inverted({"a": d})["a"]

    for d in (-0.2, 0.0, 0.3):
        value, slopes = at(d, 0.0), jax.grad(at, (0, 1))(jnp.asarray(d), jnp.zeros(()))
        assert float(value) == d and np.isfinite(slopes).all()


def test_an_actuator_that_is_not_named_is_sent_what_is_wanted():
    inputs, _ = Inverse(believed={"a": ZONE}).sent({"a": ZERO, "b": ZERO}, {"a": ZERO + 1, "b": ZERO + 2}, 0.05)
    assert float(inputs["b"]) == 2 and float(inputs["a"]) == pytest.approx(1 / 0.8 + 0.06)


@agvjax.pytree
class Taking(agvjax.Law):
    """Asks for constants and notes what it is told that was missing."""

    relieves = True

    def init(self, measurement, reference):
        return jnp.zeros(2)

    def law(self, flow, memory, measurement, reference):
        return agvjax.Command(position=jnp.array([3.0, 0.2]), heading=jnp.zeros(())), jnp.zeros(2)

    def relieved(self, before, later, missing, limited, period):
        return missing


def test_a_limit_takes_back_what_is_believed_to_be_lost_and_no_more():
    unicycle, zone = agvjax.Unicycle(), Deadzone(slope_right=0.8, slope_left=0.8, threshold_right=1, threshold_left=1)
    inverse = Inverse(believed=dict.fromkeys(unicycle.actuators, zone), width=1e-3, quiet=0.0)
    limits = BackCalculation(speed=1.0, limits=np.array([4.0, 9.0]))
    law = Sampled(inner=Taking(), vehicle=unicycle, anti_windup=limits, compensation=inverse)
    seen = Measurement(position=jnp.zeros(2), velocity=jnp.zeros(2), heading=ZERO, yaw_rate=ZERO)
    asked = agvjax.Reference(
        position=jnp.zeros(2), velocity=jnp.zeros(2), acceleration=jnp.zeros(2), heading=ZERO, heading_rate=ZERO
    )
    done = law.step(law.inner.init(seen, asked), seen, asked)
    # 3 m/s^2 along need 3 / .8 + 1 = 4.75, of which 4 are let through: .8 (4 - 1) = 2.4 are delivered; aside all is
    assert float(done.command.inputs["acceleration"]) == 4.0 and bool(done.limited)
    np.testing.assert_allclose(done.law, [3.0 - 2.4, 0.0], atol=1e-12)


@pytest.mark.slow
def test_a_robot_that_is_asked_for_a_speed_drives_it():
    scenario = load(["base"]).scenario
    law = load(["base"]).controller
    run = {"dt": 0.005, "n_steps": 4000, "save_every": 20}
    law = dataclasses.replace(law, compensation=Inverse(believed=scenario.deadzone))
    speeds = np.linalg.norm(np.asarray(agvjax.simulate(law, scenario, **run).velocity), axis=-1)
    assert speeds[60:].mean() == pytest.approx(0.8, abs=0.01)  # without it .95 (.8 - .06) = .703 by eq. (11)


@agvjax.pytree
class Standing(agvjax.Path):
    """A place to stay at."""

    def __call__(self, t):
        return jnp.zeros(2) + 0.0 * t


@pytest.mark.slow
def test_a_robot_that_is_asked_to_stand_does_not_buzz():
    """2 mm of noise for 20 s: without the quiet part the inverse throws the wheels across the whole deadzone."""
    plant = agvjax.Unicycle()
    scenario = Scenario.of(
        plant,
        path=Standing(),
        disturbance=agvjax.NoDisturbance(),
        sensor=agvjax.Noise(position=0.002, seed=3.0),
        start=agvjax.Start(position=np.zeros(2), velocity=np.zeros(2), heading=0.0),
    )
    law = Sampled(inner=agvjax.NeuroBackstepping(k1=1.0, k2=3.0, Lam=0.1, omega_n=20.0), vehicle=plant, period=0.05)
    inverse = Inverse(believed=plant.deadzones())
    found = {}
    for name, compensation in {
        "none": law.compensation,
        "quiet": dataclasses.replace(inverse, quiet=1.0),
        "sharp": dataclasses.replace(inverse, quiet=0.0, width=0.01),
    }.items():
        run = agvjax.evaluate(
            dataclasses.replace(law, compensation=compensation),
            scenario,
            dt=0.005,
            n_steps=4000,
            criteria=agvjax.Criteria(delivered=True),
        )
        found[name] = float(run["reversals"])
    assert found["quiet"] <= 1.1 * found["none"]
    assert found["sharp"] > 50


def test_reversals_are_counted_by_hand():
    """A command of 1.5 sin(2 pi t) through a deadzone of 1: two reversals a second, and none while it delivers 0."""

    @agvjax.pytree
    class Swinging(agvjax.Law):
        def init(self, measurement, reference):
            return jnp.zeros(())

        def law(self, flow, memory, measurement, reference):
            wave = 1.5 * jnp.sin(2 * jnp.pi * flow)
            return agvjax.Command(position=jnp.stack([wave, jnp.abs(wave)]), heading=jnp.zeros(())), jnp.ones(())

    plant = agvjax.Decoupled()
    one = Deadzone(threshold_right=1.0, threshold_left=1.0)
    scenario = Scenario.of(plant, deadzone=dict.fromkeys(plant.actuators, one))
    run = agvjax.evaluate(Swinging(), scenario, dt=1e-2, n_steps=300, criteria=agvjax.Criteria(delivered=True))
    assert np.asarray(run.reversals_delivered).tolist() == [5.0, 0.0, 0.0]  # 6 half waves in 3 s
    assert float(run["reversals"]) == 5.0


INVERSE = 'controller.compensation={type="inverse", quiet=0.3, believed={left={threshold_right=0.08}}}'


def test_beliefs_are_the_scenarios_where_a_file_says_nothing(tmp_path):
    config = load(["base"], [INVERSE])
    believed = config.controller.compensation.believed
    assert believed["left"].threshold_right == 0.08 and believed["left"].threshold_left == 0.06
    assert believed["right"].threshold_right == 0.06 and believed["right"].slope_left == 0.95
    file = tmp_path / "again.toml"
    file.write_text(dump(config))
    again = load([str(file)])
    assert agvjax.leaves(again.controller) == agvjax.leaves(config.controller)
    without = load(["base"], [INVERSE.replace("left={", 'right="none", left={')]).controller
    assert set(without.compensation.believed) == {"left"}


@pytest.mark.parametrize(
    ("setting", "key"),
    [
        ('controller.compensation={type="inverse", believed={lef={threshold_right=0.08}}}', "compensation.believed"),
        ('controller.compensation={type="inverse", believed={left="none", right="none"}}', "compensation.believed"),
        ('controller.compensation={type="inverse", width=0.0}', "compensation.width"),
        ('controller.compensation={type="inverse", believed={left={slope_left=-1.0}}}', "believed.left.slope_left"),
        ('controller.compensation="invers"', "compensation.type"),
    ],
)
def test_bad_beliefs_are_refused_by_name(setting, key):
    with pytest.raises(agvjax.InputError, match=key):
        load(["base"], [setting])


@pytest.mark.slow
def test_in_continuous_time_known_deadzones_are_no_longer_there():
    """The paper's law on its plant: with a sharp inverse of what is there it drives as without deadzones."""
    sharp = Inverse(believed=Scenario().deadzone, width=1e-3, quiet=0.0)
    run = {"dt": 5e-4, "n_steps": 4000, "save_every": 100}
    without = dataclasses.replace(Scenario(), deadzone=dict.fromkeys(agvjax.Decoupled().actuators, Deadzone()))
    wanted = agvjax.simulate(agvjax.NeuroBackstepping(), without, **run)
    plain = agvjax.simulate(agvjax.NeuroBackstepping(), Scenario(), **run)
    got = agvjax.simulate(agvjax.Compensated(compensation=sharp), Scenario(), **run)
    away = {
        name: max(
            float(np.abs(np.asarray(x.position - wanted.position)).max()),
            float(np.abs(np.asarray(x.heading - wanted.heading)).max()),
        )
        for name, x in {"got": got, "plain": plain}.items()
    }
    assert away["got"] < 1e-3 < 0.05 * away["plain"]


def test_in_continuous_time_it_is_named_in_toml_and_has_no_lead():
    config = load([], ['controller="compensated"'])
    assert config.controller.compensation.believed.keys() == {"position", "heading"}
    assert set(config.controller.compensation.tunable) <= {
        n.removeprefix("compensation.") for n in config.controller.gains_to_tune()
    }
    with pytest.raises(agvjax.InputError, match=r"compensation\.lead = 0\.1"):
        load([], ['controller={type="compensated", compensation={lead=0.1}}'])


def test_its_gains_are_tuned_with_the_laws():
    law = Sampled(vehicle=Base(), inner=agvjax.PathPID(), compensation=Inverse(believed=Base().deadzones()))
    assert law.gains_to_tune()[-4:] == tuple(f"compensation.{n}" for n in ("slope", "threshold", "width", "quiet"))


def test_beliefs_that_name_nothing_are_refused_when_the_loop_is_built():
    law = Sampled(vehicle=agvjax.Unicycle(), period=0.05)
    for believed in ({}, {"left": ZONE}):
        with pytest.raises(ValueError, match="believed=scenario.deadzone"):
            wrong = dataclasses.replace(law, compensation=Inverse(believed=believed))
            agvjax.simulate(wrong, Scenario.of(agvjax.Unicycle()), dt=0.01, n_steps=5)


def test_what_is_identified_is_believed():
    """Of the actuators that were believed in, whatever else was found."""
    plant, found = Base(track=0.6), {"left": ZONE, "right": Deadzone(threshold_right=0.2)}
    law = Sampled(
        vehicle=Base(),
        inner=agvjax.PathPID(),
        compensation=Inverse(believed={"left": Deadzone()}, slope=1.2),
        prediction=agvjax.Predictor(believed=Base().deadzones()),
    ).believing(plant, found)
    assert law.vehicle is plant and law.compensation.believed == {"left": ZONE} and law.compensation.slope == 1.2
    assert law.prediction.believed == found
    paper = agvjax.Compensated().believing(agvjax.Decoupled(L=0.4), {"position": ZONE, "heading": ZONE})
    assert paper.vehicle.L == 0.4 and paper.compensation.believed["heading"] is ZONE


def test_a_delay_is_tuned_within_what_is_remembered():
    law = Sampled(vehicle=Base(), inner=agvjax.PathPID(), period=0.05, prediction=agvjax.Predictor(slots=5))
    assert law.upper_bounds(lambda poles: True)["prediction.delay"] == 0.25
