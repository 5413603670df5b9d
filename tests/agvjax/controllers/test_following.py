"""Laws that follow a route in the loop: against a loop by hand, metrics against the trajectory, and their branch."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
import reference_following
from agvjax import Base, Chain, Criteria, Deadzone, Delay, Dumbbell, PathPID, Route, Sampled, Scenario, SpeedLimits
from reference_following import Gains, Line, Robot

DT = 5e-3


def scenario(path, robot=None, **start):
    robot = Robot() if robot is None else robot
    zone = Deadzone(
        slope_right=robot.slope,
        slope_left=robot.slope,
        threshold_right=robot.threshold,
        threshold_left=robot.threshold,
    )
    delay = Chain(delay=Delay(time=robot.delay, slots=4))
    return Scenario(
        plant=Base(track=robot.track, time_constant=robot.tau, acceleration=robot.a_max),
        deadzone={"left": zone, "right": zone},
        actuators={"left": delay, "right": delay},
        disturbance=agvjax.NoDisturbance(),
        path=path,
        start=agvjax.Start(velocity=np.zeros(2), **start),
    )


def sampled(inner, period=0.05):
    return Sampled(inner=inner, vehicle=Base(), period=period)


# ------------------------------------------------------------------------------------------------------ a loop by hand

RECTANGLE = [[1, 0], [10, 0], [10, 5], [0, 5], [0, 0]]


def rounded(step=2e-3, corner=1.0):
    """10 m x 5 m with corners of 1 m, from (1, 0) on, counter-clockwise: lines and quarters of circles by hand."""
    quarter = corner * np.pi / 2
    lengths = np.tile([8.0, quarter, 3.0, quarter], 2)
    marks = np.r_[0, np.cumsum(lengths)]
    centres = np.array([[9, 1], [9, 4], [1, 4], [1, 1]], float)
    n = round(marks[-1] / step)
    arc = marks[-1] * np.arange(n) / n
    points, heading, curvature = np.zeros((n, 2)), np.zeros(n), np.zeros(n)
    begins = np.array([[1, 0], [10, 1], [9, 5], [0, 4]], float)
    for i, s in enumerate(arc):
        k = int(np.searchsorted(marks, s, "right")) - 1
        side, rest = k // 2, s - marks[k]
        a = side * np.pi / 2
        if k % 2 == 0:
            points[i], heading[i] = begins[side] + rest * np.array([np.cos(a), np.sin(a)]), a
        else:
            heading[i], curvature[i] = a + rest / corner, 1 / corner
            points[i] = centres[side] + corner * np.array([np.sin(heading[i]), -np.cos(heading[i])])
    return Line(arc, points, heading, curvature, float(marks[-1]))


@pytest.fixture(scope="module")
def rectangle():
    return Route.corners(RECTANGLE, 0.8, radius=1.0, closed=True, half_width=0.25), rounded()


@pytest.mark.parametrize(
    "gains, aside, heading",
    [
        (Gains(), 0.2, -0.3),
        (Gains(k_y=8.1, k_psi=5.6, k_i=3.8, ahead=0.28, min_radius=0.72, min_speed=0.2), -0.3, 0.4),
        pytest.param(Gains(k_y=2.0, k_psi=2.5, k_i=0.0, ahead=0.1), 0.3, 0.1, marks=pytest.mark.slow),
    ],
)
def test_the_loop_is_that_of_one_by_hand(rectangle, gains, aside, heading):
    route, line = rectangle
    start = np.array([1.0, aside, heading])
    n = 5000  # 25 s: nearly a lap
    loop = functools.partial(reference_following.follow, gains=gains, robot=Robot(), start=start, arc=0.0, speed=0.8)
    law = PathPID(
        k_y=gains.k_y,
        k_psi=gains.k_psi,
        k_i=gains.k_i,
        ahead=gains.ahead,
        regulated_linear_scaling_min_radius=gains.min_radius,
        regulated_linear_scaling_min_speed=gains.min_speed,
    )
    given = scenario(route, position=start[:2], heading=start[2])
    run = agvjax.simulate(sampled(law), given, dt=DT, n_steps=n)
    assert bool(run.ok)
    found = agvjax.measure(run, Criteria(late=6.0)).followed
    # lines and arcs, whose curvature jumps; that of the route's own pieces, which rises within 14 mm
    for way, off, rel, late_rel in ((line, 6e-3, 0.01, 0.03), (of_route(route), 5e-4, 2e-3, 4e-3)):
        states, away = loop(way, period=0.05, dt=DT, n=n)
        np.testing.assert_allclose(run.position, states[:, :2], atol=off)
        np.testing.assert_allclose(run.route.cross_track, away, atol=off)
        weights = np.r_[0.5, np.ones(n - 1), 0.5] * DT
        assert float(found.cross_track) == pytest.approx(np.sqrt(np.sum(weights * away**2) / (n * DT)), rel=rel)
        late = np.arange(n + 1) * DT >= 6.0 - 1e-9
        root = np.sqrt(np.trapezoid(away[late] ** 2, dx=DT) / (n * DT - 6.0))
        assert float(found.cross_track_late) == pytest.approx(root, rel=late_rel)
        assert float(found.cross_track_peak) == pytest.approx(np.abs(away).max(), rel=1e-3)


def of_route(route, step=2e-3):
    """A route's own places as a polyline."""
    n = round(float(route.length) / step)
    arc = float(route.length) * np.arange(n) / n
    places = jax.jit(jax.vmap(route.at, in_axes=(0, None)))(jnp.asarray(arc), jnp.zeros(()))
    tangent = np.asarray(places.tangent)
    heading = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
    return Line(arc, np.asarray(places.position), heading, np.asarray(places.curvature), float(route.length))


