"""Stops on the way: where a route is cut, how long a vehicle stands by the clock and in the loop, what is refused."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from agvjax import Base, Chain, Deadzone, Delay, PathPID, RegulatedPurePursuit, Route, Sampled, Scenario, SpeedLimits

LIMITS = SpeedLimits(acceleration=0.5, deceleration=0.5)
LINE = [[0, 0], [2, 0], [5, 0], [9, 0]]
BENT = [[0, 0], [2, 0], [5, 1], [8, 1], [10, 3]]


def rows(route):
    begins, _, _, signs, dwell = np.asarray(route.legs)
    return begins.tolist(), signs.tolist(), dwell.tolist()


def test_by_the_clock_it_brakes_stands_and_goes_on_as_by_hand():
    route = Route.through([[0, 0], [1, 0], [4, 0], [8, 0]], [1, 1, 0, 1], dwell=2.0, limits=LIMITS)
    # 3 m at 1 m/s, 1 m braking in 2 s, 2 s of rest, 1 m speeding up in 2 s, 2 m in 2 s, 1 m braking in 2 s
    times = np.array([0.0, 3.0, 4.0, 5.0, 6.0, 6.99, 8.0, 9.0, 11.0, 13.0, 99.0])
    wanted = [0, 3, 3.75, 4, 4, 4, 4.25, 5, 7, 8, 8]
    assert route.end() == pytest.approx(13)
    at, velocity = jax.vmap(lambda t: jax.jvp(route, (t,), (jnp.ones_like(t),)))(jnp.asarray(times))
    np.testing.assert_allclose(at[:, 0], wanted, atol=2e-6)
    np.testing.assert_allclose(velocity[[4, 5], 0], 0, atol=1e-12)
    np.testing.assert_allclose(velocity[[2, 6, 7], 0], [0.5, 0.5, 1], rtol=1e-4)


def test_a_stop_cuts_a_curve_and_leaves_it_as_it_was():
    whole, cut = Route.through(BENT, limits=LIMITS), Route.through(BENT, dwell=[0, 0, 3, 1, 0], limits=LIMITS)
    marks = [float(whole.search(jnp.asarray(p, float), jnp.zeros(())).arc) for p in BENT]
    begins, signs, dwell = rows(cut)
    np.testing.assert_allclose(begins, [0, *marks[2:4]], atol=1e-9)
    assert signs == [1, 1, 1] and dwell == [3, 1, 0]
    assert float(cut.length) == pytest.approx(float(whole.length), rel=1e-12)
    for leg, arc in ((0, 1.0), (1, marks[2] + 0.5), (2, marks[3] + 0.7)):
        one, other = whole.at(jnp.asarray(arc), jnp.zeros(())), cut.at(jnp.asarray(arc), jnp.asarray(float(leg)))
        np.testing.assert_allclose(one.position, other.position, atol=1e-7)
        np.testing.assert_allclose(one.tangent, other.tangent, atol=1e-6)


def test_a_point_of_speed_0_is_driven_up_to_at_the_speed_of_those_beside_it():
    route = Route.through(LINE, [0.8, 1.0, 0.0, 0.4])
    before, after = route.at(jnp.asarray(4.9), jnp.zeros(())), route.at(jnp.asarray(5.1), jnp.ones(()))
    assert 0.7 < float(before.speed) < 0.72 and 0.68 < float(after.speed) < 0.7  # (1.0 + 0.4) / 2, without limits


def test_two_stops_in_a_row_are_driven_between_at_the_speed_around_them():
    route = Route.through(LINE, [0.8, 0.0, 0.0, 0.4], dwell=[0, 1, 2, 0])
    assert rows(route) == (pytest.approx([0, 2, 5]), [1, 1, 1], [1, 2, 0])
    assert float(route.at(jnp.asarray(3.5), jnp.ones(())).speed) == pytest.approx(0.6)


def test_lines_stop_in_the_middle_of_the_arc_of_a_corner_and_where_lines_go_on():
    route = Route.corners([[0, 0], [2, 0], [4, 0], [4, 4]], 1.0, radius=1.0, dwell=[0, 1, 3, 0], limits=LIMITS)
    begins, _, dwell = rows(route)
    np.testing.assert_allclose(begins, [0, 2, 3 + np.pi / 4], atol=1e-12)
    assert dwell == [1, 3, 0]


@pytest.mark.parametrize(
    "speed, begins, signs, dwell",
    [
        ([1, 1, 0, -1], [0, 4], [1, -1], [1.5, 0]),  # where it turns back
        ([1, 0, -1, -1], [0, 2, 4], [1, 1, -1], [1.5, 0, 0]),  # before it turns back
    ],
)
def test_lines_stop_where_they_turn_back(speed, begins, signs, dwell):
    route = Route.corners([[0, 0], [2, 0], [4, 0], [3, 0]], speed, radius=1.0, dwell=1.5, limits=LIMITS)
    assert rows(route) == (pytest.approx(begins), signs, dwell)


def test_a_spline_stops_where_it_turns_back():
    route = Route.through([[0, 0], [2, 0], [4, 0], [3, 1], [2, 2]], [1, 1, 0, -1, -1], dwell=1.5, limits=LIMITS)
    assert rows(route) == (pytest.approx([0, 4]), [1, -1], [1.5, 0])


def test_a_corridor_goes_on_across_stops():
    widths = np.array([[1, 2], [1, 2], [4, 2], [8, 1]], float)
    route = Route.through(LINE, dwell=[0, 1, 1, 0], half_width=widths)
    for leg, arc, left, right in ((0, 1.0, 1, 2), (1, 3.5, 2.5, 2), (2, 7.0, 6, 1.5)):
        room = route.at(jnp.asarray(arc), jnp.asarray(float(leg))).room
        np.testing.assert_allclose(np.array(room), [left, right], rtol=1e-9)


LAWS = {
    "path_pid": PathPID(),
    "pure_pursuit": RegulatedPurePursuit(desired_linear_vel=0.8),
    "stanley": agvjax.Stanley(),
    "path_lqr": agvjax.PathLQR(),
}


@pytest.mark.parametrize(
    "law", [pytest.param(law, id=n, marks=[pytest.mark.slow] * (n != "path_pid")) for n, law in LAWS.items()]
)
def test_a_vehicle_with_deadzone_and_delay_stops_waits_and_finishes(law):
    points, limits = [[0, 0], [2.5, 0], [5, 0], [5, 4]], SpeedLimits(deceleration=0.3)
    route = Route.corners(points, 0.6, radius=1.0, dwell=[0, 2.5, 0, 0], limits=limits)
    zone = Deadzone(slope_right=1.0, slope_left=1.0, threshold_right=0.04, threshold_left=0.04)
    delay = Chain(delay=Delay(time=0.06, slots=4))
    given = Scenario(
        plant=Base(),
        deadzone={"left": zone, "right": zone},
        actuators={"left": delay, "right": delay},
        disturbance=agvjax.NoDisturbance(),
        path=route,
        start=agvjax.Start(velocity=np.zeros(2), position=np.array([0.0, 0.1])),
    )
    run = agvjax.simulate(Sampled(inner=law, vehicle=Base(), period=0.05), given, dt=5e-3, n_steps=9000)
    asked = np.any(np.asarray(run.command)[:-1] != 0, axis=1)
    rests = np.flatnonzero(np.diff(np.r_[True, asked].astype(int)))  # stands, goes, stands at the end
    assert len(rests) == 3 and (rests[1] - rests[0]) * 5e-3 == pytest.approx(2.5, abs=1e-9)
    assert np.linalg.norm(np.asarray(run.position)[rests[1]] - points[1]) < 0.05
    assert np.linalg.norm(np.asarray(run.velocity)[rests[1]]) < 1e-3
    found = agvjax.measure(run, agvjax.Criteria()).followed
    assert np.isfinite(float(found.time_to_finish)) and float(found.standstill) < 0.01
    assert np.linalg.norm(np.asarray(run.position)[-1] - [5, 4]) < 0.08


def test_what_pushes_a_waiting_vehicle_does_not_make_it_wait_anew():
    route = Route.through(LINE, dwell=[0, 0, 1.0, 0], limits=LIMITS)
    place = dataclasses.replace(route.at(jnp.asarray(4.97), jnp.zeros(())), arc=jnp.asarray(4.97))
    h, still, legs, stands = jnp.asarray(0.1), jnp.zeros(2), [], []
    # there for 0.5 s, 3 cm before for 0.3 s, there again for another 0.6 s: the sixth instant is the first of going on
    for x in [4.99] * 5 + [4.96] * 3 + [4.99] * 6:
        place = route.follow(jnp.array([x, 0.0]), place, still, h)
        legs.append(int(place.leg))
        stands.append(bool(route.stands(place)))
    assert legs == [0] * 13 + [1]
    assert stands == [True] * 5 + [False] * 3 + [True] * 5 + [False]


def test_a_dwell_time_is_rounded_to_the_nearest_instants():
    for dwell, periods in ((0.0, 0), (0.04, 0), (0.06, 1), (0.1, 1), (0.26, 3)):
        route = Route.through(LINE, [1, 1, 0, 1], dwell=dwell, limits=LIMITS)
        place, count = route.at(jnp.asarray(4.97), jnp.zeros(())), 0
        for _ in range(9):
            place = route.follow(jnp.array([4.99, 0.0]), place, jnp.zeros(2), jnp.asarray(0.1))
            count += bool(route.stands(place))
        assert count == periods and int(place.leg) == 1


BAD = {
    "first": (dict(speed=[0, 1, 1, 1]), "speed must not be 0 at the first and the last point.* number 1"),
    "last": (dict(dwell=[0, 0, 0, 2]), "dwell must be 0 at the first and the last point.* number 4"),
    "in a row": (dict(speed=[1, 0, 0, -1]), "speed must not be 0 at two points in a row where.*; numbers 2 and 3"),
    "closed": (dict(speed=[1, 0, 1, 1], closed=True), "speed must not be 0 on a closed route"),
    "closed and waiting": (dict(dwell=[0, 1, 0, 0], closed=True), "dwell must be 0 on a closed route"),
    "negative": (dict(dwell=[0, -1, 0, 0]), "dwell must be finite and >= 0 .*; got -1"),
    "endless": (dict(dwell=np.inf, speed=[1, 0, 1, 1]), "dwell must be finite .*; got inf"),
    "nowhere": (dict(dwell=2.0), "dwell must be one for each of 4 points where none has speed 0; got 2"),
    "too few": (dict(dwell=[1.0, 2.0]), r"dwell must be a number or one for each of 4 points; its shape is \(2,\)"),
}


@pytest.mark.parametrize("given, message", BAD.values(), ids=BAD)
def test_stops_that_cannot_be_are_refused(given, message):
    with pytest.raises(ValueError, match=message):
        Route.through([[0, 0], [2, 0], [5, 1], [4, 4]], **given)


@pytest.mark.parametrize("given", [dict(radius=2.0), dict(tolerance=1.0)])
def test_a_stop_where_an_arc_takes_the_whole_line_after_it_is_not_lost(given):
    route = Route.corners([[0, 0], [2, 0], [4, 0], [4, 4]], 1.0, dwell=[0, 1, 0, 0], limits=LIMITS, **given)
    begins, _, dwell = rows(route)
    assert begins == pytest.approx([0, 2]) and dwell == [1, 0]


def test_the_last_point_of_lines_has_no_speed():
    corners = [[0, 0], [2, 0], [4, 0], [6, 0]]
    one, other = (Route.corners(corners, [1, 1, 0, v], radius=0.1, limits=LIMITS) for v in (0.1, 1.0))
    assert one.end() == other.end()


@pytest.mark.slow
def test_metrics_are_of_the_nearest_point_also_where_the_law_waits_elsewhere():
    """The sensor sits 5 cm ahead: the law stops 5 cm early, and the vehicle passes the stop when the law has waited."""
    route = Route.corners([[0, 0], [2, 0], [3, 0], [3, 3]], 0.6, radius=0.5, dwell=[0, 3.0, 0, 0], limits=LIMITS)
    ideal = Deadzone(slope_right=1.0, slope_left=1.0, threshold_right=0.0, threshold_left=0.0)
    given = Scenario(
        plant=Base(),
        deadzone={"left": ideal, "right": ideal},
        disturbance=agvjax.NoDisturbance(),
        path=route,
        start=agvjax.Start(velocity=np.zeros(2), position=np.array([0.0, 0.05])),
        sensor=agvjax.Mounted(ahead=0.05),
    )
    run = agvjax.simulate(Sampled(inner=PathPID(), vehicle=Base(), period=0.05), given, dt=5e-3, n_steps=3000)
    arcs = np.linspace(0, float(route.length), 6001)
    legs = np.searchsorted(np.asarray(route.legs)[0], arcs, "right") - 1.0
    line = np.asarray(jax.jit(jax.vmap(route.at))(jnp.asarray(arcs), jnp.asarray(legs)).position)
    away = [np.linalg.norm(line - p, axis=1).min() for p in np.asarray(run.position)[::10]]
    peak = float(agvjax.measure(run, agvjax.Criteria()).followed.cross_track_peak)
    assert peak == pytest.approx(max(away), abs=2e-3) and peak < 0.15


def test_no_integral_winds_up_while_it_waits():
    law, route = PathPID(k_i=1.0), Route.through(LINE, dwell=[0, 0, 9.0, 0], limits=LIMITS)
    seen = agvjax.Measurement(
        position=jnp.array([4.99, 0.1]), velocity=jnp.zeros(2), heading=jnp.zeros(()), yaw_rate=jnp.zeros(())
    )
    zero = jnp.zeros(2)
    asked = agvjax.Reference(
        position=zero, velocity=zero, acceleration=zero, heading=jnp.zeros(()), heading_rate=jnp.zeros(()), route=route
    )
    state = dataclasses.replace(law.init(seen, asked), own=jnp.asarray(0.02))
    for _ in range(20):
        _, state, _ = law.advance(state, seen, asked, jnp.asarray(0.05))
    assert float(state.place.waited) == 20 and float(state.own) == pytest.approx(0.02)


@pytest.mark.slow
def test_a_long_wait_in_single_precision_lasts_as_long_as_it_is_told():
    with jax.enable_x64(False):
        route = Route.through(LINE, [1, 1, 0, 1], dwell=20.0, limits=LIMITS)
        place = route.at(jnp.asarray(4.97), jnp.zeros(()))
        step = jax.jit(lambda p: route.follow(jnp.array([4.99, 0.0]), p, jnp.zeros(2), jnp.asarray(1e-3)))
        for _ in range(20_000):
            place = step(place)
        assert place.waited.dtype == jnp.float32 and int(place.leg) == 0 and int(step(place).leg) == 1


def test_limits_that_leave_no_speed_are_refused():
    limits = SpeedLimits(acceleration=0.5, deceleration=0.4, jerk=0.1)
    with pytest.raises(ValueError, match="limits leave no speed"):
        Route.corners([[0, 0], [1, 0], [1 + 1e-4, 0]], 1.0, radius=0.1, dwell=[0, 1, 0], limits=limits)
