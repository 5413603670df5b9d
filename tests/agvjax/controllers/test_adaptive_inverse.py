"""Beliefs about deadzones that learn: against the truth, against their stability proof, and without excitation."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from agvjax import AdaptiveInverse, Base, Chain, Command, Deadzone, Delay, Line, Measurement, Noise, Sampled, Scenario
from agvjax.controllers.replay import stepped
from agvjax.engine.rollout import Meter, Rollout
from tuning.config import load

PERIOD, DELAY = 0.05, 0.08
SIDES = ("slope_right", "slope_left", "threshold_right", "threshold_left")


@agvjax.pytree
class Sines(agvjax.Law):
    """Asks for speeds and yaw rates about 0, as a drive that is to excite everything."""

    straight: bool = agvjax.structure(False)

    def init(self, measurement, reference):
        return jnp.zeros_like(measurement.heading)

    def law(self, flow, memory, measurement, reference):
        t = flow
        v = 0.25 * jnp.sin(0.9 * t) + 0.2 * jnp.sin(2.3 * t + 1)
        w = 0.7 * jnp.sin(0.63 * t + 0.5) + 0.5 * jnp.sin(1.7 * t)
        twist = jnp.stack([jnp.full_like(t, 0.8), jnp.zeros_like(t)]) if self.straight else jnp.stack([v, w])
        return Command(position=jnp.zeros(2), heading=jnp.zeros(()), twist=twist), jnp.ones_like(t)


def times(zone, slope, threshold):
    return Deadzone(**{n: getattr(zone, n) * (slope if n.startswith("slope") else threshold) for n in SIDES})


def loop(zones, slope, threshold, sensor=None, straight=False, others=None, **numbers):
    """A law that believes in wrong zones on a base with these; what else it believes is right but for the `others`."""
    believed = {name: times(zone, slope, threshold) for name, zone in zones.items()}
    inverse = AdaptiveInverse(believed=believed, delay=DELAY, **numbers)
    law = Sampled(inner=Sines(straight=straight), vehicle=Base(), period=PERIOD, compensation=inverse)
    plant, delays = others or (Base(), (DELAY, DELAY))
    late = {name: Chain(delay=Delay(time=t, slots=4)) for name, t in zip(zones, delays, strict=True)}
    return law, Scenario(
        plant=plant,
        deadzone=zones,
        actuators=late,
        disturbance=agvjax.NoDisturbance(),
        sensor=sensor,
        path=Line(),
        limit=1e5,
    )


def stacked(trees):
    return jax.tree.map(lambda *x: jnp.stack([jnp.asarray(number) for number in x]), *trees)


@functools.partial(jax.jit, static_argnames=("seconds", "dt"))
def learnt(law, scenario, seconds, dt=0.005):
    """By actuator the parameters of what is believed at the end of every second, (seconds, 4)."""
    steps = round(seconds / dt)
    rollout = Rollout(law, scenario, timing=agvjax.Timing(dt=dt, n_steps=steps), dtype=None, meter=Meter())

    def second(carry, first):
        rows = rollout.table(first, round(1 / dt))
        carry = jax.lax.scan(lambda c, row: (rollout.step(c, row)[0], None), carry, rows)[0]
        zones = law.compensation.zones(carry.memory.controller.memory.compensation)
        return carry, {name: jnp.stack([getattr(zone, side) for side in SIDES]) for name, zone in zones.items()}

    return jax.lax.scan(second, rollout.begin(), round(1 / dt) * jnp.arange(seconds))[1]


def errors(noise, drawn=False):
    """Largest relative error of all eight parameters after a minute, of 64 vehicles whose beliefs are half wrong.

    `drawn`: lag, acceleration, drift and delays as the preset draws them too, which nobody tells the beliefs.
    """
    rng, loops, truth = np.random.default_rng(1), [], []
    for k in range(64):
        numbers = rng.uniform([0.85, 0.85, 0.02, 0.02], [1.05, 1.05, 0.1, 0.1], (2, 4))  # as the preset draws them
        zones = {
            name: Deadzone(**dict(zip(SIDES, row, strict=True)))
            for name, row in zip(("left", "right"), numbers.tolist(), strict=True)
        }
        sensor = Noise(position=0.0, velocity=noise, heading=0.0, yaw_rate=2 * noise, seed=float(k))
        lag, acceleration, drift, *delays = rng.uniform([0.08, 0.6, -0.02, 0.04, 0.04], [0.25, 1.2, 0.02, 0.12, 0.12])
        others = (Base(time_constant=lag, acceleration=acceleration, drift=drift), delays) if drawn else None
        loops.append(loop(zones, (0.5, 1.5)[k % 2], (0.5, 1.5)[k // 2 % 2], sensor, others=others))
        truth.append(numbers)
    laws, scenarios = (stacked(trees) for trees in zip(*loops, strict=True))
    found = jax.vmap(lambda law, scenario: learnt(law, scenario, 60))(laws, scenarios)
    last = np.stack([found[name][:, -1] for name in ("left", "right")], axis=1)
    return np.max(np.abs(last / np.stack(truth) - 1), axis=(1, 2))


@pytest.mark.slow
def test_beliefs_half_wrong_come_to_the_truth_within_a_minute():
    found = errors(0.0)
    assert np.mean(found < 0.1) >= 0.9 and np.median(found) < 0.03


@pytest.mark.slow
def test_noise_of_a_millimetre_per_second_costs_some_of_that():
    found = errors(0.001)
    assert np.mean(found < 0.1) >= 0.5 and np.max(found) < 0.4


@pytest.mark.slow
def test_what_the_vehicle_does_otherwise_is_put_down_to_the_deadzone():
    """Not what one would like; the docs say so."""
    assert np.mean(errors(0.0, drawn=True) < 0.1) < 0.1


ZONES = {name: Deadzone(slope_right=0.95, slope_left=0.9, threshold_right=0.06, threshold_left=0.05) for name in "ab"}
ZONES = dict(zip(("left", "right"), ZONES.values(), strict=True))


@pytest.mark.slow
def test_on_a_straight_line_an_hour_teaches_what_is_delivered_and_no_more():
    sensor = Noise(position=0.0, velocity=0.001, heading=0.0, yaw_rate=0.002)
    law, scenario = loop(ZONES, 1.3, 1.3, sensor, straight=True)
    found = learnt(law, scenario, 3600, dt=0.025)
    for name, zone in ZONES.items():
        believed, at_first = np.asarray(found[name]), np.array([getattr(zone, side) * 1.3 for side in SIDES])
        np.testing.assert_allclose(believed[:, [1, 3]], np.tile(at_first[[1, 3]], (3600, 1)), rtol=1e-12)  # never used
        u = 0.8 / zone.slope_right + zone.threshold_right  # what the wheel needs for 0.8 m/s
        delivered = believed[:, 0] * (u - believed[:, 2])
        assert np.all(np.abs(delivered[60:] / 0.8 - 1) < 0.03)
        assert believed[-1, 2] < 0.01  # the threshold is not told from the slope
        assert np.ptp(believed[60:, 0]) < 0.06 and np.ptp(believed[60:, 2]) < 0.01  # and stays where it came to


def test_by_hand_one_step_of_one_wheel():
    """Wheels that have stood, sent u for a period: the speed is G m (u - s) by RK4's own G, and so is its slope."""
    zone = Deadzone(slope_right=0.8, slope_left=0.8, threshold_right=0.05, threshold_left=0.05)
    numbers = dict(rate=0.5, dead_band=0.01, floor=0.02, farthest=3.0)
    inverse = AdaptiveInverse(believed={"left": zone, "right": zone}, usual=jnp.array([0.4, 0.4]), **numbers)
    still = Measurement(position=jnp.zeros(2), velocity=jnp.zeros(2), heading=jnp.zeros(()), yaw_rate=jnp.zeros(()))
    memory = inverse.hold({"left": jnp.zeros(()), "right": jnp.zeros(())}, still)
    free = Base(acceleration=100.0)  # where the acceleration is limited, nothing is learnt of what was delivered
    memory = inverse.learnt(memory, free, still, 0.05)
    memory = inverse.remembering(memory, {"left": jnp.asarray(0.3), "right": jnp.asarray(0.3)})
    z = 0.05 / 0.15
    G = z - z**2 / 2 + z**3 / 6 - z**4 / 24
    e = 0.12 - G * 0.8 * 0.25  # along x; nothing else moves
    m, q = G / 2 * (0.3 - 0.4) / 0.2, G / 2  # slopes of the mean of both wheels, m in halves of the usual input
    step = 0.5 * (e - 0.01) / (0.02 + 2 * (m**2 + q**2))
    found = inverse.learnt(memory, free, Measurement(**{**still.__dict__, "velocity": jnp.array([0.12, 0.0])}), 0.05)
    expected = [0.8 + step * m / 0.2, 0.8, 0.8 * 0.35 + step * q, 0.8 * 0.35]
    for name in ("left", "right"):
        np.testing.assert_allclose(found.beliefs[name], expected, rtol=1e-12)
    far = inverse.learnt(memory, free, Measurement(**{**still.__dict__, "velocity": jnp.array([9.0, 0.0])}), 0.05)
    assert float(far.beliefs["left"][2]) == pytest.approx(3 * 0.8 * 0.35, rel=1e-14)  # kept within its bounds
    zones = inverse.zones(far)["left"]
    assert float(zones.threshold_right) == 0 and float(zones.slope_right) > 0