# ------------------------------------------------------------------------------------------------------------- metrics


def by_hand(run, line_of, horizon, late):
    """Metrics of a run from its places and headings, by a search of the nearest point along the way."""
    t = np.asarray(run.t)
    position, heading = np.asarray(run.position), np.asarray(run.heading)
    arcs, points, tangents, wanted = line_of
    e, e_psi, way, profile, last = [], [], [], [], 0
    for p, psi in zip(position, heading, strict=True):
        low = max(last - 300, 0)
        window = slice(low, last + 300)
        k = low + int(np.argmin(np.sum((points[window] - p) ** 2, axis=1)))
        k = min(k, len(arcs) - 1)
        d = p - points[k]
        along = tangents[k] @ d
        e.append(tangents[k, 0] * d[1] - tangents[k, 1] * d[0])
        toward = np.arctan2(tangents[k, 1], tangents[k, 0])
        e_psi.append((psi - toward + np.pi) % (2 * np.pi) - np.pi)
        way.append(arcs[k] + along)
        profile.append(wanted[k])
        last = k
    e, e_psi, way = np.array(e), np.array(e_psi), np.array(way)
    after = t >= late - 1e-9

    def mean(x, keep=slice(None)):
        return np.trapezoid(x[keep], t[keep]) / (t[keep][-1] - t[keep][0])

    velocity = np.asarray(run.velocity)
    speed = velocity[:, 0] * np.cos(heading) + velocity[:, 1] * np.sin(heading)
    yaw_rate = np.gradient(heading, t)
    still = (np.linalg.norm(velocity, axis=1) < 1e-3) & (np.abs(yaw_rate) < 1e-3)
    asked = np.any(np.asarray(run.inputs) != 0, axis=1)
    acceleration = np.diff(speed) / np.diff(t)
    return {
        "cross_track": np.sqrt(mean(e**2)),
        "cross_track_late": np.sqrt(mean(e**2, after)),
        "cross_track_peak": np.abs(e).max(),
        "cross_track_peak_late": np.abs(e[after]).max(),
        "heading_error": np.sqrt(mean(e_psi**2)),
        "pace": horizon / (way[-1] - way[0]),
        "outside_corridor": mean((np.abs(e) > 0.15).astype(float)),
        "corridor_excess": max(np.abs(e).max() - 0.15, 0),
        "corridor_excess_late": max(np.abs(e[after]).max() - 0.15, 0),
        "standstill": mean((still & asked).astype(float)),
        "lateral_acceleration": np.abs(speed * yaw_rate).max(),
        "speed_error": np.sqrt(mean((speed * np.cos(e_psi) - np.array(profile)) ** 2)),
        "jerk": np.sqrt(np.sum((np.diff(acceleration) / DT) ** 2) * DT / horizon),
        "way": way,
    }


