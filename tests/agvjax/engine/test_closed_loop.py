"""The whole loop against an independent reference: the default lap, its metrics, every reading, the integrators."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
import reference
from agvjax import Deadzone, Decoupled, NeuroBackstepping, Scenario, Start, Tangent, evaluate, measure, simulate
from agvjax.readings import ForwardSpeed, KinematicYawRate, LiteralFilter, RawBearing, SwappedBearing
from reference import Parameters

INTEGRATORS = {"euler": (agvjax.EULER, 1), "heun": (agvjax.HEUN, 2), "rk4": (agvjax.RK4, 4)}


def parts(run):
    """Vehicle and law of a trajectory in the reference's order."""
    c = run.controller
    law = [c.phi1, c.phi2, c.xi1, c.xi2, c.beta1, c.network.varphi, c.beta2, c.network.varphi_psi]
    return [run.position, run.velocity, run.heading, *law]


def packed(trajectory):
    """The trajectory's whole state in the reference's order, shape (n, 18)."""
    return np.column_stack([np.asarray(column) for column in parts(trajectory)])


@functools.cache
def rk4(p, dt, n_steps):
    return reference.rk4(p, dt, n_steps)[1]


@pytest.fixture(scope="session")
def lap():
    """Times and states of the default lap by DOP853."""
    return reference.solve(Parameters())


@pytest.fixture(scope="session")
def run():
    """The default lap by agvjax."""
    return simulate(NeuroBackstepping(), Scenario())


@pytest.fixture(scope="session")
def judged(lap):
    """Every metric of the reference's lap, in plain NumPy."""
    t, s = lap
    e, u = reference.errors(t, s, Parameters()), reference.commands(t, s, Parameters())
    late = t >= 4.0 - 1e-9
    outside = np.abs(e) > 0.05
    return {
        "rmse": reference.trapezoid_rmse(t, e),
        "rmse_late": reference.trapezoid_rmse(t[late], e[late]),
        "iae": np.trapezoid(np.abs(e), t, axis=0),
        "ise": np.trapezoid(e**2, t, axis=0),
        "itae": np.trapezoid(t[:, None] * np.abs(e), t, axis=0),
        "overshoot": np.maximum(0.0, (-np.sign(e[0]) * e).max(axis=0)),
        "settling_time": np.array([t[column].max() for column in outside.T]),
        "rms_command": reference.trapezoid_rmse(t, u),
        "peak_command": np.abs(u).max(axis=0),
        "chatter": np.abs(np.diff(u, axis=0)).sum(axis=0),
    }


def test_default_lap_follows_the_reference_everywhere(run, lap):
    t, states = lap
    np.testing.assert_allclose(run.t, t, rtol=0, atol=1e-12)
    off = np.abs(packed(run) - states)
    assert off[:, [0, 1, 4, 15, 17]].max() < 1e-5
    assert off[t > 0.5].max() < 1e-5
    # where the commands cross their thresholds (t < 0.1 s) RK4 loses its order: the reference's own is 5e-5 off
    assert off.max() < 1e-4
    assert bool(run.ok)


