"""The stability proof in numbers: its functions and constants by hand, and bounds that adversaries cannot break."""

import dataclasses
import functools
import itertools
import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import minimize
from scipy.signal import lsim

import agvjax
import reference
from agvjax import NeuroBackstepping, Scenario
from agvjax._pytree import number, pytree
from agvjax.controllers.backstepping import BacksteppingState
from agvjax.controllers.neuro_backstepping import WeightNorms
from agvjax.leaves import get, swap
from agvjax.readings import KinematicYawRate, KnownSlopes
from reference import Parameters
from runs import trajectory
from tuning.ensemble import draws as ensemble
from tuning.studies.paper import bounds
from tuning.studies.paper import proof as lyapunov

DRAWN, SQUARE = 24, (0.3, 0.6, 1.0, 1.6, 2.4, 4.0, 8.0)  # scenarios drawn, and rad/s of disturbances that switch
LINEAR = 1  # the place in the batch of one whose actuators are linear


@pytree
class Push(agvjax.Disturbance):
    """The paper's disturbance, or one of the same amplitude that is always at its limit."""

    amplitude: float = number(0.2, "m/s^2, m/s^2, rad/s")
    omega: float = number(0.5, "rad/s")
    switching: float = number(0.0)

    def __call__(self, t):
        """Disturbance, shape (3,)."""
        cosine = jnp.cos(self.omega * t)
        return jnp.broadcast_to(self.amplitude * jnp.where(self.switching > 0, jnp.sign(cosine), cosine), (3,))


@pytest.fixture(scope="session")
def batch():
    """Scenarios: the paper's, a linear one, drawn ones, and the paper's with disturbances that switch."""
    nominal = Scenario(disturbance=Push())
    columns = {}
    for name, values in ensemble.sample(nominal, ensemble.default_draws(), DRAWN, seed=3).values.items():
        first = np.asarray(get(nominal, name), float)[None]
        columns[name] = np.concatenate([first, first, values, *[first] * len(SQUARE)])
    for name, value in {"slope_right": 0.7, "slope_left": 0.7, "threshold_right": 0.0, "threshold_left": 0.0}.items():
        columns[f"deadzone.heading.{name}"][LINEAR] = value
    columns["disturbance.amplitude"][LINEAR] = 0.0
    columns["start.heading"][LINEAR] = np.arctan2(1.0, 2.0)
    columns["disturbance.omega"] = np.array([0.5] * (2 + DRAWN) + list(SQUARE))
    columns["disturbance.switching"] = np.array([0.0] * (2 + DRAWN) + [1.0] * len(SQUARE))
    return agvjax.batch(nominal, columns)


@pytest.fixture(scope="session")
def roll(batch):
    """Runs of a controller in all scenarios."""
    one = functools.partial(agvjax.simulate, save_every=10)
    many = jax.jit(jax.vmap(one, in_axes=(None, batch.axes)))
    return lambda controller: many(controller, batch.scenario)


@pytest.fixture(scope="session")
def runs(roll):
    return roll(NeuroBackstepping())


def reported(controller, batch, trajectories):
    """Reports of all runs of a batch."""
    trajectories = jax.tree.map(np.asarray, trajectories)
    rows = [jax.tree.map(lambda x, i=i: x[i], trajectories) for i in range(batch.size)]
    scenarios = [swap(batch.scenario, {name: x[i] for name, x in batch.values.items()}) for i in range(batch.size)]
    return [bounds.report(controller, *each) for each in zip(scenarios, rows, strict=True)]


@pytest.fixture(scope="session")
def reports(batch, runs):
    return reported(NeuroBackstepping(), batch, runs)


@pytest.fixture(scope="session")
def lap():
    """The reference's lap, every 2 ms."""
    return reference.rk4(Parameters(), 2e-3, 6000)