def test_beliefs_never_move_away_from_the_truth():
    """The proof's V, on random inputs, with an error as large as the dead-band: never more after a step than before."""
    rng, plant = np.random.default_rng(0), Base(acceleration=100.0)
    inverse = AdaptiveInverse(
        believed={name: times(zone, 1.4, 0.6) for name, zone in ZONES.items()}, rate=1.9, dead_band=0.02
    )
    true = AdaptiveInverse(believed=ZONES, dead_band=0.02)
    still = Measurement(position=jnp.zeros(2), velocity=jnp.zeros(2), heading=jnp.zeros(()), yaw_rate=jnp.zeros(()))
    nothing = {name: jnp.zeros(()) for name in ZONES}
    memory, truth = inverse.hold(nothing, still), true.hold(nothing, still)
    memory = dataclasses.replace(memory, begun=jnp.ones(()))
    step = jax.jit(lambda memory, seen: inverse.learnt(memory, plant, seen, PERIOD))
    expected = jax.jit(lambda memory: true._ahead(truth.beliefs, memory, plant, PERIOD))

    def V(memory):
        off = [(memory.beliefs[name] - truth.beliefs[name]) * jnp.array([0.2, 0.2, 1, 1]) for name in ZONES]
        return float(sum(jnp.sum(x**2) for x in off))

    begun = before = V(memory)
    for _ in range(300):
        side = rng.choice([-1, 1])  # beyond either threshold, where what is delivered is linear in the beliefs
        sent = {name: jnp.asarray(side * rng.uniform(0.2, 0.8)) for name in ZONES}
        memory = dataclasses.replace(inverse.remembering(memory, sent), before=still)
        seen = expected(memory)
        off = jnp.asarray(rng.uniform(-0.02, 0.02, 2))
        seen = dataclasses.replace(
            seen, velocity=seen.velocity + off * jnp.array([1.0, 0.0]), yaw_rate=seen.yaw_rate + off[1]
        )
        memory = step(memory, seen)
        assert V(memory) <= before + 1e-12
        before = V(memory)
    assert before < begun / 10


