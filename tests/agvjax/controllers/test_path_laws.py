"""Stanley, the LQR and the velocity reference at one instant, against what their equations give by hand."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

import agvjax
from agvjax import Base, Measurement, NeuroBackstepping, PathLQR, PathPID, Route, Stanley, VelocityReference
from agvjax.messages import Reference

LINE = Route.through([[0, 0], [4, 0], [8, 0]], 0.6, limits=agvjax.SpeedLimits(stop=False))
CIRCLE = Route.along(agvjax.Circle(radius=2.0, omega=0.3))  # .6 m/s, curvature 1/2
PERIOD = 0.05


def seen(x, y, heading, speed=0.6, yaw_rate=0.0):
    velocity = speed * np.array([np.cos(heading), np.sin(heading)])
    parts = {"position": jnp.array([x, y]), "velocity": jnp.asarray(velocity)}
    return Measurement(**parts, heading=jnp.asarray(heading), yaw_rate=jnp.asarray(yaw_rate))


def twist(law, route, now):
    """Speed, and curvature of what is driven."""
    place = route.search(now.position, now.heading)
    v, w = law.steer(law.own(now), place, route, now, PERIOD)[0]
    return float(v), float(w) / float(v)


def test_stanley_steers_as_its_equation_says_from_the_front_axle():
    law = Stanley(k=2.0, k_soft=0.3, k_yaw=0.1, wheelbase=0.4)
    e_psi, y, yaw_rate = 0.1, 0.05, 0.2
    front = y + 0.4 * np.sin(e_psi)
    angle = -(e_psi + 0.1 * yaw_rate) - np.arctan(2.0 * front / (0.3 + 0.6))
    assert twist(law, LINE, seen(3.0, y, e_psi, yaw_rate=yaw_rate))[1] == pytest.approx(np.tan(angle) / 0.4, rel=1e-6)


@pytest.mark.parametrize("angle", [-9.0, 9.0])
def test_stanley_steers_no_further_than_its_wheel_goes(angle):
    y = -np.sign(angle) * 3.0
    assert twist(Stanley(max_angular_velocity=9.0), LINE, seen(3.0, y, 0.0))[1] == pytest.approx(
        np.sign(angle) * np.tan(0.6) / 0.4
    )


@pytest.mark.parametrize("law", [PathPID(), PathLQR()])
def test_on_a_circle_a_law_without_an_error_drives_the_curvature_of_the_circle(law):
    speed, curvature = twist(law, CIRCLE, seen(2.0, 0.0, np.pi / 2))
    assert speed == pytest.approx(0.6) and curvature == pytest.approx(0.5, rel=1e-6)


def test_lqr_has_the_gains_of_a_long_horizon_and_places_stable_poles():
    """Bellman's recursion of the sampled double integrator, by hand, until it stands still."""
    v, q_y, q_psi, r = 0.8, 10.0, 1.0, 1.0
    step = v * PERIOD
    whole = expm(np.array([[0, 1, 0], [0, 0, 1], [0, 0, 0]]) * step)  # e, e_psi and a held curvature, along the way
    A, B = whole[:2, :2], whole[:2, 2:]
    P = np.zeros((2, 2))
    for _ in range(20_000):
        K = np.linalg.solve(r * step + B.T @ P @ B, B.T @ P @ A)
        P = np.diag([q_y, q_psi]) * step + A.T @ P @ (A - B @ K)
    law = PathLQR.designed(PERIOD, q_y=q_y, q_psi=q_psi, r=r, speeds=[0.4, v])
    np.testing.assert_allclose([law.k_y[1], law.k_psi[1]], K[0], rtol=1e-6)
    assert np.abs(np.linalg.eigvals(A - B @ K)).max() < 1


def test_lqr_interpolates_between_speeds_and_scales_what_is_tuned():
    law = PathLQR(speeds=[0.4, 0.8], k_y=[2.0, 4.0], k_psi=[1.0, 3.0], scale_y=1.5, ahead=0.0)
    now = seen(3.0, 0.1, 0.05, speed=0.6)
    assert twist(law, LINE, now)[1] == pytest.approx(-1.5 * 3.0 * 0.1 - 2.0 * 0.05, rel=1e-6)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [({"q_y": 0.0}, "q_y must be finite and > 0; got 0"), ({"speeds": [0.4, 0.2]}, "speeds must be > 0 and rise")],
)
def test_lqr_says_what_it_cannot_be_designed_for(wrong, said):
    with pytest.raises(ValueError, match=said):
        PathLQR.designed(PERIOD, **wrong)


def test_the_velocity_reference_moves_the_point_ahead_as_the_law_asks():
    """Eq. (4): the acceleration of the point L ahead of the axle, by differences of its velocity."""
    law, period = VelocityReference(inner=NeuroBackstepping(), L=0.3, largest=np.array([9.0, 9.0])), 1e-5
    now = seen(0.2, -0.1, 0.3, speed=0.5, yaw_rate=0.4)
    asked = Reference(
        position=jnp.array([0.6, 0.1]),
        velocity=jnp.array([0.4, 0.1]),
        acceleration=jnp.zeros(2),
        heading=jnp.asarray(0.2),
        heading_rate=jnp.zeros(()),
    )
    state = law.init(now, asked)
    state = state.__class__(inner=state.inner, twist=jnp.array([0.5, 0.4]))
    command, later, limited = law.advance(state, now, asked, period)
    wanted = law.inner.advance(state.inner, law._ahead(now), asked, period)[0].position

    def velocity(twist, heading):
        c, s = np.cos(heading), np.sin(heading)
        return np.array([twist[0] * c - 0.3 * twist[1] * s, twist[0] * s + 0.3 * twist[1] * c])

    moved = velocity(np.asarray(later.twist), 0.3 + 0.4 * period) - velocity((0.5, 0.4), 0.3)
    np.testing.assert_allclose(moved / period, wanted, rtol=1e-3, atol=1e-3)
    np.testing.assert_array_equal(command.twist, later.twist)
    assert not limited
    assert agvjax.Sampled(inner=law, vehicle=Base()).follows() is False


def test_a_base_is_told_that_a_law_gives_no_twist():
    with pytest.raises(ValueError, match="Base is driven by speed and yaw rate: put the law into agvjax.Velocity"):
        Base().allocate(agvjax.Command(position=jnp.zeros(2), heading=jnp.zeros(())), seen(0, 0, 0.0))


def test_what_a_base_needs_along_a_circle_is_the_speed_of_each_wheel_by_hand():
    scene = agvjax.Scenario.of(Base(track=0.5), path=CIRCLE, disturbance=agvjax.NoDisturbance())
    needs = agvjax.demands(scene, 10.0, points=11).needs
    np.testing.assert_allclose(needs["left"], 0.6 - 0.3 * 0.25, rtol=1e-3)
    np.testing.assert_allclose(needs["right"], 0.6 + 0.3 * 0.25, rtol=1e-3)
    back = Route.through([[0, 0], [-1, 0], [-2, 0]], -0.5, limits=agvjax.SpeedLimits(stop=False))
    scene = agvjax.Scenario.of(Base(), path=back, disturbance=agvjax.NoDisturbance())
    np.testing.assert_allclose(agvjax.demands(scene, 3.0, points=11).needs["left"], -0.5, rtol=1e-6)