@pytest.fixture(scope="session")
def run(lap):
    """The reference's lap as a trajectory: what the package is given is not its own."""
    (t, s), p = lap, Parameters()
    u = reference.commands(t, s, p)
    network = WeightNorms(varphi=s[:, reference.VARPHI], varphi_psi=s[:, reference.VARPHI_PSI])
    states = {name: s[:, getattr(reference, name.upper())] for name in ("phi1", "phi2", "xi1", "xi2", "beta1", "beta2")}
    vehicle = {name: s[:, getattr(reference, name.upper())] for name in ("position", "velocity", "heading")}
    asked = {"reference_position": reference.path(t)[0], "reference_heading": reference.heading(t)[0]}
    signals = {"command": u, "inputs": u, "delivered": reference.delivered(u, p)}
    law = BacksteppingState(**states, network=network)
    return jax.tree.map(jnp.asarray, trajectory(t, **vehicle, **asked, **signals, controller=law))


@pytest.fixture(scope="session")
def by_hand(lap):
    """What eqs. (21)-(60) speak of, from the reference's states in plain NumPy."""
    (t, s), p = lap, Parameters()
    xd, vd, _ = reference.path(t)
    rate, u = reference.right_hand_side(t, s, p), reference.commands(t, s, p)
    v, delta = s[:, reference.VELOCITY], 0.2 * np.cos(0.5 * t)
    xi1, xi2, beta1 = s[:, reference.XI1], s[:, reference.XI2], s[:, reference.BETA1]
    slope = np.where(u > 0, [0.6, 0.6, 0.91], [0.8, 0.8, 0.72])
    low, high = [-0.4, -0.4, -0.53], [0.5, 0.5, 0.66]
    d = -slope * np.clip(u, low, high)  # (14) in one line: what the band swallows, at most its edge
    omega = slope[:, 2] * u[:, 2] + d[:, 2]
    F = omega[:, None] * np.column_stack([-v[:, 1], v[:, 0]])
    Z1 = s[:, reference.POSITION] - xd
    alpha1 = -20.0 * Z1 + vd - 16.0 * beta1
    nodes = np.array(p.centers)
    offsets = (v[:, None, :] - nodes[:, None]) ** 2
    psi = s[:, reference.HEADING]
    return types.SimpleNamespace(
        t=t,
        Zb1=Z1 - xi1,
        Zb2=v - s[:, reference.PHI1] - xi2,
        Z3=reference.wrap(psi - reference.heading(t)[0]),
        f2=Z1 - xi1 + delta[:, None] - rate[:, reference.XI2] + F + d[:, :2],
        F=F,
        d=d,
        delta=delta,
        phi1_rate=rate[:, reference.PHI1],
        F_psi=(d[:, 2] + delta)[:, None],
        S=np.exp(-offsets.sum(axis=-1) / 0.5),
        S_psi=np.exp(-((psi[:, None] - nodes) ** 2) / 0.5),
        filter_error=s[:, reference.PHI1] - alpha1,
        slope=slope,
        xi1=xi1,
        xi2=xi2,
        beta1=beta1,
        beta2=s[:, reference.BETA2],
        varphi=s[:, reference.VARPHI],
        varphi_psi=s[:, reference.VARPHI_PSI],
        rate=rate[:, [2, 3, 4]],
    )


def fitted(S, f, ridge):
    """Squared norm of the best weights and the largest residual, the ridge being rows of its own."""
    rows = np.vstack([S, np.sqrt(ridge * len(S)) * np.eye(S.shape[1])])
    W = np.linalg.lstsq(rows, np.vstack([f, np.zeros((S.shape[1], f.shape[1]))]), rcond=None)[0]
    return np.sum(W**2), np.linalg.norm(f - S @ W, axis=1).max()


