"""Bases that are driven by velocities, under recorded commands, against an independent program; limits and stops."""

import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
import reference_bases
from agvjax import Ackermann, Base, Chain, Cosine, Deadzone, Delay, Scenario, TwistBase
from laws import PERIOD, Sent, recorded
from reference_bases import ByTwist, Motor, Steered, TwoWheels

DT, STEPS = 5e-4, 5000
START = np.array([0.3, -0.2, 0.7])


def scenario(plant, motors, disturbance=None):
    pairs = list(zip(plant.actuators, motors, strict=True))
    zones = {
        name: Deadzone(
            slope_right=m.slope_right,
            slope_left=m.slope_left,
            threshold_right=m.threshold_right,
            threshold_left=m.threshold_left,
        )
        for name, m in pairs
    }
    return Scenario(
        plant=plant,
        deadzone=zones,
        actuators={name: Chain(delay=Delay(time=m.delay, slots=4)) for name, m in pairs},
        disturbance=agvjax.NoDisturbance() if disturbance is None else disturbance,
        start=agvjax.Start(position=START[:2], velocity=np.array([0.1, 0.1]), heading=START[2]),
    )


def agrees(plant, vehicle, twists, disturbance=None):
    """Whether both make the same of them; the run."""
    given = scenario(plant, vehicle.motors, disturbance)
    run = agvjax.simulate(Sent(twists=twists), given, dt=DT, n_steps=STEPS, save_every=50)
    states = reference_bases.run(vehicle, twists, PERIOD, START, np.asarray(run.t))
    np.testing.assert_allclose(run.position, states[:, :2], atol=1e-6)
    np.testing.assert_allclose(run.heading, states[:, 2], atol=1e-6)
    both = np.array([vehicle.twist(first, second) for _, _, _, first, second in states])
    along = both[:, :1] * np.c_[np.cos(states[:, 2]), np.sin(states[:, 2])]
    np.testing.assert_allclose(run.velocity, along, atol=2e-6)
    assert np.ptp(states[:, :2], axis=0).max() > 0.2
    return run, states


LEFT = Motor(0.95, 0.9, 0.06, 0.04, delay=0.08)
RIGHT = Motor(1.0, 0.85, 0.03, 0.09, delay=0.06)
WHEELS = {
    "as it is believed": TwoWheels(motors=(LEFT, RIGHT)),
    "drift and wheels of another size": TwoWheels(motors=(LEFT, RIGHT), drift=0.03, left=1.04, right=0.97),
    "slow and soft": TwoWheels(motors=(LEFT, RIGHT), tau=0.4, a_max=0.5),
}


@pytest.mark.parametrize("vehicle", WHEELS.values(), ids=WHEELS)
def test_two_wheels_move_as_the_equations_say(vehicle):
    plant = Base(
        track=vehicle.track,
        time_constant=vehicle.tau,
        acceleration=vehicle.a_max,
        drift=vehicle.drift,
        left=vehicle.left,
        right=vehicle.right,
    )
    agrees(plant, vehicle, recorded())


def test_two_wheels_are_pushed_along_and_turned_but_not_aside():
    def pushed(t):
        return np.array([0.3, -0.2, 0.1]) * np.cos(1.3 * t)

    push = Cosine(amplitude=np.array([0.3, -0.2, 0.1]), omega=1.3, phase=0.0)
    agrees(Base(), TwoWheels(motors=(LEFT, RIGHT), disturbance=pushed), recorded(), push)


@pytest.mark.parametrize("drift", [0.0, -0.04])
def test_a_base_that_is_sent_its_twist(drift):
    speed, turn = Motor(0.95, 0.9, 0.06, 0.04, delay=0.08), Motor(0.9, 1.05, 0.1, 0.15, delay=0.1)
    vehicle = ByTwist(motors=(speed, turn), drift=drift, tau=(0.2, 0.1), a_max=(0.8, 2.0))
    plant = TwistBase(time_constants=np.array([0.2, 0.1]), accelerations=np.array([0.8, 2.0]), drift=drift)
    agrees(plant, vehicle, recorded())