def test_default_lap_shows_the_commands_and_references_of_its_states(run, lap):
    t, states = lap
    commands = reference.commands(t, packed(run), Parameters())
    np.testing.assert_allclose(run.command, commands, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.reference_position, reference.path(t)[0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.reference_heading, reference.heading(t)[0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.delivered, reference.delivered(commands, Parameters()), atol=1e-9)


def test_default_lap_has_the_errors_and_the_end_that_spec_states(run, lap):
    error = np.asarray(agvjax.tracking_error(run))
    np.testing.assert_allclose(measure(run).rmse, [0.03840, 0.03450, 0.04346], rtol=0, atol=6e-6)
    np.testing.assert_allclose(np.sqrt((error**2).mean(axis=0)), [0.03853, 0.03465, 0.04353], rtol=0, atol=6e-6)
    end = packed(run)[-1]
    np.testing.assert_allclose([*end[:2], end[4]], [0.008270, 0.001770, 0.469298], rtol=0, atol=6e-7)
    np.testing.assert_allclose(run.weight_norm[-1], [0.12043, 0.09942], rtol=0, atol=6e-6)
    np.testing.assert_allclose([*end[:2], end[4]], lap[1][-1, [0, 1, 4]], rtol=1e-4)
    np.testing.assert_allclose(run.weight_norm[-1], lap[1][-1, [15, 17]], rtol=1e-4)


@pytest.mark.parametrize("by", ["measure", "evaluate"])
def test_metrics_of_the_default_lap_are_those_of_the_reference(run, judged, by):
    metrics = measure(run) if by == "measure" else evaluate(NeuroBackstepping(), Scenario())
    assert bool(metrics.ok) and bool(jnp.all(metrics.settled))
    np.testing.assert_allclose(metrics.settling_time, [0.146, 0.139, 9.408], rtol=0, atol=1e-9)
    np.testing.assert_allclose(metrics.peak_command, [219.45768, 191.96591, 4.3812486], rtol=1e-6)
    for name, wanted in judged.items():
        np.testing.assert_allclose(getattr(metrics, name), wanted, rtol=2e-5, err_msg=name)
    np.testing.assert_allclose(metrics.total_rmse, np.sqrt((judged["rmse"] ** 2).sum()), rtol=2e-5)
    np.testing.assert_allclose(metrics.effort, np.sqrt((judged["rms_command"] ** 2).sum()), rtol=2e-5)
    np.testing.assert_allclose(metrics.peak_position, 219.45768, rtol=1e-7)
    np.testing.assert_allclose(metrics.total_chatter, judged["chatter"].sum(), rtol=2e-5)


# name: controller, scenario, the reference's reading; step and number of steps where they are not 2 ms and 1000
LAW, PAPER, TANGENT = NeuroBackstepping(), Scenario(), Scenario(heading=Tangent())
SMALL = agvjax.RadialBasis(centers=np.array([-1.0, 0.5, 2.0]), width=0.8)
FROM_VELOCITIES = Decoupled(yaw_rate=KinematicYawRate())
LITERAL = dataclasses.replace(FROM_VELOCITIES, coupling=ForwardSpeed(), L=0.3)
ELSEWHERE = Start(position=np.array([0.3, -0.2]), velocity=np.array([-0.1, 0.4]), heading=-0.5)
PUSH = {"amplitude": (0.1, 0.4, 0.3), "omega": (1.0, 2.0, 3.0), "phase": (0.1, 0.2, 0.3)}
START = {"start_position": (0.3, -0.2), "start_velocity": (-0.1, 0.4), "start_heading": -0.5}
READINGS = {
    "literal filter": (NeuroBackstepping(filter=LiteralFilter()), PAPER, {"filter": "literal"}, 1e-3, 1000),
    "swapped bearing": (LAW, Scenario(heading=SwappedBearing()), {"heading": "bearing_swapped"}),
    "tangent": (LAW, TANGENT, {"heading": "tangent"}, 2e-3, 2000),
    "unwrapped": (NeuroBackstepping(wrapped=False), TANGENT, {"heading": "tangent", "wrapped": False}, 2e-3, 2000),
    "literal (4)": (LAW, Scenario(plant=Decoupled(coupling=ForwardSpeed())), {"coupling": "literal"}),
    "yaw rate from velocities": (LAW, Scenario(plant=FROM_VELOCITIES), {"yaw_rate": "velocity"}),
    "both literal": (LAW, Scenario(plant=LITERAL), {"yaw_rate": "velocity", "coupling": "literal", "L": 0.3}),
    "belief": (NeuroBackstepping(Pi_hat=0.7, Pi_psi_hat=0.8), PAPER, {"Pi_hat": 0.7, "Pi_psi_hat": 0.8}),
    "belief by axis": (NeuroBackstepping(Pi_hat=np.array([0.6, 0.8])), PAPER, {"Pi_hat": (0.6, 0.8)}),
    "network that matters": (NeuroBackstepping(b1=0.1, b2=0.2), PAPER, {"b1": 0.1, "b2": 0.2}),
    "another network": (
        NeuroBackstepping(b1=0.1, position_network=SMALL, heading_network=SMALL),
        PAPER,
        {"b1": 0.1, "centers": (-1.0, 0.5, 2.0), "width": 0.8},
    ),
    "another start and disturbance": (
        NeuroBackstepping(varphi_start=0.4, varphi_psi_start=0.2),
        Scenario(start=ELSEWHERE, disturbance=agvjax.Cosine(**{n: np.array(x) for n, x in PUSH.items()})),
        START | {"start_varphi": 0.4, "start_varphi_psi": 0.2} | {f"disturbance_{n}": x for n, x in PUSH.items()},
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param(n, marks=() if n == "tangent" else pytest.mark.slow) for n in READINGS])
def test_reading_agrees_with_the_reference_to_rounding(name):
    controller, scenario, reading, *steps = READINGS[name]
    dt, n_steps = steps or (2e-3, 1000)
    states = rk4.__wrapped__(Parameters(**reading), dt, n_steps)
    mine = packed(simulate(controller, scenario, dt=dt, n_steps=n_steps))
    np.testing.assert_allclose(mine, states, rtol=1e-9, atol=1e-9)
    default = rk4(Parameters(), dt, n_steps)
    assert np.abs(states - default)[:, :5].max() > 1e-3  # the reading decides something here


@pytest.mark.slow
def test_a_step_begins_where_the_raw_bearing_jumps():
    crossing = np.pi / reference.THETA_RATE  # 5.998 s
    run = simulate(NeuroBackstepping(), Scenario(heading=RawBearing()), dt=2e-3, n_steps=3250)
    t = np.asarray(run.t)
    assert t[2999] == pytest.approx(crossing, abs=1e-14)
    np.testing.assert_allclose(np.delete(t, 2999), 2e-3 * np.delete(np.arange(3251), 2999), rtol=1e-14)
    states = reference.solve(Parameters(heading="bearing_raw"), horizon=6.5, times=t)[1]
    np.testing.assert_allclose(packed(run)[250:, :5], states[250:, :5], rtol=0, atol=1e-5)  # 6e-3 with a step across it


@pytest.mark.slow
def test_a_step_begins_where_a_disturbance_jumps_whatever_the_grid():
    jump = 0.50371
    sides = [f"deadzone.heading.{part}" for part in ("slope_right", "slope_left")]
    adrift = agvjax.replace(Scenario(disturbance=agvjax.Step(amplitude=0.3, time=jump)), dict.fromkeys(sides, 1e-12))
    run = simulate(NeuroBackstepping(), adrift, n_steps=100, dt=1e-2)  # its yaw actuator delivers next to nothing
    t = np.asarray(run.t)
    assert t[50] == jump and t[49] == 0.49 and t[51] == 0.51
    np.testing.assert_allclose(run.heading, 0.1 + 0.3 * np.maximum(0.0, t - jump), atol=1e-10)


def start_to_end(dt, integrator):
    """The state after one step as a function of where the run starts."""

    def end(start):
        scenario = Scenario(start=Start(position=start[:2], velocity=start[2:4], heading=start[4]))
        run = simulate(NeuroBackstepping(), scenario, dt=dt, n_steps=1, integrator=integrator)
        return jnp.concatenate([jnp.atleast_1d(x[1]) for x in parts(run)])

    return end


def test_jacobian_of_one_euler_step_is_the_hand_derived_one():
    dt, start = 1e-3, np.array([-0.5, 0.5, 0.1, 0.1, 0.1])
    jacobian = np.asarray(jax.jacfwd(start_to_end(dt, agvjax.EULER))(jnp.array(start)))

    # I + dt A at the start, A by central differences; the filter starts at alpha1(0), so it moves with the position
    p, s = Parameters(), reference.initial_state(Parameters())
    A = np.empty((18, 18))
    for i in range(18):
        step = np.zeros(18)
        step[i] = 1e-6 * max(1.0, abs(s[i]))
        more, less = (reference.right_hand_side(0.0, moved, p) for moved in (s + step, s - step))
        A[:, i] = (more - less) / (2 * step[i])
    seed = np.zeros((18, 5))
    seed[:5] = np.eye(5)
    seed[5, 0] = seed[6, 1] = -p.k1
    np.testing.assert_allclose(jacobian, (np.eye(18) + dt * A) @ seed, rtol=1e-7, atol=1e-9)

    # by hand: u_x > 0 takes slope .6, u_y < 0 slope .8, omega_bar > 0 slope .91, all beyond their thresholds
    psi, c = 0.1, np.array([-3.0, -1.5, 0.0, 1.5, 3.0])
    S2_v = np.exp(-((0.1 - c) ** 2) * 2 * 2 / 0.5).sum()  # S'S at chi2 = (.1, .1): twice (.1 - c)^2, divisor .5
    gain = 20.0 + 0.1 * S2_v / 2  # k2 + varphi S'S / (2 b1^2)
    np.testing.assert_allclose(jacobian[0], [1, 0, dt, 0, 0], atol=1e-15)
    np.testing.assert_allclose(jacobian[2, 0], dt * 0.6 * gain * -20.0, rtol=1e-12)
    np.testing.assert_allclose(jacobian[3, 1], dt * 0.8 * gain * -20.0, rtol=1e-12)
    S2 = np.exp(-((psi - c) ** 2) * 2 / 0.5)
    z3 = psi - np.arctan2(1, 2)
    share, share_rate = 0.05 * S2.sum(), 0.05 * (S2 * -8 * (psi - c)).sum()  # varphi_psi / (2 b2^2) = .05; 8 = 4 / .5
    np.testing.assert_allclose(jacobian[4, 4], 1 - dt * 0.91 * (12.0 + share + z3 * share_rate), rtol=1e-12)
    np.testing.assert_allclose(jacobian[5], [-20, 0, 0, 0, 0], atol=1e-12)  # phi1' = omega_n phi2 = 0 at the start


@pytest.mark.parametrize("name", INTEGRATORS)
def test_observed_order_of_the_integrator(name):
    integrator, order = INTEGRATORS[name]
    scenario = Scenario(deadzone={"position": Deadzone(), "heading": Deadzone()})
    ones = {f"{side}slope_{hand}": 1.0 for side in ("", "heading_") for hand in ("right", "left")}
    zeros = {f"{side}threshold_{hand}": 0.0 for side in ("", "heading_") for hand in ("right", "left")}
    exact = reference.solve(Parameters(**ones, **zeros), horizon=0.25, times=[0.0, 0.2])[1][1]
    coarse = packed(simulate(NeuroBackstepping(), scenario, dt=4e-4, n_steps=1000, integrator=integrator))[500]
    fine = packed(simulate(NeuroBackstepping(), scenario, dt=2e-4, n_steps=1000, integrator=integrator))[1000]
    ratio = np.linalg.norm(coarse - exact) / np.linalg.norm(fine - exact)
    assert abs(np.log2(ratio) - order) < 0.1
    assert np.linalg.norm(fine - exact) > 1e-11  # above the rounding, so that the ratio means something


def test_float32_follows_the_float64_reference(lap):
    run = simulate(NeuroBackstepping(), Scenario(), n_steps=1000, dtype=jnp.float32)
    assert all(leaf.dtype in (jnp.float32, bool) for leaf in jax.tree.leaves(run))
    np.testing.assert_allclose(packed(run)[:, :5], lap[1][:1001, :5], rtol=0, atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("save_every", [3, 130, 390])
def test_saving_less_often_gives_the_same_samples(save_every):
    p, n_steps = Parameters(), 390  # no multiple of the 100 steps that are tabulated together
    run = simulate(NeuroBackstepping(), Scenario(), n_steps=n_steps, save_every=save_every)
    np.testing.assert_allclose(packed(run), rk4(p, 1e-3, n_steps)[::save_every], rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(run.t, np.arange(0, n_steps + 1, save_every) * 1e-3, atol=1e-15)


def test_a_run_that_leaves_the_limit_is_latched_where_it_was():
    scenario = Scenario(disturbance=agvjax.Cosine(amplitude=np.array([3e4, 0.0, 0.0]), omega=0.0), limit=50.0)
    run = simulate(NeuroBackstepping(), scenario, n_steps=390, save_every=1)
    off = packed(run)[:, :5] - np.pad(run.reference_position, ((0, 0), (0, 3)))  # x, y, their rates, heading
    size = np.linalg.norm(off, axis=1)[: np.argmax(np.all(np.diff(packed(run), axis=0) == 0, axis=1)) + 1]
    assert not bool(run.ok) and np.isfinite(packed(run)).all() and size.max() < 50.0
    assert (packed(run)[-1] == packed(run)[-100]).all()
    metrics = measure(run)
    assert not bool(metrics.ok) and np.isinf(np.asarray(metrics.rmse)).all() and not np.asarray(metrics.settled).any()


def mapped(place, dtype, turns=0):
    """A straight path that begins at a place of a map, followed with the tangent as heading."""
    path = agvjax.Waypoints.through(np.array([[0.0, 0.0], [4.0, 1.0], [8.0, 2.0]]) + place, 1.0)
    start = Start(position=np.array([-0.1, 0.1]) + place, heading=0.2 + 2 * np.pi * turns)
    return simulate(NeuroBackstepping(), Scenario(path=path, start=start), n_steps=1000, save_every=100, dtype=dtype)


@pytest.mark.slow
@pytest.mark.parametrize(("place", "turns"), [([5e5, 5e6], 0), ([0.0, 0.0], 400)])
def test_where_a_map_begins_and_how_often_a_vehicle_has_turned_are_no_divergence(place, turns):
    here, there = mapped([0.0, 0.0], float), mapped(place, float, turns)
    assert bool(there.ok)
    np.testing.assert_allclose(np.asarray(there.position) - place, here.position, atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("place", "fine"), [([7e3, 0.0], True), ([0.0, 9e3], False), ([5e5, 5e6], False)])
def test_a_place_that_single_precision_does_not_resolve_to_a_millimetre_is_no_run(place, fine):
    assert bool(mapped(place, jnp.float32).ok) is fine  # 2^-23 of the distance from the origin


@pytest.mark.parametrize(("turns", "fine"), [pytest.param(-1300, True, marks=pytest.mark.slow), (1400, False)])
def test_a_heading_that_single_precision_does_not_resolve_to_a_thousandth_is_no_run(turns, fine):
    assert bool(mapped([0.0, 0.0], jnp.float32, turns).ok) is fine


@pytest.mark.parametrize(
    ("scenario", "steps", "text"),
    [
        (PAPER, {"n_steps": 100, "save_every": 7}, "multiple of save_every"),
        (PAPER, {"n_steps": 100, "save_every": 0}, "save_every"),
        (PAPER, {"n_steps": 0}, "n_steps"),
        (PAPER, {"n_steps": 10.5}, "multiple of save_every"),
        (PAPER, {"n_steps": 10, "save_every": 2.5}, "save_every"),
        (PAPER, {"n_steps": 100, "control_every": 0}, "control_every"),
        (Scenario(deadzone={"steering": Deadzone(), "heading": Deadzone()}), {"n_steps": 1}, "steering"),
        (Scenario(path=agvjax.Circle(), heading=agvjax.Bearing()), {"n_steps": 1}, "Tangent"),
    ],
)
def test_simulate_refuses_impossible_steps_actuators_of_another_plant_and_a_path_without_bearing(scenario, steps, text):
    with pytest.raises(ValueError, match=text):
        simulate(LAW, scenario, **steps)


def test_measure_refuses_a_batch(run):
    with pytest.raises(ValueError, match="vmap"):
        measure(dataclasses.replace(run, t=run.t[None]))
