"""Vehicles that roll: unicycle and differential drive, against equations written out here."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import agvjax
from agvjax import Command, Deadzone, DifferentialDrive, NoDisturbance, Scenario, SpeedDrive, Start, Unicycle
from agvjax.plants import RollingState
from laws import OpenLoop

RNG = np.random.default_rng(5)
ROBOT = {"mass": 12.7, "inertia": 0.33, "friction": 0.05, "viscous": 0.01, "L": 0.15}


@agvjax.pytree
class Torques(OpenLoop):
    """Two sinusoids as torques, whatever the vehicle does."""

    def inputs(self, t):
        return dict(zip(("torque_left", "torque_right"), torques(t, jnp), strict=True))


def torques(t, xp=np):
    return 0.3 * xp.sin(1.3 * t) + 0.1, 0.25 * xp.cos(0.9 * t) + 0.12


def test_differential_drive_with_friction_agrees_with_scipy():
    plant = DifferentialDrive(**ROBOT, road_slope=np.array([0.02, -0.01]))
    idle = dict.fromkeys(plant.actuators, Deadzone())
    scenario = Scenario.of(plant, deadzone=idle, disturbance=NoDisturbance(), start=Start(heading=0.4))
    run = agvjax.simulate(Torques(), scenario, n_steps=6000)

    def rate(t, x):
        v, w, psi = x[3], x[4], x[2]
        wheels = np.array([v - 0.17 * w, v + 0.17 * w]) / 0.1
        net = np.array(torques(t)) - 0.05 * np.tanh(wheels / 0.1) - 0.01 * wheels
        slope = -9.81 * (0.02 * np.cos(psi) - 0.01 * np.sin(psi))
        a, alpha = net.sum() / (0.1 * 12.7) + slope, (net[1] - net[0]) * 0.17 / (0.1 * 0.33)
        return [v * np.cos(psi), v * np.sin(psi), w, a, alpha]

    c, s = np.cos(0.4), np.sin(0.4)
    v, w = 0.1 * (c + s), 0.1 * (c - s) / 0.15
    axle = np.array([-0.5, 0.5]) - 0.15 * np.array([c, s])
    found = solve_ivp(rate, (0, 6), [*axle, 0.4, v, w], method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    ahead = found[:2] + 0.15 * np.array([np.cos(found[2]), np.sin(found[2])])
    np.testing.assert_allclose(run.position[-1], ahead, atol=2e-7)  # friction has a kink that RK4 at 1 ms feels
    np.testing.assert_allclose(run.heading[-1], found[2], atol=2e-7)


def test_power_goes_into_kinetic_energy():
    plant = SMOOTH
    for _ in range(20):
        state, (left, right) = moving(), RNG.normal(size=2)
        v, w = float(state.speed), float(state.yaw_rate)
        torque = {"torque_left": jnp.array(left), "torque_right": jnp.array(right)}
        rate = plant.derivative(state, (), torque, jnp.zeros(3))
        energy = 12.7 * v * rate.speed + 0.33 * w * rate.yaw_rate
        power = left * (v - 0.17 * w) / 0.1 + right * (v + 0.17 * w) / 0.1
        np.testing.assert_allclose(energy, power, rtol=1e-12)


SMOOTH = DifferentialDrive(**(ROBOT | {"friction": 0.0, "viscous": 0.0}))
VEHICLES = [Unicycle(L=0.4), SMOOTH, dataclasses.replace(SMOOTH, drive=SpeedDrive(gain=1.7))]
each_vehicle = pytest.mark.parametrize("plant", VEHICLES, ids=["unicycle", "torques", "wheel speeds"])


def moving():
    v, w, psi = RNG.normal(size=3)
    x = jnp.array(RNG.normal(size=2))
    return RollingState(position=x, heading=jnp.array(psi), speed=jnp.array(v), yaw_rate=jnp.array(w))


@each_vehicle
def test_what_is_allocated_moves_the_point_as_commanded(plant):
    for _ in range(20):
        state, U = moving(), jnp.array(RNG.normal(size=2))
        measurement = plant.output(state, {})
        inputs = plant.allocate(Command(position=U, heading=jnp.zeros(())), measurement)
        np.testing.assert_allclose(plant.achieved(inputs, measurement), U, atol=1e-12)
        rate = plant.derivative(state, (), inputs, jnp.zeros(3))
        acceleration = jax.jvp(lambda s: plant.output(s, {}).velocity, (state,), (rate,))[1]
        v, w, psi, L = state.speed, state.yaw_rate, state.heading, plant.L
        s, c = np.sin(psi), np.cos(psi)
        F = np.array([-v * w * s - L * w**2 * c, v * w * c - L * w**2 * s])  # eq. (4)
        np.testing.assert_allclose(acceleration, F + U, atol=1e-12)  # eq. (3)


@each_vehicle
def test_following_exactly_takes_what_needs_says(plant):
    v, w, a, alpha = RNG.normal(size=(4, 7))
    needed = plant.needs(agvjax.Motion(v, w, a, alpha))
    for i in range(7):
        state = dataclasses.replace(moving(), speed=jnp.array(v[i]), yaw_rate=jnp.array(w[i]))
        inputs = {name: jnp.array(needed[name][i]) for name in plant.actuators}
        rate = plant.derivative(state, (), inputs, jnp.zeros(3))
        np.testing.assert_allclose([rate.speed, rate.yaw_rate], [a[i], alpha[i]], atol=1e-12)


def test_the_start_gives_the_point_the_velocity_asked_for():
    start = Start(position=np.array([1.0, 2.0]), velocity=np.array([0.7, -0.4]), heading=2.1)
    for plant in VEHICLES:
        seen = plant.output(plant.start(start), {})
        np.testing.assert_allclose(seen.velocity, [0.7, -0.4], atol=1e-15)
        np.testing.assert_allclose(seen.position, [1.0, 2.0])


def test_a_push_moves_the_point_as_eq_6_says_and_a_drift_turns_it():
    plant, state = VEHICLES[0], moving()
    still = {"acceleration": jnp.zeros(()), "yaw_acceleration": jnp.zeros(())}

    def rates(delta):
        return plant.derivative(state, (), still, jnp.array(delta))

    def acceleration(delta):
        return np.asarray(jax.jvp(lambda s: plant.output(s, {}).velocity, (state,), (rates(delta),))[1])

    free = acceleration([0.0, 0.0, 0.0])
    np.testing.assert_allclose(acceleration([0.3, -0.2, 0.0]) - free, [0.3, -0.2], atol=1e-12)
    velocity = np.asarray(plant.output(state, {}).velocity)
    turned = 0.1 * np.array([-velocity[1], velocity[0]])
    np.testing.assert_allclose(acceleration([0.0, 0.0, 0.1]) - free, turned, atol=1e-12)
    np.testing.assert_allclose(rates([0.0, 0.0, 0.1]).heading, state.yaw_rate + 0.1)


@pytest.mark.slow
def test_slopes_of_a_drive_agree_with_differences():
    plant = DifferentialDrive(**ROBOT)
    scenario = Scenario.of(plant, deadzone=dict.fromkeys(plant.actuators, Deadzone()))

    @jax.jit
    def end(x):
        names = ("plant.mass", "plant.inertia", "plant.friction", "plant.viscous", "plant.L", "plant.track")
        changed = agvjax.replace(scenario, dict(zip(names, x, strict=True)))
        run = agvjax.simulate(Torques(), changed, dt=5e-3, n_steps=200)
        return jnp.sum(run.position[-1] ** 2)

    x, step = jnp.array([12.7, 0.33, 0.05, 0.01, 0.15, 0.34]), 1e-6
    differences = [(end(x.at[i].add(step)) - end(x.at[i].add(-step))) / (2 * step) for i in range(6)]
    np.testing.assert_allclose(jax.jacfwd(end)(x), differences, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(jax.grad(end)(x), differences, rtol=1e-6, atol=1e-8)
