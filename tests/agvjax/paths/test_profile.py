"""The speed over a route: the largest within its limits, against a linear programme, and by hand."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import linprog

from agvjax import Route, SpeedLimits
from agvjax.paths import profile


def programme(top, gain, loss, closed=False):
    """The squared speeds of largest sum below `top` that rise and fall by no more from knot to knot."""
    n = len(top)
    following = np.roll(np.arange(n), -1) if closed else np.arange(1, n)
    rows = np.arange(len(following))
    step = np.zeros((len(following), n))
    step[rows, following] += 1
    step[rows, rows] -= 1
    bounds = [(0, x if np.isfinite(x) else None) for x in top]
    sides = np.r_[np.full(len(rows), gain), np.full(len(rows), loss)]
    keep = np.isfinite(sides)
    found = linprog(-np.ones(n), np.r_[step, -step][keep], sides[keep], bounds=bounds, method="highs")
    assert found.success, found.message
    return found.x


LIMITS = {
    "all": SpeedLimits(speed=1.6, acceleration=0.5, deceleration=0.8, lateral_acceleration=0.4),
    "speeding up": SpeedLimits(acceleration=0.3),
    "slowing down": SpeedLimits(deceleration=0.3),
    "turns": SpeedLimits(lateral_acceleration=0.2),
    "none": SpeedLimits(),
}


def drawn(n=80, seed=3):
    """Speeds and curvatures that jump, and a piece without curvature."""
    random = np.random.default_rng(seed)
    curvature = np.repeat(random.uniform(-2, 2, n // 10), 10) * random.uniform(0.5, 1, n)
    curvature[30:50] = 0
    return np.repeat(random.uniform(0.3, 2.5, n // 8), 8), curvature


@pytest.mark.parametrize("ends", [(False, False), (True, False), (False, True), (True, True)])
@pytest.mark.parametrize("limits", LIMITS.values(), ids=LIMITS)
def test_no_faster_profile_keeps_the_limits(limits, ends):
    h, (given, curvature) = 0.11, drawn()
    before = given.copy(), curvature.copy()
    squares = profile.squares(given, curvature, h, limits, ends)
    np.testing.assert_array_equal(given, before[0])  # it changes nothing that it was given
    top = np.minimum(given, limits.speed) ** 2
    bent = curvature != 0
    top[bent] = np.minimum(top[bent], limits.lateral_acceleration / np.abs(curvature[bent]))
    top[0], top[-1] = (0.0 if end else x for end, x in zip(ends, (top[0], top[-1]), strict=True))
    # v^2 changes by 2 a h over a piece
    wanted = programme(top, 2 * h * limits.acceleration, 2 * h * limits.deceleration)
    np.testing.assert_allclose(squares, wanted, atol=1e-9)


@pytest.mark.parametrize("turn", [0, 7, 33, 79])
@pytest.mark.parametrize("limits", LIMITS.values(), ids=LIMITS)
def test_of_a_closed_route_no_faster_one_does_wherever_it_begins(limits, turn):
    h, (given, curvature) = 0.11, (np.roll(x, turn) for x in drawn())
    around = profile.around(np.r_[given, given[:1]], np.r_[curvature, curvature[:1]], h, limits)
    assert around[0] == around[-1] and len(around) == 81
    top = np.minimum(given, limits.speed) ** 2
    bent = curvature != 0
    top[bent] = np.minimum(top[bent], limits.lateral_acceleration / np.abs(curvature[bent]))
    wanted = programme(top, 2 * h * limits.acceleration, 2 * h * limits.deceleration, closed=True)
    np.testing.assert_allclose(around[:-1], wanted, atol=1e-9)


def test_limits_so_low_that_a_whole_lap_is_not_enough_are_kept_round_the_lap():
    given = np.r_[0.5, np.full(20, 5.0), 0.5]  # 21 knots a lap, h = 1: from the slow one on at most 10 up and 11 down
    squares = profile.around(given, np.zeros(22), 1.0, SpeedLimits(acceleration=0.01, deceleration=0.02))
    k = np.arange(22)
    np.testing.assert_allclose(squares, 0.25 + np.minimum(0.02 * k, 0.04 * (21 - k)), atol=1e-12)


# --------------------------------------------------------------------------------------------------------------- jerk


def motion(squares, h, closed=False):
    """Duration, accelerations, and jerks between the middles of pieces; from rest and to it too."""
    root = np.sqrt(squares)
    duration, acceleration = 2 * h / (root[1:] + root[:-1]), np.diff(squares) / (2 * h)
    if closed:
        step, between = acceleration - np.roll(acceleration, 1), (duration + np.roll(duration, 1)) / 2
    else:
        step, between = np.diff(acceleration), (duration[1:] + duration[:-1]) / 2
    jerk = step / between
    if squares[0] == 0 and not closed:
        jerk = np.r_[acceleration[0] / (duration[0] / 2), jerk, -acceleration[-1] / (duration[-1] / 2)]
    return duration.sum(), acceleration, jerk


# length [m], top speed [m/s], acceleration [m/s^2], jerk [m/s^3], and the least time from rest to rest [s] (Biagiotti
# and Melchiorri 2008, 3.4): L/v + v/a + a/j where top speed and acceleration are reached; 2 sqrt(v/j) + L/v where the
# speed is and the acceleration is not; 4 cbrt(L/2j) where neither is.
STRAIGHTS = {
    "all reached": (10.0, 1.0, 0.5, 1.0, 10 + 2 + 0.5),
    "acceleration never reached": (10.0, 1.0, 2.0, 0.5, 10 + 2 * np.sqrt(2)),
    "only jerk": (2.0, 9.0, 9.0, 0.5, 4 * np.cbrt(2.0)),
}


@pytest.mark.parametrize("n", [200, 1500, pytest.param(6000, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("length", "speed", "acceleration", "jerk", "least"), STRAIGHTS.values(), ids=STRAIGHTS)
def test_a_straight_is_driven_in_the_time_of_a_double_s(length, speed, acceleration, jerk, least, n):
    limits = SpeedLimits(speed=speed, acceleration=acceleration, deceleration=acceleration, jerk=jerk)
    squares = profile.squares(np.full(n, 20.0), np.zeros(n), length / (n - 1), limits, (True, True))
    time, rates, jerks = motion(squares, length / (n - 1))
    assert least * 0.995 < time < least * 1.02
    assert np.abs(rates).max() <= acceleration * (1 + 1e-6)
    if n <= profile.MOST:
        assert np.abs(jerks).max() <= jerk * (1 + 1e-6)


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("limits", [*LIMITS.values()], ids=LIMITS)
def test_jerk_is_limited_below_what_the_other_limits_leave(limits, closed):
    h, (given, curvature) = 0.11, drawn()
    soft = dataclasses.replace(limits, jerk=0.6)
    if closed:
        given, curvature = (np.r_[x, x[:1]] for x in (given, curvature))
        top, found = (profile.around(given, curvature, h, x) for x in (limits, soft))
    else:
        top, found = (profile.squares(given, curvature, h, x, (True, True)) for x in (limits, soft))
    assert np.all(found <= top + 1e-9)
    time, rates, jerks = motion(found, h, closed)
    assert np.abs(jerks).max() <= 0.6 * (1 + 1e-6)
    assert rates.max() <= limits.acceleration * (1 + 1e-6) and -rates.min() <= limits.deceleration * (1 + 1e-6)
    assert np.abs(motion(top, h, closed)[2]).max() > 0.6 and time < np.inf


# ------------------------------------------------------------------------------------------------------------- routes


@jax.jit
def places(route, arcs, legs):
    return jax.vmap(route.at)(arcs, legs)


def speeds(route, arcs, leg=0):
    arcs = jnp.asarray(arcs, float)
    return np.asarray(places(route, arcs, jnp.full_like(arcs, leg)).speed)


def test_a_corner_is_taken_as_fast_as_its_lateral_acceleration_allows():
    limits = SpeedLimits(acceleration=0.5, deceleration=0.8, lateral_acceleration=0.3, stop=False)
    route = Route.corners([[0, 0], [6, 0], [6, 6]], 2.0, radius=1.5, limits=limits)
    slow = 0.3 * 1.5  # m^2/s^2
    arc, h = np.pi / 2 * 1.5, float(route.length) / route.squares.shape[1]
    s = np.linspace(0, float(route.length), 900)
    before, after = 2 * 0.8 * np.maximum(4.5 - s, 0), 2 * 0.5 * np.maximum(s - 4.5 - arc, 0)
    wanted = np.minimum(4.0, slow + before + after)
    # to a piece: the curvature jumps within one
    np.testing.assert_allclose(speeds(route, s) ** 2, wanted, atol=2 * 0.8 * h + 1e-9)
    np.testing.assert_allclose(speeds(route, 4.5 + np.linspace(0.1, arc - 0.1, 20)) ** 2, slow, rtol=1e-4)
    found = places(route, jnp.asarray(s), jnp.zeros(900))
    knots = np.arange(route.squares.shape[1]) * h
    at = places(route, jnp.asarray(knots), jnp.zeros(len(knots)))
    assert np.max(np.asarray(at.speed) ** 2 * np.abs(at.curvature)) < 0.3 * (1 + 1e-9)
    assert np.all(np.asarray(found.speed) > 0)


def test_it_stops_at_the_end_and_where_it_turns_back_and_only_there():
    limits = SpeedLimits(acceleration=0.5, deceleration=0.8)
    points, speed = [[0, 0], [4, 0], [0, 0.2]], [1.0, -0.6, -0.6]
    route = Route.corners(points, speed, radius=1.0, limits=limits)
    length = np.array([4, np.hypot(4, 0.2)])
    near = 1e-3
    for leg, begin, top in ((0, 0.0, 1.0), (1, 4.0, 0.36)):
        s = np.linspace(near, length[leg] - near, 500)
        wanted = np.minimum(top, 1.6 * (length[leg] - s))
        wanted = np.minimum(wanted, 1.0 * s) if leg else wanted
        h = length[leg] / 64
        np.testing.assert_allclose(speeds(route, begin + s, leg) ** 2, wanted, atol=1.6 * h / 2)
    assert speeds(route, [0.0])[0] == 1.0  # it is driving when it comes
    assert speeds(route, [4.0])[0] == 0 and speeds(route, [4.0], 1)[0] == 0
    assert speeds(route, [float(route.length)], 1)[0] == 0
    goes_on = Route.corners(points, speed, radius=1.0, limits=SpeedLimits(deceleration=0.8, stop=False))
    assert speeds(goes_on, [4.0])[0] == 0 and speeds(goes_on, [float(goes_on.length)], 1)[0] == pytest.approx(0.6)
    assert np.isfinite(route.end()) and np.isfinite(goes_on.end())


def test_the_clock_takes_the_time_of_constant_accelerations():
    limits = SpeedLimits(acceleration=0.5, deceleration=0.5)
    route = Route.corners([[0, 0], [8, 0], [0, 0.0001]], [1.0, -1.0, -1.0], radius=1.0, limits=limits)
    # to the cusp 7 m at 1 m/s and 1 m in 2 s; back 1 m in 2 s, 6 m, 1 m in 2 s: knots are 0.125 m apart
    assert route.end() == pytest.approx(9 + 10, abs=1e-6)


def test_a_closed_route_is_run_through_its_seam_without_a_stop():
    limits = SpeedLimits(acceleration=0.4, deceleration=0.6, lateral_acceleration=0.3)
    points = np.array([[1, 0], [10, 0], [10, 5], [0, 5], [0, 0]])
    route = Route.corners(points, 1.5, radius=1.0, closed=True, limits=limits)
    length = float(route.length)
    ends = speeds(route, [0.0, length - 1e-9, length])
    np.testing.assert_allclose(ends, ends[0], atol=1e-6)
    h = length / route.squares.shape[1]
    assert 0.3 - 1e-9 < ends[0] ** 2 < 0.3 + 2 * 0.4 * h + 1e-9  # it begins where the last corner ends, to a piece
    # begun elsewhere it is the same speed at the same place
    other = Route.corners(np.roll(points, -2, axis=0), 1.5, radius=1.0, closed=True, limits=limits)
    first = places(route, jnp.linspace(0, length, 400), jnp.zeros(400))
    second = places(other, jnp.linspace(0, length, 4000), jnp.zeros(4000))
    away = np.linalg.norm(np.asarray(first.position)[:, None] - np.asarray(second.position)[None], axis=-1)
    np.testing.assert_allclose(first.speed, np.asarray(second.speed)[away.argmin(axis=1)], atol=0.03)