@pytest.mark.parametrize(
    "change, key",
    [
        ({"usual": np.array([0.4])}, "compensation.usual"),
        ({"usual": np.array([0.4, 0.05])}, "compensation.usual"),
        ({"farthest": 1.0}, "compensation.farthest"),
        ({"rate": 2.5}, "compensation.rate"),
        ({"slots": 2}, "compensation.slots"),
        ({"believed": {}}, "compensation.believed"),
    ],
)
def test_what_cannot_work_is_said(change, key):
    law, scenario = loop(ZONES, 1.0, 1.0)
    assert law.faults(scenario.plant) == []
    wrong = dataclasses.replace(law, compensation=dataclasses.replace(law.compensation, **change))
    assert [fault.key for fault in wrong.faults(scenario.plant)] == [key]


def test_continuous_time_has_no_periods_to_learn_in():
    law = agvjax.Compensated(inner=Sines(), vehicle=Base(), compensation=loop(ZONES, 1.0, 1.0)[0].compensation)
    assert [fault.key for fault in law.faults(Base())] == ["compensation.type"]


def test_a_file_says_it():
    told = 'controller.compensation={type="adaptive_inverse",rate=0.2,delay=0.08,usual=[0.5,0.4]}'
    config = load(["base"], [told])
    found = config.controller.compensation
    assert (found.rate, found.delay, list(found.usual)) == (0.2, 0.08, [0.5, 0.4])
    assert found.believed == config.scenario.deadzone
    assert "compensation.rate" in config.controller.gains_to_tune()
    assert config.controller.upper_bounds(lambda poles: True)["compensation.rate"] == 2.0


@pytest.mark.parametrize("more, moved", [(0.0, 0.0), (0.2, -1.0)])
def test_an_actuator_of_two_inputs_learns_each_axis(more, moved):
    """The paper's plant, whose position channel has x and y; a threshold larger than believed lowers q on its side."""
    plant = agvjax.Decoupled()
    believed = plant.deadzones()
    zone = believed["position"]
    true = {**believed, "position": dataclasses.replace(zone, threshold_right=zone.threshold_right + more)}
    inverse = agvjax.AdaptiveInverse(believed=believed, usual=np.array([3.0, 2.0]))
    start = agvjax.Start(position=np.zeros(2), velocity=np.array([0.3, -0.2]), heading=0.1)
    state, period = plant.start(jax.tree.map(jnp.asarray, start)), 0.01
    wanted = {"position": jnp.array([2.0, -1.5]), "heading": jnp.array(1.0)}
    nothing = {"position": jnp.zeros(2), "heading": jnp.zeros(())}
    memory = inverse.hold(wanted, plant.output(state, nothing))
    first = memory.beliefs["position"]
    for _ in range(3):
        memory = inverse.learnt(memory, plant, plant.output(state, nothing), period)
        sent, memory = inverse.sent(memory, wanted, period)
        memory = inverse.remembering(memory, sent)
        delivered = {name: true[name](u) for name, u in sent.items()}
        plain = agvjax.Inverse(believed=believed).inverted(wanted)
        if not more:
            np.testing.assert_allclose(sent["position"], plain["position"], rtol=1e-9)
        state = stepped(plant, state, delivered, period)
        nothing = delivered
    change = np.asarray(memory.beliefs["position"] - first)
    assert first.shape == (4, 2)
    assert np.sign(np.round(change[2, 0], 9)) == moved  # x was asked to the right, y to the left
    assert abs(change[3, 1]) <= 0.01 * abs(change[2, 0])  # y is told right; a little comes over by the turned velocity