def test_signals_and_constants_are_those_written_by_hand(run, by_hand):
    h = by_hand
    s = lyapunov.signals(NeuroBackstepping(), Scenario(), run)
    for name in ("Zb1", "Zb2", "Z3", "f2", "S", "S_psi", "filter_error", "slope", "rate"):
        np.testing.assert_allclose(getattr(s, name), getattr(h, name), rtol=0, atol=1e-9, err_msg=name)
    np.testing.assert_allclose(s.F_psi, h.F_psi[:, 0], rtol=0, atol=1e-12)
    gain = np.column_stack([h.varphi * (h.S**2).sum(axis=1), h.varphi_psi * (h.S_psi**2).sum(axis=1)]) / 2
    np.testing.assert_allclose(s.gain, gain, rtol=1e-9)
    for since in (0.0, 4.0):
        c = lyapunov.constants(NeuroBackstepping(), Scenario(), run, since)
        late = h.t >= since
        phi, eps = fitted(h.S[late], h.f2[late], lyapunov.RIDGE)
        phi_psi, eps_psi = fitted(h.S_psi[late], h.F_psi[late], lyapunov.RIDGE)
        N1, eta, beta1 = (np.linalg.norm(x[late], axis=1).max() for x in (h.xi1, h.filter_error, h.beta1))
        beta2 = np.abs(h.beta2[late]).max()
        a2, a6 = N1**2 / 2 + 0.5 + eps**2 / 2, eps_psi**2 / 2 + 0.5 + eps_psi**2 / 2
        found = [c.a1, c.a2, c.a3, c.a4, c.a5, c.a6, c.N1, c.eta, c.phi, c.eps, c.phi_psi, c.eps_psi]
        expected = [0.001, a2, 38.0, eta**2 / 2, 0.001, a6, N1, eta, phi, eps, phi_psi, eps_psi]
        np.testing.assert_allclose(found, expected, rtol=1e-6)
        dropped = 0.8 * 0.001 / 0.2 * phi**2 + 16.0**2 * beta1**2 / 2 + 0.001 * 16.0 * beta1**2 / 2
        dropped_psi = 0.91 * 0.001 / 0.2 * phi_psi**2 + 0.001 * 9.0 * beta2**2 / 2
        np.testing.assert_allclose(c.a2_repaired, a2 + dropped, rtol=1e-6)
        np.testing.assert_allclose(c.a6_repaired, a6 - eps_psi**2 / 2 + dropped_psi, rtol=1e-6)
        np.testing.assert_allclose(c.position, np.sqrt(2000.0 * a2) + N1, rtol=1e-6)
        np.testing.assert_allclose(c.compensator, eta / np.sqrt(38.0), rtol=1e-6)
        np.testing.assert_allclose(c.heading, np.sqrt(2000.0 * a6), rtol=1e-6)


def test_functions_are_those_written_by_hand(run, by_hand):
    h, controller, scenario = by_hand, NeuroBackstepping(), Scenario()
    c = lyapunov.constants(controller, scenario, run)
    found = lyapunov.functions(controller, scenario, run, c)
    square = lambda x: (x**2).sum(axis=1)  # noqa: E731
    L1 = square(h.Zb1) / 2 + 16.0 * square(h.beta1) / 2
    Pi, Pi_psi = (h.slope[:, 0] + h.slope[:, 1]) / 2, h.slope[:, 2]
    phi, phi_psi = float(c.phi), float(c.phi_psi)
    L2 = L1 + square(h.Zb2) / 2 + Pi / 0.2 * (phi - h.varphi) ** 2
    L4 = h.Z3**2 / 2 + 9.0 * h.beta2**2 / 2 + Pi_psi / 0.2 * (phi_psi - h.varphi_psi) ** 2
    L3 = square(h.xi1) / 2 + square(h.xi2) / 2
    for name, expected in {"L1": L1, "L2": L2, "L3": L3, "L4": L4}.items():
        np.testing.assert_allclose(getattr(found, name), expected, rtol=1e-9, atol=1e-15, err_msg=name)

    # (33), integrated from each sample to the next
    rate = (h.Zb1 * (h.Zb2 - 20.0 * h.Zb1) + 16.0 * h.beta1 * h.xi1).sum(axis=1)
    change = np.diff(found.L1) / np.diff(h.t)
    np.testing.assert_allclose(change, (rate[1:] + rate[:-1]) / 2, rtol=0, atol=1e-3 * np.abs(rate).max())
    assert np.abs(rate).max() > 1


def test_the_cascade_is_the_one_written_by_hand(run, by_hand):
    """D2 of part 2 term by term; the gain by the poles -10 +- sqrt(84) of s^2 + 20 s + 16."""
    h, found = by_hand, bounds.report(NeuroBackstepping(), Scenario(), run)
    recent = h.t >= 4.0 - bounds.MEMORY
    D2 = h.F + h.d[:, :2] + h.delta[:, None] + (h.slope[:, :2] - 1) * h.phi1_rate
    slow, fast = 10 - np.sqrt(84.0), 10 + np.sqrt(84.0)
    peak = np.log(fast / slow) / (fast - slow)
    gain = 2 * (np.exp(-slow * peak) - np.exp(-fast * peak)) / (fast - slow)
    largest = lambda x: np.abs(x[recent]).max(axis=0)  # noqa: E731
    expected = gain * (largest(D2) / (0.6 * 20.0) + largest(h.filter_error))
    assert found.position["cascade"] == pytest.approx(np.hypot(*expected), rel=1e-6)


