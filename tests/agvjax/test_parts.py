"""The parts one at a time: deadzone, network, paths, headings, coupling, angles, disturbances, integrators, checks."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import agvjax
import reference as independent
from agvjax import (
    EULER,
    HEUN,
    RK4,
    Bearing,
    Circle,
    Cosine,
    CosineSum,
    Deadzone,
    Decoupled,
    Dumbbell,
    ForwardSpeed,
    InputError,
    KinematicYawRate,
    Lemniscate,
    Line,
    LiteralFilter,
    NeuroBackstepping,
    NoDisturbance,
    RadialBasis,
    RawBearing,
    Scenario,
    Step,
    SwappedBearing,
    Tangent,
    TurnedVelocity,
    check,
    default_heading,
    faults,
    leaves,
    replace,
    step_faults,
)
from agvjax.geometry import bearing, wrap
from agvjax.metrics import safe_sqrt
from agvjax.paths.heading import reference
from agvjax.plants import DecoupledState

slopes = st.floats(0.01, 10)
thresholds = st.floats(0, 5)
few = settings(max_examples=50, deadline=None)


@few
@given(slopes, slopes, thresholds, thresholds, st.lists(st.floats(-20, 20), min_size=1, max_size=8))
def test_deadzone_is_slope_times_command_plus_residual(right, left, s_right, s_left, commands):
    dz = Deadzone(slope_right=right, slope_left=left, threshold_right=s_right, threshold_left=s_left)
    u = jnp.array([*commands, s_right, -s_left, 0.0])
    scale = max(right, left) * (20 + max(s_right, s_left))
    np.testing.assert_allclose(
        dz(u), independent.deadzone(np.asarray(u), right, left, s_right, s_left), atol=1e-14 * scale
    )
    np.testing.assert_allclose(dz.slope(u) * u + dz.residual(u), dz(u), rtol=0, atol=1e-14 * scale)  # (12) == (11)
    assert (np.abs(dz.residual(u)) <= max(right * s_right, left * s_left) * (1 + 1e-12)).all()  # after (14)


def test_deadzone_by_hand():
    dz = Deadzone(slope_right=0.6, slope_left=0.8, threshold_right=0.5, threshold_left=0.4)
    u = jnp.array([-2.4, -0.4, -0.39, 0.0, 0.49, 0.5, 1.5])
    np.testing.assert_allclose(dz(u), [-1.6, 0, 0, 0, 0, 0, 0.6], atol=1e-15)
    np.testing.assert_allclose(jax.vmap(jax.grad(dz))(jnp.array([-2.0, -0.3, 0.3, 2.0])), [0.8, 0, 0, 0.6])
    np.testing.assert_array_equal(Deadzone()(u), u)


def test_network_by_hand():
    net = RadialBasis()
    np.testing.assert_allclose(net(jnp.array(0.0)), np.exp([-18, -4.5, 0, -4.5, -18]), rtol=1e-14)  # c^2 / .5
    # two coordinates: node i sits at (c_i, c_i), so (1.5, 0) is (4.5, 1.5) from node 1: 22.5 / .5 = 45
    squared = np.array([4.5**2 + 9, 9 + 2.25, 2.25, 2.25, 2.25 + 9])
    np.testing.assert_allclose(net(jnp.array([1.5, 0.0])), np.exp(-squared / 0.5), rtol=1e-14)
    np.testing.assert_allclose(net.energy(jnp.array([1.5, 0.0])), np.exp(-4 * squared).sum(), rtol=1e-14)
    wide = RadialBasis(centers=np.array([1.0]), width=2.0)
    np.testing.assert_allclose(wide(jnp.array([2.0, 0.0, 1.0])), [np.exp(-1.0)], rtol=1e-14)


TIMES = np.array([0.0, 0.7, 2.1, 2.9, 4.0, 5.5, 7.3, 11.0])


def all_of(path, heading, times=TIMES):
    return jax.vmap(lambda t: reference(path, heading, t))(jnp.asarray(times))


def test_dumbbell_and_its_derivatives():
    ref = all_of(Dumbbell(), None)
    for mine, wanted in zip((ref.position, ref.velocity, ref.acceleration), independent.path(TIMES), strict=True):
        np.testing.assert_allclose(mine, wanted, rtol=0, atol=1e-14)
    big = all_of(Dumbbell(amplitude=40.0, omega=0.1), None, [0.0])
    np.testing.assert_allclose(big.velocity[0], [8.0, 4.0], rtol=1e-14)


@pytest.mark.parametrize(
    ("heading", "name"),
    [
        (Bearing(), "bearing"),
        (RawBearing(), "bearing_raw"),
        (SwappedBearing(), "bearing_swapped"),
        (Tangent(), "tangent"),
    ],
)
def test_heading_readings_and_their_rates(heading, name):
    times = TIMES if name in ("bearing", "tangent") else TIMES[1:]  # (56) has no value at t = 0
    ref = all_of(Dumbbell(), heading, times)
    value, rate = independent.heading(times, name)
    np.testing.assert_allclose(ref.heading, value, rtol=0, atol=1e-13)
    np.testing.assert_allclose(ref.heading_rate, rate, rtol=0, atol=1e-12)


def test_bearing_is_the_printed_one_on_the_first_half_lap_and_pi_off_after():
    t = np.linspace(0.01, 5.98, 40)
    x, y = np.sin(22 / 21 * t), np.sin(11 / 21 * t)
    np.testing.assert_allclose(all_of(Dumbbell(), Bearing(), t).heading, np.arctan2(y, x), atol=1e-13)
    later = t + np.pi * 21 / 11
    smooth = np.asarray(all_of(Dumbbell(), Bearing(), later).heading)
    printed = np.arctan2(np.sin(11 / 21 * later), np.sin(22 / 21 * later))
    np.testing.assert_allclose(np.abs(smooth - printed), np.pi, atol=1e-12)


def test_default_heading_is_the_smooth_bearing_only_where_there_is_one():
    assert isinstance(default_heading(Dumbbell()), Bearing)
    for path in (Circle(), Lemniscate(), Line()):
        assert isinstance(default_heading(path), Tangent)
    np.testing.assert_array_equal(all_of(Circle(), None).heading, all_of(Circle(), Tangent()).heading)


def test_circle_by_hand():
    radius, omega = 2.0, 0.5
    ref = all_of(Circle(radius=radius, omega=omega), None)
    phase = omega * TIMES
    radial = np.column_stack([np.cos(phase), np.sin(phase)])
    np.testing.assert_allclose(ref.position, radius * radial, atol=1e-14)
    np.testing.assert_allclose(
        ref.velocity, radius * omega * np.column_stack([-np.sin(phase), np.cos(phase)]), atol=1e-14
    )
    np.testing.assert_allclose(ref.acceleration, -radius * omega**2 * radial, atol=1e-14)
    np.testing.assert_allclose(ref.heading_rate, omega, atol=1e-14)
    np.testing.assert_allclose(np.exp(1j * np.asarray(ref.heading)), np.exp(1j * (phase + np.pi / 2)), atol=1e-14)


def test_lemniscate_by_hand():
    a, w = 3.0, 0.5
    ref = all_of(Lemniscate(amplitude=a, omega=w), None, [0.0, np.pi / (2 * w), 1.3])
    # at the tip: (a, 0), moving up at a w, and x = a (1 - 3/2 (w t)^2 + ..), so x'' = -3 a w^2
    np.testing.assert_allclose(
        [ref.position[0], ref.velocity[0], ref.acceleration[0]], [[a, 0], [0, a * w], [-3 * a * w**2, 0]], atol=1e-14
    )
    # at the crossing w t = pi/2 + e: x = -a e / 2, y = -a e / 2 to first order; no acceleration by symmetry
    half = -a * w / 2
    np.testing.assert_allclose(
        [ref.position[1], ref.velocity[1], ref.acceleration[1]], [[0, 0], [half, half], [0, 0]], atol=1e-14
    )
    np.testing.assert_allclose(ref.heading[1], -0.75 * np.pi, rtol=1e-14)
    x, y = np.asarray(ref.position[2])
    np.testing.assert_allclose((x**2 + y**2) ** 2, a**2 * (x**2 - y**2), rtol=1e-13)  # Bernoulli's curve


def test_line_by_hand():
    ref = all_of(Line(origin=np.array([1.0, -2.0]), velocity=np.array([0.3, 0.4])), None, [0.0, 2.0])
    np.testing.assert_allclose(ref.position, [[1, -2], [1.6, -1.2]], rtol=1e-14)
    np.testing.assert_allclose(ref.velocity, [[0.3, 0.4]] * 2)
    np.testing.assert_array_equal(ref.acceleration, np.zeros((2, 2)))
    np.testing.assert_allclose(ref.heading, np.arctan2(0.4, 0.3))
    np.testing.assert_array_equal(ref.heading_rate, [0, 0])


def unicycle(t):
    """Position and heading of a vehicle that rolls: v = 1 + .3 t, psi = .4 + .5 t^2, (1) by Gauss quadrature."""
    psi = 0.4 + 0.5 * t**2
    s, weight = np.polynomial.legendre.leggauss(40)
    s, weight = t * (s + 1) / 2, weight * t / 2
    speed, angle = 1 + 0.3 * s, 0.4 + 0.5 * s**2
    return np.array([weight @ (speed * np.cos(angle)), weight @ (speed * np.sin(angle))]), psi


def test_coupling_is_what_two_derivatives_of_the_reference_point_leave():
    # chi1'' = F + v' (cos, sin) + L w' (-sin, cos) for the point L ahead of a vehicle that rolls without slip, (2)-(4)
    L, t, h = 0.5, 0.9, 1e-3

    def point(time):
        position, psi = unicycle(time)
        return position + L * np.array([np.cos(psi), np.sin(psi)])

    stencil = [point(t + k * h) for k in (-2, -1, 0, 1, 2)]
    second = np.array([-1, 16, -30, 16, -1]) @ stencil / (12 * h**2)
    velocity = np.array([1, -8, 0, 8, -1]) @ stencil / (12 * h)
    psi, w, w_rate, v_rate = 0.4 + 0.5 * t**2, t, 1.0, 0.3
    ahead, aside = np.array([np.cos(psi), np.sin(psi)]), np.array([-np.sin(psi), np.cos(psi)])
    wanted = second - v_rate * ahead - L * w_rate * aside
    state = DecoupledState(position=jnp.zeros(2), velocity=jnp.array(velocity), heading=jnp.array(psi))
    for coupling in (ForwardSpeed(), TurnedVelocity()):  # the lateral velocity of the point is L w here: both hold
        np.testing.assert_allclose(coupling(state, jnp.array(w), L), wanted, rtol=0, atol=1e-8)
    np.testing.assert_allclose(KinematicYawRate()(state, {}, L), w, rtol=1e-9)


def test_couplings_part_by_what_the_lateral_velocity_lacks():
    # velocity (a along, b aside): turned - printed = w (L w - b) ahead, for any motion
    L, psi, w, along, aside = 0.5, 0.7, 1.3, 0.9, -0.2
    ahead, left = np.array([np.cos(psi), np.sin(psi)]), np.array([-np.sin(psi), np.cos(psi)])
    state = DecoupledState(
        position=jnp.zeros(2), velocity=jnp.array(along * ahead + aside * left), heading=jnp.array(psi)
    )
    gap = TurnedVelocity()(state, jnp.array(w), L) - ForwardSpeed()(state, jnp.array(w), L)
    np.testing.assert_allclose(gap, w * (L * w - aside) * ahead, atol=1e-14)


def test_decoupled_plant_by_hand():
    state = DecoupledState(position=jnp.zeros(2), velocity=jnp.array([2.0, 3.0]), heading=jnp.array(0.5))
    delivered = {"position": jnp.array([10.0, 20.0]), "heading": jnp.array(0.1)}
    rate = Decoupled().derivative(state, (), delivered, jnp.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(rate.position, [2, 3])
    np.testing.assert_allclose(rate.velocity, [-0.3 + 10 + 1, 0.2 + 20 + 2], rtol=1e-14)
    np.testing.assert_allclose(rate.heading, 3.1)
    assert Decoupled().feedthrough and not Decoupled(yaw_rate=KinematicYawRate()).feedthrough


@few
@given(st.floats(-1000, 1000))
def test_wrap_is_the_same_angle_in_half_a_turn_either_side(angle):
    wrapped = float(wrap(jnp.array(angle)))
    assert abs(wrapped) <= np.pi * (1 + 1e-15) + 1e-13  # 1e-13: the rounding of 1000 rad
    turns = (angle - wrapped) / (2 * np.pi)
    assert abs(turns - round(turns)) < 1e-12
    assert float(jax.grad(wrap)(jnp.array(angle))) == 1.0


def test_bearing_has_value_and_derivative_zero_where_it_is_undefined():
    zero = jnp.array(0.0)
    for function in (bearing, jax.grad(bearing, 0), jax.grad(bearing, 1)):
        assert float(function(zero, zero)) == 0.0
    # jvp of the whole reference at t = 0, where the dumbbell is at the origin
    for heading in (RawBearing(), SwappedBearing(), Tangent(), Bearing()):
        assert all(np.isfinite(np.asarray(x)).all() for x in jax.tree.leaves(reference(Dumbbell(), heading, zero)))
    standing = reference(Line(velocity=np.zeros(2)), None, zero)
    assert float(standing.heading) == 0.0 and float(standing.heading_rate) == 0.0
    y, x = jnp.array([0.3, -2.0, 1.0, 0.0]), jnp.array([-1.0, -0.1, 0.0, -2.0])
    np.testing.assert_allclose(jax.vmap(bearing)(y, x), np.arctan2(y, x), rtol=1e-15)
    np.testing.assert_allclose(jax.grad(bearing, (0, 1))(jnp.array(3.0), jnp.array(4.0)), (4 / 25, -3 / 25), rtol=1e-14)


def test_safe_sqrt_has_no_infinite_derivative():
    np.testing.assert_allclose(jax.vmap(jax.value_and_grad(safe_sqrt))(jnp.array([0.0, 4.0])), ([0, 2], [0, 0.25]))


def test_disturbances_by_hand():
    t = jnp.array(3.0)
    np.testing.assert_allclose(Cosine()(t), [0.2 * np.cos(1.5)] * 3, rtol=1e-14)
    each = Cosine(amplitude=np.array([1.0, 2.0, 3.0]), omega=np.array([0.0, 1.0, 2.0]), phase=np.array([0.0, 0.5, 1.0]))
    np.testing.assert_allclose(each(t), [1, 2 * np.cos(3.5), 3 * np.cos(7.0)], rtol=1e-14)
    step = Step(amplitude=np.array([1.0, 0.0, -2.0]), time=3.0)
    np.testing.assert_array_equal(step(t), [1, 0, -2])
    np.testing.assert_array_equal(step(jnp.array(2.999)), [0, 0, 0])
    sum_of_two = CosineSum(amplitudes=np.array([0.3, -0.1]), omegas=np.array([1.0, 5.0]), phases=np.array([0.2, 0.0]))
    np.testing.assert_allclose(sum_of_two(t), [0.3 * np.cos(3.2) - 0.1 * np.cos(15.0)] * 3, rtol=1e-14)
    np.testing.assert_array_equal(NoDisturbance()(t), [0, 0, 0])
    for disturbance in (Cosine(), each, step, sum_of_two, NoDisturbance()):
        assert disturbance(t).shape == (3,)


@pytest.mark.parametrize(
    ("method", "taylor"), [(EULER, [1, 1]), (HEUN, [1, 1, 1 / 2]), (RK4, [1, 1, 1 / 2, 1 / 6, 1 / 24])]
)
def test_one_step_multiplies_a_mode_by_the_taylor_polynomial(method, taylor):
    for z in (-0.7 + 0.4j, -2.0, 1.1j, -2.5 + 0.1j):
        R = sum(c * z**k for k, c in enumerate(taylor))
        assert method.amplification(z) == pytest.approx(abs(R), rel=1e-13)
        # x' = lambda x as a real system, the method as it is used
        matrix = jnp.array([[z.real, -z.imag], [z.imag, z.real]]) / 0.5
        end, seen = method.advance(
            lambda x, signal, A=matrix: (A @ x, signal), jnp.array([1.0, 0.0]), 0.5, method.nodes
        )
        np.testing.assert_allclose(end, [R.real, R.imag], atol=1e-13)
        assert seen == 0.0


def test_methods_look_at_the_instants_of_their_nodes():
    # quadrature of t^3 on [0, 2]: RK4 is Simpson's rule, exact; Heun the trapezoid; Euler the left end
    for method, wanted in ((EULER, 0.0), (HEUN, 8.0), (RK4, 4.0)):
        times = [2.0 * node for node in method.nodes]
        end, _ = method.advance(lambda x, t: (t**3, ()), 0.0, 2.0, times)
        assert end == pytest.approx(wanted, abs=1e-14)


def test_stable_step_is_the_edge_of_the_stability_region():
    assert RK4.stable_step(np.array([-1.0])) == pytest.approx(2.785, rel=2e-3)
    assert RK4.stable_step(np.array([-100.0, -1.0])) == pytest.approx(0.02785, rel=2e-3)
    assert RK4.stable_step(np.array([1j, -1j])) == pytest.approx(2.828, rel=2e-3)
    assert EULER.stable_step(np.array([-4.0])) == pytest.approx(0.5, rel=2e-3)
    assert HEUN.stable_step(np.array([-4.0])) == pytest.approx(0.5, rel=2e-3)
    # Euler on a damped pair: |1 + h s| = 1 at h = 2 zeta / omega_n
    poles = NeuroBackstepping().poles()
    np.testing.assert_allclose(sorted(poles.imag), [-90 * np.sqrt(1 - 0.75**2), 90 * np.sqrt(1 - 0.75**2)], rtol=1e-12)
    assert EULER.stable_step(poles) == pytest.approx(2 * 0.75 / 90, rel=2e-3)


def test_literal_filter_has_the_poles_of_the_printed_equation():
    poles = NeuroBackstepping(filter=LiteralFilter()).poles()
    natural = 90**1.5  # reading R5: 854 rad/s, damping .079
    np.testing.assert_allclose(np.abs(poles), natural, rtol=1e-12)
    np.testing.assert_allclose(-poles.real / natural, 0.75 / np.sqrt(90), rtol=1e-12)


def test_problems_name_every_bad_leaf():
    controller = NeuroBackstepping(k1=-1.0, Lam=float("nan"), b1="1", Pi_hat=np.array([0.5, -0.5]))
    assert {p.key for p in faults(controller)} == {"k1", "Lam", "b1", "Pi_hat"}
    scenario = replace(
        Scenario(), {"deadzone.heading.slope_left": 0.0, "start.position": np.zeros(3), "start.heading": True}
    )
    assert {p.key for p in faults(scenario)} == {"deadzone.heading.slope_left", "start.position", "start.heading"}
    with pytest.raises(InputError, match=r"4 bad values:(.|\n)*k1 = -1.0: must be finite and > 0 \[after eq. \(32\)\]"):
        check(controller)
    assert issubclass(InputError, ValueError)
    assert faults(NeuroBackstepping()) == [] and faults(Scenario()) == []
    assert check(NeuroBackstepping(k1=25)).k1.dtype == jnp.float64
    assert check(NeuroBackstepping(k1=25), jnp.float32).k1.dtype == jnp.float32


def test_step_problems_know_what_the_integrator_carries():
    law, literal = NeuroBackstepping(), NeuroBackstepping(filter=LiteralFilter())
    assert step_faults(law, 1e-3, 12.0, RK4) == [] and step_faults(literal, 1e-3, 12.0, RK4) == []
    assert [p.key for p in step_faults(law, 0.05, 12.0, RK4)] == ["dt"]
    # Euler carries the literal filter only up to 2 zeta / omega_n^2: 1.9e-4 s
    assert [p.key for p in step_faults(literal, 1e-3, 12.0, EULER)] == ["dt"]
    assert step_faults(literal, 1.8e-4, 12.0, EULER) == []
    assert [p.key for p in step_faults(law, 1e-3, 5e-4, RK4)] == ["horizon"]
    assert [p.key for p in step_faults(law, float("nan"), 1.0, RK4)] == ["dt"]


def test_dotted_names_reach_every_leaf():
    names = leaves(Scenario())
    assert names["deadzone.position.threshold_right"] == 0.5 and names["plant.L"] == 0.5 and "sensor" not in names
    new = replace(Scenario(), {"deadzone.position.threshold_right": 0.7, "limit": 5.0})
    changed = {name for name, value in leaves(new).items() if np.any(value != names[name])}
    assert changed == {"deadzone.position.threshold_right", "limit"}
    assert leaves(Scenario())["limit"] == 1e3
    with pytest.raises(KeyError, match="did you mean Lam_psi or Lam"):
        replace(NeuroBackstepping(), {"Lam_ps": 1.0})


def test_stability_bounds_are_those_of_the_paper():
    assert NeuroBackstepping().stability_bounds(0.6, 0.72) == {"k1": 1.0, "k2": 0.5 / 0.6, "k3": 0.5 / 0.72}
    assert agvjax.NeuroBackstepping().stability_bounds(2.0, 0.5)["k2"] == 0.5


def test_error_of_a_mode_is_the_first_term_a_method_leaves_out():
    z = 0.01
    for method, wanted in ((agvjax.EULER, z / 2), (agvjax.HEUN, z**2 / 6), (agvjax.RK4, z**4 / 120)):
        assert method.error(z) == pytest.approx(wanted, rel=0.01)


def test_a_coarse_step_names_the_gains_it_is_too_coarse_for():
    law = agvjax.NeuroBackstepping()
    assert agvjax.step_warnings(law, 5e-3, agvjax.RK4) == []  # the step of `tune`
    (said,) = agvjax.step_warnings(law, 2e-2, agvjax.RK4)
    assert "dt = 0.02 s" in said and "omega_n" in said and "k1" not in said
    (said,) = agvjax.step_warnings(law, 5e-3, agvjax.EULER)
    assert "k1 (5%)" in said  # 20/s times 5 ms, halved
    assert agvjax.step_warnings(agvjax.OSFC(), 5e-3, agvjax.EULER) == []  # names no modes


# ----------------------------------------------------------------------------------------------- smooth settling time


def settling(error, t, smooth=True):
    """True and smooth settling time of a run whose error in x is given."""
    flat, pair, three = jnp.zeros_like(t), jnp.zeros((t.size, 2)), jnp.zeros((t.size, 3))
    run = agvjax.Trajectory(
        t=t,
        position=pair.at[:, 0].set(error),
        velocity=pair,
        heading=flat,
        reference_position=pair,
        reference_heading=flat,
        command=three,
        inputs=three,
        delivered=three,
        limited=flat > 1,
        controller=(),
        weight_norm=None,
        ok=jnp.array(True),
    )
    found = agvjax.measure(run, agvjax.Criteria(smooth=smooth))
    return found.settling_time[0], found.settling_smooth[0] if smooth else found.settling_smooth


@pytest.mark.parametrize("tau", [0.2, 0.5, 1.5])
def test_the_smooth_settling_time_of_a_decaying_error_is_the_true_one_and_so_is_its_slope(tau):
    t = jnp.arange(0, 12.0, 1e-3)
    true, smooth = settling(0.8 * jnp.exp(-t / tau), t)
    exact = tau * np.log(0.8 / 0.05)
    np.testing.assert_allclose(true, exact, atol=2e-3)
    np.testing.assert_allclose(smooth, exact, rtol=0.06)  # later by the softness of the band
    slope = jax.jacfwd(lambda a: settling(0.8 * jnp.exp(-t / a), t)[1])(tau)
    np.testing.assert_allclose(slope, np.log(0.8 / 0.05), rtol=0.06)  # d/d tau of tau ln(e0 / band)


def test_the_smooth_settling_time_sees_a_later_crossing_come_before_it_counts():
    t = jnp.arange(0, 12.0, 1e-3)

    def both(height):
        return settling(0.8 * jnp.exp(-t / 0.3) + height * jnp.exp(-((t - 4.0) ** 2) / 0.02), t)

    def steps(count):
        heights = jnp.linspace(0.02, 0.08, count)
        return [np.diff(np.asarray(x)) for x in jax.jit(jax.vmap(both))(heights)]

    (true, smooth), (finer_true, finer) = steps(31), steps(241)
    assert min(true.max(), finer_true.max()) > 2.5  # the true one jumps by three seconds, however closely one looks
    assert np.all(finer >= -1e-12) and finer.max() < 0.5 * smooth.max() < 0.6  # the smooth one rises
    assert jax.jacfwd(lambda h: both(h)[1])(0.045) > 10 * abs(jax.jacfwd(lambda h: both(h)[0])(0.045))


def test_a_run_that_has_not_settled_counts_its_horizon_with_the_slope_of_the_time_outside():
    t = jnp.arange(0, 3.0, 1e-3)
    true, smooth = settling(0.8 * jnp.exp(-t / 2.0), t)
    assert np.isinf(true)
    np.testing.assert_allclose(smooth, t[-1], rtol=1e-3)
    assert settling(0.8 * jnp.exp(-t / 2.0), t, smooth=False)[1] is None
    assert jax.jacfwd(lambda a: settling(0.8 * jnp.exp(-t / a), t)[1])(0.9) > 0.5


def test_no_two_classes_have_the_same_structure():
    """Else `jit` may run on one what was compiled for the other: empty choices of a form differ in their type alone."""
    classes = {c for c in vars(agvjax).values() if isinstance(c, type) and hasattr(c, "__dataclass_fields__")}
    empty = [c for c in classes if not jax.tree.leaves(made(c))]
    assert {KinematicYawRate, ForwardSpeed, TurnedVelocity, Bearing, Tangent} <= set(empty)
    structures = [jax.tree.structure(made(c)) for c in classes]
    assert len(structures) > 20
    assert all(a != b for i, a in enumerate(structures) for b in structures[:i])


def made(kind):
    """An object of a class, its fields without default filled with nothing."""
    fields = kind.__dataclass_fields__.values()
    missing = [f.name for f in fields if f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING]
    return kind(**dict.fromkeys(missing, ()))
