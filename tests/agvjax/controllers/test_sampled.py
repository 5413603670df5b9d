"""The digital loop: what a computer that looks once a period does, against a loop written by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

import agvjax
import reference
from agvjax import BackCalculation, Chain, Delay, NeuroBackstepping, Noise, Sampled, Saturation, Scenario, Unicycle
from agvjax.controllers.filters import CommandFilter, Filtered, LiteralFilter
from reference import Parameters

DELAYED = {name: Chain(delay=Delay(time=0.02)) for name in Unicycle.actuators}
LIMITED = {
    name: Chain(saturation=Saturation(upper=top, lower=-top), delay=Delay(time=0.02))
    for name, top in zip(Unicycle.actuators, (3.0, 6.0), strict=True)
}
WINDUP = BackCalculation(speed=0.8, limits=np.array([5.5, 9.0]))


@pytest.mark.parametrize(
    "omega_n, zeta",
    [(90.0, 0.75), (90.0, 1.0), (30.0, 1.0000001), (25.0, 1.8), (200.0, 0.05), (314.0, 3.0), (314.0, 50.0)],
)
@pytest.mark.parametrize("law, power", [(CommandFilter(), 1), (LiteralFilter(), 2)])
def test_the_filter_is_stepped_by_the_exponential_of_its_matrix(law, power, omega_n, zeta):
    M = np.array([[0.0, omega_n], [-(omega_n**power), -2 * zeta * omega_n]])
    start, rest, period = np.array([0.3, -0.7]), np.array([0.9, 0.0]), 0.02 if power == 1 else 0.002
    exact = rest + expm(M * period) @ (start - rest) - start
    filtered = Filtered(*(jnp.array(x) for x in (*start, *rest, omega_n, zeta)))
    np.testing.assert_allclose(
        law.over_period(filtered, jnp.array(period)), exact, rtol=1e-11, atol=1e-12 * np.abs(exact).max()
    )


@pytest.mark.parametrize("zeta", [0.3, 1.0, 1.05, 3.0, 50.0, 1e4])
def test_the_filter_in_single_precision_is_off_by_rounding_alone_however_damped(zeta):
    M = np.array([[0.0, 314.0], [-314.0, -2 * zeta * 314.0]])
    exact = (expm(M * 0.02) - np.eye(2)) @ [0.3, -0.7]
    given = Filtered(*(jnp.array(x, jnp.float32) for x in (0.3, -0.7, 0.0, 0.0, 314.0, zeta)))
    change = CommandFilter().over_period(given, jnp.array(0.02, jnp.float32))
    np.testing.assert_allclose(change, exact, rtol=2e-5, atol=2e-6)


@pytest.mark.parametrize("zeta", [0.6, 1.0, 1.4])
def test_its_slopes_agree_with_differences_at_the_damping_1_too(zeta):
    def end(z):
        filtered = Filtered(*(jnp.array(x) for x in (0.3, -0.7, 0.9, 0.0, 60.0)), z)
        return CommandFilter().over_period(filtered, jnp.array(0.02))[0]

    difference = (end(zeta + 1e-5) - end(zeta - 1e-5)) / 2e-5
    np.testing.assert_allclose(jax.grad(end)(zeta), difference, rtol=1e-8)


def by_hand(p, *, period, horizon, h=1e-3, delay=0, top=None, speed=None, own=None, L=0.5):
    """Position (N+1, 2) of a unicycle under the paper's law run once a period; plain NumPy, RK4 for the vehicle.

    `delay` in periods, `top` the limits of what is delivered, `speed` and `own` the anti-windup's.
    """
    k1, k2, Lam, wn, zeta, eta, gamma = p.k1, p.k2, p.Lam, p.omega_n, p.zeta, p.eta1, p.gamma1
    state = np.array([*p.start_position, p.start_heading, 0.0, 0.0])
    c, s = np.cos(p.start_heading), np.sin(p.start_heading)
    state[3], state[4] = c * 0.1 + s * 0.1, (c * 0.1 - s * 0.1) / L
    centers = np.array([-3, -1.5, 0, 1.5, 3])
    E = expm(np.array([[0, wn], [-wn, -2 * zeta * wn]]) * period)
    phi = beta = None
    weight, line, inputs, places = 0.1, [np.zeros(2)] * (delay + 1), np.zeros(2), []

    def rate(t, x, out):
        delta = 0.2 * np.cos(0.5 * t)
        c, s = np.cos(x[2]), np.sin(x[2])
        push, side = c * delta + s * delta, c * delta - s * delta
        moves = x[3] * c - L * x[4] * s, x[3] * s + L * x[4] * c, x[4] + delta
        return np.array([*moves, out[0] + push, out[1] + side / L])

    every = round(period / h)
    for i in range(round(horizon / h)):
        t = i * h
        if i % every == 0:
            c, s = np.cos(state[2]), np.sin(state[2])
            turn = np.array([[c, -s], [s, c]])
            velocity = turn @ np.array([state[3], L * state[4]])
            r, r_rate, _ = reference.path(t)
            Z1 = state[:2] - r
            if phi is None:
                phi, beta = np.array([-k1 * Z1 + r_rate, [0, 0]]), np.zeros(2)
            correction = -k1 * Z1 - Lam * beta
            size = np.linalg.norm(correction)
            limited = speed is not None and size > speed
            alpha = r_rate + (correction * speed / size if limited else correction)
            rest = np.array([alpha, [0, 0]])
            later = rest + E @ (phi - rest)
            Zb2 = velocity - phi[0]
            S = np.exp(-np.array([np.sum((velocity - x) ** 2) for x in centers]) / 0.5)
            share = S @ S / 2
            u = -k2 * Zb2 - Zb2 * weight * share + (later[0] - phi[0]) / period
            weight = np.exp(-eta * period) * weight + (1 - np.exp(-eta * period)) / eta * gamma * (Zb2 @ Zb2) * share
            inputs = (turn.T @ u) / np.array([1, L])
            if own is not None:
                clipped = np.clip(inputs, -own, own)
                limited = limited or (clipped != inputs).any()
                later[0] += (turn @ (clipped * [1, L]) - u) / (1 / period + k2)
                inputs = clipped
            if not limited:
                beta = beta + period * Z1
            phi = later
            line = [inputs, *line[:-1]]
        places.append(state[:2].copy())
        held = line[delay]
        out = reference.delivered(np.array([held[0], 0.0, held[1]]), p)[[0, 2]]
        out = out if top is None else np.clip(out, -np.array(top), top)
        state = reference.rk4_step(lambda t, x, out=out: rate(t, x, out), t, state, h)
    return np.array([*places, state[:2]])


@pytest.mark.parametrize("case", [*(pytest.param(c, marks=pytest.mark.slow) for c in ("plain", "delayed")), "limited"])
def test_the_digital_loop_is_the_one_written_by_hand(case):
    law, actuators, own = Sampled(vehicle=Unicycle()), {}, {}
    if case == "delayed":
        law, actuators, own = Sampled(vehicle=Unicycle(), period=0.01), DELAYED, {"period": 0.01, "delay": 2}
    if case == "limited":
        law, actuators = Sampled(vehicle=Unicycle(), anti_windup=WINDUP), LIMITED
        own = {"delay": 1, "top": [3, 6], "speed": 0.8, "own": np.array([5.5, 9.0])}
    run = agvjax.simulate(law, Scenario.of(Unicycle(), actuators=actuators), n_steps=1500)
    np.testing.assert_allclose(run.position, by_hand(Parameters(), horizon=1.5, **({"period": 0.02} | own)), atol=1e-8)
    changes = np.flatnonzero((np.diff(run.inputs, axis=0) != 0).any(axis=1)) + 1
    assert (changes % (10 if case == "delayed" else 20) == 0).all()  # held in between
    assert run.weight_norm.shape == (1501, 2)


def test_the_law_by_euler_diverges_at_20_ms_and_stepped_exactly_stays_within_a_centimetre():
    scenario = Scenario.of(Unicycle())
    exact = agvjax.simulate(Sampled(vehicle=Unicycle()), scenario)
    euler = agvjax.simulate(Sampled(vehicle=Unicycle(), euler=True), scenario)
    assert exact.ok
    assert not euler.ok
    error = np.linalg.norm(exact.position - exact.reference_position, axis=1)
    assert error[4000:].max() < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("euler", [False, True])
def test_a_shorter_period_tends_to_the_continuous_law(euler):
    scenario = Scenario.of(Unicycle())
    exact = agvjax.simulate(NeuroBackstepping(), scenario, dt=2e-4, n_steps=2500).position[-1]
    off = []
    for every in (8, 4):
        law = Sampled(vehicle=Unicycle(), period=every * 2e-4, euler=euler)
        off.append(np.abs(agvjax.simulate(law, scenario, dt=2e-4, n_steps=2500).position[-1] - exact).max())
    assert off[1] < 2e-3
    assert 0.3 < off[1] / off[0] < 0.7


@pytest.mark.slow
def test_the_paper_gains_on_a_vehicle_that_rolls():
    run = agvjax.simulate(NeuroBackstepping(), Scenario.of(Unicycle()))
    error = np.linalg.norm(run.position - run.reference_position, axis=1)
    assert error[4000:].max() < 0.01
    metrics = agvjax.measure(run)
    assert metrics.rmse.shape == (2,)  # the heading is internal and not scored
    assert run.command.shape == (12001, 2)
    np.testing.assert_allclose(np.abs(run.inputs[0]), [199, 426], rtol=0.01)  # the start asks for what nothing delivers


@pytest.mark.slow
def test_without_anti_windup_the_same_gains_are_lost_from_three_metres():
    inner = NeuroBackstepping(k1=4.0, k2=15.0, Lam=4.0, omega_n=60.0)
    start = agvjax.Start(position=np.array([-2.1, 2.1]))
    scenario = Scenario.of(Unicycle(), actuators=LIMITED, start=start)
    error = {}
    for name, windup in (("with", WINDUP), ("without", agvjax.NoAntiWindup())):
        run = agvjax.simulate(Sampled(inner=inner, vehicle=Unicycle(), anti_windup=windup), scenario)
        error[name] = np.linalg.norm(run.position - run.reference_position, axis=1)
    assert error["with"][6000:].max() < 0.05
    assert error["without"][6000:].max() > 0.5


@pytest.mark.slow
def test_noise_is_drawn_at_the_instants_of_the_law_and_its_size_is_the_one_asked_for():
    scenario = Scenario.of(Unicycle(), sensor=Noise(position=0.01, velocity=0.0, seed=3.0))
    law = Sampled(vehicle=Unicycle(), period=0.02)
    quiet, noisy = (agvjax.simulate(law, s, n_steps=20) for s in (Scenario.of(Unicycle()), scenario))
    # the first command is linear in the position: k2 phi1(0) and phi1' see k1 times the noise
    assert (np.asarray(quiet.inputs[0]) != np.asarray(noisy.inputs[0])).all()
    sensor = scenario.sensor
    zero = jnp.zeros(())
    still = agvjax.Measurement(position=jnp.zeros(2), velocity=jnp.zeros(2), heading=zero, yaw_rate=zero)

    def drawn_next(held, _):
        return sensor.jump(held, still, 0.02), sensor(held, still).position

    _, drawn = jax.lax.scan(drawn_next, sensor.hold(still), length=2000)
    np.testing.assert_allclose(np.std(drawn, axis=0), 0.01, rtol=0.06)
    assert abs(np.mean(drawn[1:] * drawn[:-1])) < 1e-5


@pytest.mark.slow
def test_slopes_of_the_sampled_loop_agree_with_differences():
    law = Sampled(inner=NeuroBackstepping(k1=3.0, k2=9.0, omega_n=30.0), vehicle=Unicycle(), anti_windup=WINDUP)
    scenario = Scenario.of(Unicycle(), actuators=LIMITED)

    @jax.jit
    def cost(z):
        gains = dict(zip(("inner.k1", "inner.k2", "inner.omega_n", "anti_windup.speed"), z, strict=True))
        return agvjax.evaluate(agvjax.replace(law, gains), scenario, dt=5e-3, n_steps=400).total_rmse

    z, step = jnp.array([3.0, 9.0, 30.0, 0.8]), 1e-6
    differences = [(cost(z.at[i].add(step)) - cost(z.at[i].add(-step))) / (2 * step) for i in range(4)]
    np.testing.assert_allclose(jax.jacfwd(cost)(z), differences, rtol=1e-4, atol=1e-7)


def test_a_period_that_is_no_whole_number_of_steps_is_refused_and_so_are_steps_between_instants():
    assert [p.key for p in agvjax.step_faults(Sampled(period=0.02), 3e-3, 12.0, agvjax.RK4)] == ["dt"]
    assert not agvjax.step_faults(Sampled(period=0.02), 5e-3, 12.0, agvjax.RK4)
    with pytest.raises(ValueError, match="control_every must be 1"):
        agvjax.simulate(Sampled(), Scenario(), n_steps=10, control_every=2)