@pytest.mark.parametrize("behind", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_steered_wheel_before_or_behind(behind):
    speed, steering = Motor(0.95, 0.9, 0.05, 0.04, delay=0.08), Motor(1.3, 1.2, 0.02, 0.01, delay=0.05)
    vehicle = Steered(motors=(speed, steering), stop=0.6, steering_rate=3.0, behind=behind, drift=0.01)
    run, states = agrees(
        Ackermann(largest_angle=0.6, steering_rate=3.0, behind=behind, drift=0.01), vehicle, recorded()
    )
    assert np.abs(np.asarray(run.inputs)[:, 1]).max() == pytest.approx(0.6)  # never asked for more
    assert np.abs(np.asarray(run.delivered)[:, 1]).max() > 0.7  # its drive would go further
    assert 0.3 < np.abs(states[:, 4]).max() <= 0.6 + 1e-9


@pytest.mark.parametrize("behind", [False, True])
def test_a_steering_wheel_held_hard_over_stands_at_its_stop_and_turns_the_vehicle_the_way_it_was_asked(behind):
    given = scenario(Ackermann(largest_angle=0.5, behind=behind), (Motor(), Motor(1.5, 1.5)))
    run = agvjax.simulate(Sent(twists=np.tile([0.5, 2.0], (50, 1))), given, dt=DT, n_steps=STEPS, save_every=50)
    turned = np.diff(np.asarray(run.heading)[-10:]) / np.diff(np.asarray(run.t)[-10:])
    speed = 0.5 * (1 - np.exp(-2.2 / 0.2))  # limited to 1 m/s^2 until it lags, long ago
    np.testing.assert_allclose(turned, speed * np.tan(0.5) / 1.2, rtol=1e-4)  # to the left, in either build
    assert np.sign(np.asarray(run.inputs)[-1, 1]) == (-1 if behind else 1)


def test_a_wheel_speeds_up_no_faster_than_its_acceleration_and_then_lags():
    given = scenario(Base(acceleration=0.5, time_constant=0.2), (Motor(), Motor()))
    run = agvjax.simulate(Sent(twists=np.tile([0.6, 0.0], (50, 1))), given, dt=DT, n_steps=STEPS, save_every=50)
    t = np.asarray(run.t)
    # 0.5 m/s^2 until 0.1 m/s are missing, at 1 s; then that decays by exp(-(t - 1) / 0.2)
    wanted = np.where(t < 1.0, 0.5 * t, 0.6 - 0.1 * np.exp(-(t - 1.0) / 0.2))
    np.testing.assert_allclose(np.linalg.norm(run.velocity, axis=1), wanted, atol=1e-6)


def test_larger_wheels_go_further_and_curve_and_drift_turns_it_where_it_stands():
    still = scenario(Base(drift=0.02), (Motor(), Motor()))
    run = agvjax.simulate(Sent(twists=np.zeros((50, 2))), still, dt=DT, n_steps=STEPS, save_every=50)
    np.testing.assert_allclose(run.heading, START[2] + 0.02 * np.asarray(run.t), atol=1e-9)
    np.testing.assert_allclose(run.position, np.tile(START[:2], (101, 1)), atol=1e-12)
    uneven = scenario(Base(left=1.0, right=1.02), (Motor(), Motor()))
    run = agvjax.simulate(Sent(twists=np.tile([0.5, 0.0], (50, 1))), uneven, dt=DT, n_steps=STEPS, save_every=50)
    way = np.sum(np.linalg.norm(np.diff(np.asarray(run.position), axis=0), axis=1))
    turned = float(run.heading[-1]) - START[2]
    assert turned == pytest.approx(way * (0.02 / 0.5) / 1.01, rel=1e-4)  # w / v = (r - l) / track over (r + l) / 2


def test_what_is_asked_for_is_what_a_twist_takes():
    def asked(plant, v, w):
        return np.asarray(plant.asked(jnp.array([v, w])))

    np.testing.assert_allclose(asked(Base(track=0.4), 0.5, 1.0), [0.3, 0.7])
    np.testing.assert_allclose(asked(TwistBase(), 0.5, 1.0), [0.5, 1.0])
    np.testing.assert_allclose(asked(Ackermann(), 0.5, 0.25), [0.5, np.arctan(0.6)])
    np.testing.assert_allclose(asked(Ackermann(), -0.5, 0.25), [-0.5, -np.arctan(0.6)])
    np.testing.assert_allclose(asked(Ackermann(behind=True), 0.5, 0.25), [0.5, -np.arctan(0.6)])
    np.testing.assert_allclose(asked(Ackermann(), 0.0, 1.0), [0.0, 0.0])
    np.testing.assert_allclose(asked(Ackermann(), 0.1, 9.0), [0.1, 1.0])
    for plant in (Base(track=0.4), TwistBase(), Ackermann(), Ackermann(behind=True)):
        for v, w in ((0.5, 0.25), (-0.5, 0.25), (0.3, -0.2)):
            np.testing.assert_allclose(plant.body(plant.asked(jnp.array([v, w]))), [v, w], rtol=1e-12)


def test_a_law_that_asks_for_accelerations_is_refused():
    with pytest.raises(ValueError, match="Base is driven by speed and yaw rate: put the law into"):
        agvjax.simulate(agvjax.NeuroBackstepping(), Scenario.of(Base()), n_steps=10)