def test_the_exponential_bounds_hold_from_the_start_but_not_across_the_jumps_of_L2(run, by_hand):
    """(53) follows as printed; (49) and (71) hold from t = 0; from 4 s on, L2 jumps over (49) with Pi."""
    controller, scenario = NeuroBackstepping(), Scenario()
    worst = {}
    for since in (0.0, 4.0):
        c = lyapunov.constants(controller, scenario, run, since)
        found = lyapunov.functions(controller, scenario, run, c)
        late = by_hand.t >= since
        for name, a, b in (("L2", c.a1, c.a2), ("L3", c.a3, c.a4), ("L4", c.a5, c.a6)):
            L = np.asarray(getattr(found, name))[late]
            worst[name, since] = np.max(L / (lyapunov.exponential_bound(by_hand.t[late] - since, L[0], a, b) + 1e-15))
    assert worst.pop(("L2", 4.0)) > 1.2
    assert max(worst.values()) < 1 + 1e-9


def test_exponential_bound_solves_what_it_bounds():
    t = np.linspace(0.0, 3.0, 7)
    solved = solve_ivp(lambda _, L: -0.7 * L + 0.3, (0.0, 3.0), [2.0], t_eval=t, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(lyapunov.exponential_bound(t, 2.0, 0.7, 0.3), solved.y[0], rtol=1e-8)


def test_margins_of_the_paper():
    found = lyapunov.margins(NeuroBackstepping(), Scenario())
    expected = {"k1 - 1": 19.0, "k2 - 1/2": 19.5, "Pi_min k2 - 1/2": 11.5, "Pi_psi_min k3 - 1/2": 8.14}
    expected |= {"gamma1": 0.1, "gamma2": 0.1, "eta1": 0.001, "eta2": 0.001, "b1": 1.0, "b2": 1.0}
    assert found == pytest.approx(expected, rel=1e-12)


def test_a_lost_margin_leaves_no_printed_bound(run):
    weak = NeuroBackstepping(k2=0.8, k3=0.6)  # 0.6 k2 < 1/2, 0.72 k3 < 1/2
    c = lyapunov.constants(weak, Scenario(), run)
    assert np.isinf(c.position) and np.isinf(c.heading) and np.all(np.isinf(c.repaired))
    assert min(lyapunov.margins(weak, Scenario()).values()) < 0


INPUT, OUTPUT = np.array([[1.0], [0.0]]), np.array([[1.0, 0.0]])  # into, and out of, the first of two states


def response(k, Lam, horizon, n):
    """Samples of the impulse response of s / (s^2 + k s + Lam), exact steps of its companion form."""
    A = np.array([[-k, -Lam], [1.0, 0.0]])
    E = expm(A * horizon / (n - 1))
    states = list(itertools.accumulate(range(n - 1), lambda x, _: E @ x, initial=np.array([1.0, 0.0])))
    return np.linspace(0.0, horizon, n), np.array(states)[:, 0], A


@settings(max_examples=25, deadline=None)
@given(st.floats(0.1, 30.0), st.one_of(st.floats(-0.9, 60.0), st.floats(-1e-6, 1e-6)))
@example(1.0, 0.0)
@example(10.0, 16.0 / 100.0 - 1.0)  # the paper's k1 and Lambda
def test_peak_gain_is_the_integral_of_the_impulse_response(sigma, ratio):
    k, Lam = 2 * sigma, sigma**2 * (1 + ratio)
    slowest = sigma * (1 - np.sqrt(max(0.0, -ratio)))
    t, h, A = response(k, Lam, 20 / slowest, 10_001)
    integral = np.trapezoid(np.abs(h), t)
    found = bounds.peak_gain(k, Lam)
    assert found == pytest.approx(integral, rel=2e-3)
    (numeric,), (dc,) = bounds.peak_gains(A, INPUT, OUTPUT)
    assert found * (1 - 1e-9) <= numeric <= found * (1 + 2e-3)
    assert abs(dc) < 1e-9 * found


def test_peak_gain_without_an_integral_is_that_of_a_lag():
    assert bounds.peak_gain(20.0, 0.0) == pytest.approx(1 / 20.0)
    assert bounds.peak_gain(20.0, 1e-12) == pytest.approx(2 / 20.0)  # the slow way back counts, however slow
    (gain,), (dc,) = bounds.peak_gains(np.array([[-20.0, 0.0], [1.0, 0.0]]), INPUT, OUTPUT)
    assert gain == pytest.approx(1 / 20.0) and dc == pytest.approx(1 / 20.0)


@pytest.mark.parametrize("zeta", [0.2, 0.75])
def test_peak_gains_of_the_whole_position_loop(zeta):
    """Z1 and u for a force w, with the filter in the loop, written out by hand; against SciPy's impulse response."""
    k1, k2, Lam, wn, m = 20.0, 20.0, 16.0, 90.0, 0.7
    rows = [[0, 0, 0, 0, 1], [1, 0, 0, 0, 0], [0, 0, 0, wn, 0]]
    rows += [[-wn * k1, -wn * Lam, -wn, -2 * zeta * wn, 0], [0, 0, m * k2, m * wn, -m * k2]]
    A, b = np.array(rows, float), np.array([[0.0], [0], [0], [0], [1]])
    C = np.array([[1.0, 0, 0, 0, 0], [0, 0, k2, wn, -k2]])
    t = np.linspace(0.0, 25.0, 250_001)
    _, y, _ = lsim((A, b, C, np.zeros((2, 1))), np.zeros(t.size), t, X0=b[:, 0])
    gains, dc = bounds.peak_gains(A[None], b[None], C[None])
    np.testing.assert_allclose(gains[0], np.trapezoid(np.abs(y), t, axis=0), rtol=1e-3)
    np.testing.assert_allclose(dc[0], -(C @ np.linalg.solve(A, b))[:, 0], rtol=1e-9, atol=1e-12)
    controller = jax.tree.map(lambda x: np.asarray(x, float), NeuroBackstepping(zeta=zeta))
    made = bounds._position(controller, np.array([m]), 0.0)
    np.testing.assert_allclose(made.A[0, 0], A, atol=1e-12)
    np.testing.assert_allclose(made.C[0, 0, :2], C, atol=1e-12)
    assert np.all(np.isinf(bounds.peak_gains(-A, b, C)[0]))


@pytest.mark.parametrize(("k", "Lam"), [(20.0, 16.0), (4.0, 100.0)])
def test_an_adversary_reaches_the_peak_gain_and_no_more(k, Lam):
    t, h, A = response(k, Lam, 12.0, 12_001)
    _, y, _ = lsim((A, INPUT, OUTPUT, 0.0), np.sign(h[::-1]), t)
    assert 0.99 < np.abs(y).max() / bounds.peak_gain(k, Lam) < 1 + 1e-6


@pytest.mark.slow
def test_corrected_bounds_hold_where_the_printed_are_vacuous(reports):
    kinds = ("observed", "printed", "corrected")
    observed, printed, corrected = (np.array([getattr(r, kind) for r in reports]) for kind in kinds)
    judged = np.delete(np.arange(len(reports)), LINEAR)
    tight, loose = bounds.vacuity(corrected, observed), bounds.vacuity(printed, observed)
    assert np.all(tight >= 1 - 1e-3)
    assert np.all(tight[judged] < 3.5)
    assert np.all(loose[judged] > 20 * bounds.VACUOUS)
    for r in reports:
        assert set(r.position) == {"a priori", "linear", "cascade"} and set(r.heading) == {"a priori", "linear"}
        assert min(r.position.values()) >= r.observed[0] and min(r.heading.values()) >= r.observed[1] * (1 - 1e-3)
        assert r.position["a priori"] < 0.2 and r.heading["a priori"] < 0.5  # finite: the small gain holds in all
        assert r.corrected[0] <= min(r.position.values()) * (1 + 1e-12)
        assert r.corrected[1] == r.heading[r.won[1]] == min(r.heading.values())


@pytest.mark.slow
def test_the_printed_bound_is_vacuous_in_every_scenario(batch, runs):
    """(50): b1^2/2 alone over a1 = 0.001 makes it 31.6 m, whatever the network fits."""
    for since in (0.0, bounds.LATE):
        of_all = jax.vmap(lyapunov.constants, in_axes=(None, batch.axes, 0, None))
        constants = of_all(NeuroBackstepping(), batch.scenario, runs, since)
        assert np.all(np.asarray([constants.position, constants.heading]) >= np.sqrt(1 / 0.001))


@pytest.mark.slow
def test_the_papers_own_scenario(reports):
    r = reports[0]
    assert r.observed[0] == pytest.approx(0.0040, rel=0.02)
    assert r.printed[0] >= 31.6 and r.printed[0] == pytest.approx(np.sqrt(2 * r.constants.a2 / 0.001), rel=1e-3)
    assert np.all(r.corrected < 3 * r.observed)
    assert r.position["a priori"] < 6 * r.observed[0] and r.heading["a priori"] < 1.6 * r.observed[1]
    reached = [other.observed[1] / other.heading["a priori"] for other in reports[2 + DRAWN :]]
    assert max(reached) > 0.7  # a disturbance that switches uses most of what the heading's bound allows


@pytest.mark.slow
def test_bounds_hold_where_the_network_matters(batch, roll):
    """At b1 = b2 = 0.1 the network is stronger than the gains beside it."""
    strong = NeuroBackstepping(b1=0.1, b2=0.1)
    found = reported(strong, batch, roll(strong))
    for r in found:
        assert min(r.position.values()) >= r.observed[0] and min(r.heading.values()) >= r.observed[1]
        assert r.corrected[0] < 4 * r.observed[0] and r.corrected[1] < 3 * r.observed[1]
    assert any(np.isfinite(r.heading["a priori"]) for r in found)


def test_the_interval_of_the_force_is_the_smallest():
    """Part 3's w = dz(u) - m v + delta + F, from signals anywhere in their intervals, corners and kinks too."""
    random, many = np.random.default_rng(0), (1_000_000, 2)
    low, high = np.array([[-0.1, -0.9, -0.3, -0.7], [-0.2, -2.0, -0.2, 0.1]]), np.array([[0.1, 1.4, 0.4, 0.5]] * 2)
    m, nu, delta, yaw_rate = 0.65, 0.5, (-0.2, 0.1), (-1.3, 0.9)
    empty = np.zeros((1, 2, 4))
    known = bounds._Known(np.array([[m]]), np.full((1, 2), nu), empty, empty, empty, empty)
    ends = jnp.asarray(low[None]), jnp.asarray(high[None])
    found = bounds._force(Scenario().deadzone["position"], yaw_rate, np.array(delta)[:, None, None], known, ends)

    def pick(a, b):
        return a + np.clip(random.uniform(-0.5, 1.5, many), 0, 1) * (b - a)

    v, Z, chi2 = (pick(low[:, i], high[:, i]) for i in (1, 2, 3))
    turned = pick(*yaw_rate)[:, :1] * np.stack([-chi2[:, 1], chi2[:, 0]], axis=-1)
    w = reference.deadzone(v - pick(-nu, nu) * Z, 0.6, 0.8, 0.5, 0.4) - m * v + pick(*delta) + turned
    np.testing.assert_array_less(np.asarray(found[0][0]) - 1e-12, w.min(axis=0))
    np.testing.assert_array_less(w.max(axis=0), np.asarray(found[1][0]) + 1e-12)
    np.testing.assert_allclose([w.min(axis=0), w.max(axis=0)], [found[0][0], found[1][0]], atol=0.02)


@pytest.mark.slow
def test_with_linear_actuators_the_heading_bounds_are_what_happens(reports):
    r = reports[LINEAR]
    assert r.observed[1] > 0.01  # the slope of 0.7 that the law takes for 1
    assert r.heading["linear"] == pytest.approx(r.observed[1], rel=0.01)
    assert r.heading["a priori"] == pytest.approx(r.observed[1], rel=0.02)


def quadratic(right, left, rate, delta, k3=12.0, Lam=9.0):
    """The smallest |Z3| of an ellipsoid x' Q^-1 x <= 1 that x' = A(Pi) x + (r, 0) leaves never, for both slopes.

    Q A' + A Q + a Q + r^2/a (1, 0)(1, 0)' <= 0 at both vertices; affine in Pi, so between them too.
    """
    (m, s), (n, q) = right, left
    r = max(abs(m - 1) * rate + m * s, abs(n - 1) * rate + n * q) + delta

    def size(x):
        x = np.clip(x, -20.0, 20.0)
        p, c, a = np.exp(x[0]), np.tanh(x[1]) * np.exp(x[0] / 2), np.exp(x[2])
        Q, room = np.array([[1.0, c], [c, p]]), np.inf
        for slope in (m, n):
            A = np.array([[-slope * k3, -slope * Lam], [1.0, 0.0]])
            rest = -(Q @ A.T + A @ Q + a * Q)
            low = np.linalg.eigvalsh(rest)[0]
            if low <= 1e-12:
                return 1e3 - low
            room = min(room, a / np.linalg.inv(rest)[0, 0])
        return r / np.sqrt(room)

    starts = [(-2.0, -0.1, -0.5), (-4.0, -0.3, 0.0), (-1.0, -0.01, -1.0), (-3.0, -0.05, -0.7)]
    options = {"maxiter": 4000, "maxfev": 4000, "xatol": 1e-8, "fatol": 1e-9}
    return min(minimize(size, x, method="Nelder-Mead", options=options).fun for x in starts)


@pytest.mark.slow
def test_a_common_quadratic_function_bounds_the_heading_less_tightly(reports):
    best = quadratic((0.91, 0.66), (0.72, 0.53), np.abs(reference.heading(np.linspace(0, 12, 2001))[1]).max(), 0.2)
    assert reports[0].observed[1] < best < 0.3  # it is a bound, and a good one
    assert reports[0].heading["a priori"] < 0.8 * best


def test_no_bound_where_nothing_can_be_proved(run):
    run = jax.tree.map(lambda x: x[::5] if x.ndim else x, run)
    scenario = Scenario()
    slopes = {"deadzone.heading.slope_right": 2.0, "deadzone.heading.slope_left": 0.02}
    report = bounds.report(NeuroBackstepping(), agvjax.replace(scenario, slopes), run)
    assert np.isinf(report.heading["a priori"]) and np.isfinite(report.corrected[1])  # the small gain fails
    assert np.isinf(report.position["a priori"]) and np.isfinite(report.corrected[0])
    slow = bounds.report(NeuroBackstepping(omega_n=5.0), scenario, run)  # unstable: the filter lags too much
    assert np.isinf(slow.position["a priori"]) and np.isinf(slow.position["linear"])
    kinematic = agvjax.Decoupled(yaw_rate=KinematicYawRate())
    free = bounds.report(NeuroBackstepping(), dataclasses.replace(scenario, plant=kinematic), run)
    assert set(free.position) == {"linear", "cascade"}
    with pytest.raises(ValueError, match="KnownSlopes"):
        bounds.report(NeuroBackstepping(Pi_hat=KnownSlopes()), scenario, run)


@pytree
class Compensated(NeuroBackstepping):
    """A law that does use xi1."""

    def law(self, flow, memory, measurement, reference):
        """The paper's, with xi1 taken off the velocity; the position acts through the filter only."""
        measurement = dataclasses.replace(measurement, velocity=measurement.velocity - flow.xi1)
        return super().law(flow, memory, measurement, reference)


@pytest.mark.slow
def test_the_compensation_changes_no_command(batch, runs):
    ask = jax.vmap(lyapunov.compensation, in_axes=(None, batch.axes, 0))
    slopes, xi2 = ask(NeuroBackstepping(), batch.scenario, runs)
    assert np.all(np.asarray(slopes) == 0) and np.all(np.asarray(xi2) == 0)
    assert np.abs(np.asarray(runs.controller.xi1)).max() > 1e-3  # though it is not idle
    slopes, _ = ask(Compensated(), batch.scenario, runs)
    assert np.all(np.asarray(slopes) > 1)