@pytest.mark.slow
def test_metrics_are_those_of_the_trajectory(rectangle):
    limits = SpeedLimits(acceleration=0.4, deceleration=0.3, lateral_acceleration=0.5)
    route = Route.corners([[0, 0], [5, 0], [5, 3]], 0.8, radius=1.0, half_width=0.15, limits=limits)
    given = scenario(route, position=np.array([0.0, 0.25]), heading=-0.2)
    n, late = 3200, 4.0
    run = agvjax.simulate(sampled(PathPID()), given, dt=DT, n_steps=n)
    found = agvjax.measure(run, Criteria(late=late)).followed
    arcs = np.linspace(0, float(route.length), 20_000)
    places = jax.jit(jax.vmap(route.at, in_axes=(0, None)))(jnp.asarray(arcs), jnp.zeros(()))
    line = arcs, np.asarray(places.position), np.asarray(places.tangent), np.asarray(places.speed)
    wanted = by_hand(run, line, n * DT, late)
    close = {"cross_track": 2e-3, "cross_track_late": 2e-3, "cross_track_peak": 2e-3, "cross_track_peak_late": 2e-3}
    close |= {"heading_error": 5e-3, "pace": 2e-3, "outside_corridor": 5e-3, "corridor_excess": 5e-3}
    close |= {"lateral_acceleration": 2e-2, "speed_error": 2e-2, "jerk": 1e-2}
    for name, rel in close.items():
        assert float(getattr(found, name)) == pytest.approx(wanted[name], rel=rel), name
    assert float(found.outside_corridor) > 0 and float(found.corridor_excess) > 0.05
    soon, beyond = agvjax.measure(run, Criteria(late=1.0)).followed, by_hand(run, line, n * DT, 1.0)
    assert float(soon.corridor_excess_late) == pytest.approx(beyond["corridor_excess_late"], rel=5e-3)
    assert float(found.corridor_excess) > float(soon.corridor_excess_late) > float(found.corridor_excess_late) == 0
    assert float(found.standstill) == pytest.approx(wanted["standstill"], abs=2 * DT / (n * DT))
    at = np.flatnonzero(float(route.length) - wanted["way"] <= 0.02)
    assert at.size and float(found.time_to_finish) == pytest.approx(float(run.t[at[0]]), abs=2 * DT)
    ended = np.asarray(run.position)[-1]
    assert np.linalg.norm(ended - [5, 3]) < 0.05  # it stays where it arrived
    assert np.linalg.norm(np.asarray(run.velocity)[-1]) < 1e-3 and np.all(np.asarray(run.command)[-1] == 0)


@pytest.mark.slow
def test_a_vehicle_that_is_asked_for_less_than_its_deadzone_stands_and_never_finishes():
    route = Route.corners([[0, 0], [5, 0]], 0.05, radius=1.0)
    given = scenario(route, position=np.array([0.0, 0.0]), heading=0.0)
    law = PathPID(min_approach_linear_velocity=0.01)
    found = agvjax.evaluate(sampled(law), given, dt=DT, n_steps=400).followed
    assert float(found.standstill) == pytest.approx(1.0, abs=0.01)
    assert np.isinf(float(found.time_to_finish)) and np.isinf(float(found.pace))


# ---------------------------------------------------------------------------------------------------------- its branch


@pytest.mark.slow
def test_no_gains_make_a_run_take_the_other_branch_at_the_crossing():
    path = Dumbbell(amplitude=2.0, omega=0.15)
    route = Route.along(path)
    length, count = float(route.length), 56
    random = np.random.default_rng(5)
    along = np.arctan2(1, 2)
    draws = {
        "inner.k_y": random.uniform(3, 10, count),
        "inner.k_psi": random.uniform(2.5, 7, count),
        "inner.k_i": random.uniform(0, 3, count),
        "inner.ahead": random.uniform(0, 0.5, count),
        "inner.regulated_linear_scaling_min_radius": random.uniform(0.2, 1.2, count),
        "inner.regulated_linear_scaling_min_speed": random.uniform(0.15, 0.3, count),
    }
    side = np.where(np.arange(count) % 2, 0.3, -0.3)
    starts = side[:, None] * np.array([-np.sin(along), np.cos(along)])
    headings = along + random.uniform(-0.4, 0.4, count)
    law, given = sampled(PathPID()), scenario(route, position=starts[0], heading=headings[0])
    gains = agvjax.batch(law, draws)
    vehicles = agvjax.batch(given, {"start.position": starts, "start.heading": headings})
    run = jax.vmap(
        functools.partial(agvjax.simulate, dt=0.01, n_steps=8000, save_every=10), in_axes=(gains.axes, vehicles.axes)
    )(gains.scenario, vehicles.scenario)
    assert np.all(np.asarray(run.ok))
    arcs = np.asarray(run.route.arc)
    assert np.all(np.minimum(arcs[:, 0], length - arcs[:, 0]) < 0.4)  # each begins at the crossing
    moves = np.diff(arcs, axis=1)
    moves -= length * np.round(moves / length)
    assert np.abs(moves).max() < 0.4  # in 0.1 s, inside a turn of 0.25 m; between the branches lies half a lap
    progress = np.cumsum(moves, axis=1)
    assert np.all(progress[:, -1] > 1.02 * length)
    assert np.all(np.diff(progress[:, 10:], axis=1) > -1e-6)
    # the vehicle itself is in the upper lobe in the first half of each lap and in the lower one in the second
    half = arcs / length
    y = np.asarray(run.position)[..., 1]
    for low, high, sign in ((0.1, 0.4, 1), (0.6, 0.9, -1)):
        inside = (low < half) & (half < high)
        assert inside.any(axis=1).all() and np.all(np.sign(y[inside]) == sign)
    # and passes the crossing, halfway, from the upper to the lower lobe to the left below, and comes back from there
    crossing = np.abs(arcs - length / 2) < 0.5
    heading = np.asarray(run.heading)[crossing]
    assert np.all(np.cos(heading - np.arctan2(-1, 2)) > 0.5) and crossing.any(axis=1).all()
