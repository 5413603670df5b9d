"""Routes: laid by arc length, followed by the nearest point, searched, run by a clock; what none can be made of."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import minimize_scalar

import agvjax
from agvjax import Circle, Dumbbell, Lemniscate, Route, SpeedLimits, Waypoints

BENT = np.array([[0.0, 0.0], [1.0, 0.2], [1.8, 1.0], [1.5, 2.4], [0.2, 2.9]])


def array(x):
    return jnp.asarray(x, float)


@jax.jit
def looked(route, arcs, legs):
    """The route at arc lengths of legs."""
    return jax.vmap(route.at)(arcs, legs)


def at(route, arcs, leg=0):
    arcs = array(arcs)
    return looked(route, arcs, jnp.broadcast_to(array(leg), arcs.shape))


@jax.jit
def clocked(route, times):
    return jax.vmap(route)(times), jax.vmap(route.bearing)(times)


@jax.jit
def driven(route, first, positions, velocities, h):
    """The places of a vehicle at positions (N, 2) in a row."""

    def step(place, now):
        place = route.follow(now[0], place, now[1], h)
        return place, place

    return jax.lax.scan(step, first, (positions, velocities))[1]


def drive(route, positions, h=0.05, arc=0.0):
    """The same from an arc length of the first leg on."""
    positions = array(positions)
    velocities = jnp.gradient(positions, axis=0) / h
    return driven(route, route.at(array(arc), array(0.0)), positions, velocities, array(h))


clock = jax.jit(lambda route, times: jax.vmap(route.clock)(times))
searched = jax.jit(lambda route, position, heading: route.search(position, heading))


# --------------------------------------------------------------------------------------------- by hand: known curves


class Known:
    """A curve p(u) with its two derivatives, by arc length from u = 0 by quadrature."""

    def __init__(self, p, end):
        self.p, self.end = p, end
        self.u = np.linspace(0, end, 801)
        parts = [quad(self.pace, a, b, epsabs=1e-14)[0] for a, b in zip(self.u[:-1], self.u[1:], strict=True)]
        self.arc = np.r_[0, np.cumsum(parts)]

    def pace(self, u):
        return float(np.linalg.norm(self.p(u)[1]))

    def length_to(self, u):
        k = min(int(u / self.u[1]), 799)
        return self.arc[k] + quad(self.pace, self.u[k], u, epsabs=1e-14)[0]

    def tangent(self, u):
        d = self.p(u)[1]
        return d / np.linalg.norm(d)

    def curvature(self, u):
        _, d, dd = self.p(u)
        return (d[0] * dd[1] - d[1] * dd[0]) / np.linalg.norm(d) ** 3


def _dumbbell(u):
    s, c, ss, cc = np.sin(u), np.cos(u), np.sin(2 * u), np.cos(2 * u)
    return np.array([ss, s]), np.array([2 * cc, c]), np.array([-4 * ss, -s])


def _circle(u):
    s, c = np.sin(u), np.cos(u)
    return 2.0 * np.array([c, s]), 2.0 * np.array([-s, c]), -2.0 * np.array([c, s])


def _lemniscate(u):  # x = cos / (1 + sin^2), y = x sin
    s, c = np.sin(u), np.cos(u)
    q, dq, ddq = 1 + s * s, 2 * s * c, 2 * (c * c - s * s)
    x, dx = c / q, -s / q - c * dq / q**2
    ddx = -c / q + 2 * s * dq / q**2 - c * ddq / q**2 + 2 * c * dq**2 / q**3
    return np.array([x, x * s]), np.array([dx, dx * s + x * c]), np.array([ddx, ddx * s + 2 * dx * c - x * s])


KNOWN = {
    "dumbbell": (Dumbbell(), _dumbbell),
    "circle": (Circle(radius=2.0), _circle),
    "lemniscate": (Lemniscate(), _lemniscate),
}


@pytest.fixture(scope="module", params=list(KNOWN))
def known(request):
    path, p = KNOWN[request.param]
    return request.param, path, Route.along(path), Known(p, 2 * np.pi)


def test_a_curve_by_its_arc_length_has_the_place_tangent_and_curvature_of_its_formula(known):
    name, path, route, curve = known
    u = np.linspace(0.013, 2 * np.pi - 0.013, 97)
    arcs = [curve.length_to(x) for x in u]
    found = at(route, arcs)
    np.testing.assert_allclose(route.length, curve.arc[-1], rtol=1e-11)
    np.testing.assert_allclose(found.position, [curve.p(x)[0] for x in u], atol=1e-8)
    np.testing.assert_allclose(found.tangent, [curve.tangent(x) for x in u], atol=1e-6)
    curvature = np.array([curve.curvature(x) for x in u])
    np.testing.assert_allclose(found.curvature, curvature, atol=1e-4 * np.abs(curvature).max())
    omega = float(path.omega)
    np.testing.assert_allclose(found.speed, [omega * curve.pace(x) for x in u], rtol=3e-4)
    headings = jax.vmap(lambda place: place.heading())(found)
    np.testing.assert_allclose(headings, [np.arctan2(*curve.tangent(x)[::-1]) for x in u], atol=1e-6)
    assert np.all(np.isinf(found.remaining)) and np.all(np.asarray(found.sign) == 1)


def test_lengths_that_have_a_closed_form():
    assert float(Route.along(Circle(radius=2.0)).length) == pytest.approx(4 * np.pi, rel=1e-13)
    lemniscate = 5.244115108584239620929679  # 2 x the lemniscate constant, of half-width 1
    assert float(Route.along(Lemniscate()).length) == pytest.approx(lemniscate, rel=1e-12)
    np.testing.assert_allclose(at(Route.along(Circle(radius=2.0)), np.linspace(0, 12, 50)).curvature, 0.5, rtol=1e-6)


def test_the_clock_of_a_closed_route_is_that_of_its_path_lap_after_lap(known):
    name, path, route, curve = known
    lap = 2 * np.pi / float(path.omega)
    assert route.lap() == pytest.approx(lap, rel=2e-5) and route.end() == np.inf
    times = np.linspace(0, 2.2 * lap, 113)
    positions, headings = clocked(route, array(times * route.lap() / lap))
    wanted = np.array([curve.p(x % (2 * np.pi))[0] for x in float(path.omega) * times])
    np.testing.assert_allclose(positions, wanted, atol=2e-4)
    tangents = np.array([curve.tangent(x % (2 * np.pi)) for x in float(path.omega) * times])
    np.testing.assert_allclose(np.cos(headings), tangents[:, 0], atol=1e-3)
    np.testing.assert_allclose(np.sin(headings), tangents[:, 1], atol=1e-3)


@pytest.mark.parametrize("closed", [False, True])
def test_a_path_through_points_has_the_same_curve_by_time_and_by_arc_length(closed):
    speeds = [0.5, 1.0, 2.0, 1.0, 0.7]
    path = Waypoints.through(BENT, speeds, closed)
    for route in (Route.along(path), Route.through(BENT, speeds, closed=closed, limits=SpeedLimits(stop=False))):
        shape = path.geometry(300)
        found = at(route, shape.arc[1:-1])
        np.testing.assert_allclose(route.length, shape.arc[-1], rtol=1e-7)
        np.testing.assert_allclose(found.position, shape.position[1:-1], atol=1e-6)
        np.testing.assert_allclose(found.curvature, shape.curvature[1:-1], atol=2e-3)
        np.testing.assert_allclose(found.speed, shape.speed[1:-1], rtol=1e-3)
        assert route.closed == closed


# ------------------------------------------------------------------------------------------------------------ corners


class Lined:
    """Lines and arcs by arc length: (length, curvature) in a row from a pose; by complex numbers."""

    def __init__(self, start, heading, parts):
        self.parts, self.begins = parts, [(complex(*start), heading, 0.0)]
        for length, curvature in parts:
            p, a, s = self.begins[-1]
            self.begins.append((self._go(p, a, curvature, length), a + curvature * length, s + length))
        self.length = self.begins[-1][2]

    @staticmethod
    def _go(p, a, curvature, way):
        if curvature == 0:
            return p + way * np.exp(1j * a)
        return p + 1j / curvature * (np.exp(1j * a) - np.exp(1j * (a + curvature * way)))

    def __call__(self, s):
        k = min(int(np.searchsorted([b[2] for b in self.begins], s, "right")) - 1, len(self.parts) - 1)
        p, a, begin = self.begins[k]
        place = self._go(p, a, self.parts[k][1], s - begin)
        return np.array([place.real, place.imag]), a + self.parts[k][1] * (s - begin)


def agrees(route, lined, off=1.2e-5):
    """Whether a route is these lines and arcs, its curvature looked at but where it jumps."""
    assert float(route.length) == pytest.approx(lined.length, abs=1e-9)
    s = np.linspace(0, lined.length, 4001)[1:-1]
    found = at(route, s)
    wanted = [lined(x) for x in s]
    np.testing.assert_allclose(found.position, np.array([p for p, _ in wanted]), atol=off)
    h = lined.length / route.squares.shape[1]
    marks = np.array([b[2] for b in lined.begins])
    away = np.abs(s[:, None] - marks).min(axis=1) > 1.01 * h
    curvature = np.array([lined.parts[np.searchsorted(marks, x, "right") - 1][1] for x in s])
    np.testing.assert_allclose(np.asarray(found.curvature)[away], curvature[away], rtol=2e-4, atol=1e-6)
    angles = np.array([a for _, a in wanted])[away]
    np.testing.assert_allclose(np.asarray(found.tangent)[away], np.c_[np.cos(angles), np.sin(angles)], atol=1e-5)


def test_a_square_corner_with_a_radius():
    route = Route.corners([[0, 0], [3, 0], [3, 2]], 0.5, radius=0.5)
    agrees(route, Lined((0, 0), 0.0, [(2.5, 0.0), (0.25 * np.pi, 2.0), (1.5, 0.0)]))
    places = at(route, np.linspace(0, float(route.length), 20001))
    nearest = np.linalg.norm(np.asarray(places.position) - [3, 0], axis=1).min()
    assert nearest == pytest.approx(0.5 * (np.sqrt(2) - 1), abs=2e-5)
    np.testing.assert_allclose(places.position[-1], [3, 2], atol=1e-12)


@pytest.mark.parametrize("turn", [30, -75, 90, -120, 160])
def test_an_oblique_corner_is_passed_at_the_tolerance_or_as_near_as_its_lines_allow(turn):
    angle = np.radians(turn)
    points = np.array([[0, 0], [3, 0], [3 + 2 * np.cos(angle), 2 * np.sin(angle)]])
    for tolerance in (0.01, 0.05, 5.0):
        route = Route.corners(points, tolerance=tolerance)
        half = abs(angle) / 2
        radius = min(
            tolerance / (1 / np.cos(half) - 1), 2 / np.tan(half)
        )  # one corner may have all of the shorter line
        taken = radius * np.tan(half)
        parts = [(3 - taken, 0.0), (radius * abs(angle), np.sign(angle) / radius)]
        agrees(route, Lined((0, 0), 0.0, [*parts, (2 - taken, 0.0)] if taken < 2 - 1e-9 else parts))


def test_two_corners_share_the_line_between_them_and_closed_ways_come_back():
    route = Route.corners([[0, 0], [3, 0], [3, 1], [0, 1]], tolerance=5.0)  # a U: each may have half of 1 m
    agrees(route, Lined((0, 0), 0.0, [(2.5, 0.0), (np.pi * 0.5, 2.0), (2.5, 0.0)]))
    points = [[1, 0], [10, 0], [10, 5], [0, 5], [0, 0]]
    route = Route.corners(points, 0.8, radius=1.0, closed=True)  # begun within its first side
    quarter = (np.pi / 2, 1.0)
    around = [(8.0, 0.0), quarter, (3.0, 0.0), quarter, (8.0, 0.0), quarter, (3.0, 0.0), quarter]
    agrees(route, Lined((1, 0), 0.0, around))
    assert route.lap() == pytest.approx((22 + 2 * np.pi) / 0.8, rel=1e-9)
    clockwise = Route.corners([[0, 0], [0, 2], [3, 2]], 0.8, radius=0.3, closed=True)  # its first corner comes last
    first = np.pi - np.arctan2(3, 2)  # turn at (0, 0), from the way back (heading from (3, 2)) to the way up
    third = np.pi - np.arctan2(2, 3)
    a, c = sharp_taken(first), sharp_taken(third)
    around = [(2 - a - 0.3, 0.0), (0.3 * np.pi / 2, -1 / 0.3), (3 - 0.3 - c, 0.0), (0.3 * third, -1 / 0.3)]
    around += [(np.hypot(2, 3) - a - c, 0.0), (0.3 * first, -1 / 0.3)]
    agrees(clockwise, Lined((0, a), np.pi / 2, around))


def sharp_taken(turn, radius=0.3):
    return radius * np.tan(turn / 2)


# --------------------------------------------------------------------------------------------------- the nearest point


def brute(curve, position, near, reach=0.25):
    """Where within `reach` [m] of an arc length a curve is nearest: on a fine grid, and refined between its points."""
    grid = near + np.linspace(-reach, reach, 201)
    k = int(np.argmin(np.sum((curve(grid) - position) ** 2, axis=-1)))
    found = minimize_scalar(
        lambda s: np.sum((curve(s) - position) ** 2),
        bounds=(grid[max(k - 1, 0)], grid[min(k + 1, 200)]),
        method="bounded",
        options={"xatol": 1e-10},
    )
    return found.x


def quintic(route, leg=0):
    """A leg of a route looked up with NumPy: its own table, and nothing else of it."""
    begin, pace, first, _, _ = np.asarray(route.legs)[:, leg]
    count = int(np.asarray(route.legs)[2, leg + 1]) - int(first) if leg + 1 < route.legs.shape[1] else None
    table = np.asarray(route.table)[:, int(first) :][:, :count]
    n = table.shape[1]

    def place(s):
        x = (np.asarray(s) - begin) * pace
        x = x % n if route.closed else np.clip(x, 0, n)
        k = np.minimum(x.astype(int), n - 1)
        return np.stack([sum(table[row + i, k] * (x - k) ** i for i in range(6)) for row in (0, 6)], axis=-1)

    return place


def beside(route, arcs, aside):
    """Positions at a distance to the left of places of a route: their nearest points, where that is within the tube."""
    found = at(route, arcs)
    left = np.c_[-np.asarray(found.tangent)[:, 1], np.asarray(found.tangent)[:, 0]]
    return np.asarray(found.position) + np.asarray(aside)[:, None] * left


@pytest.mark.parametrize("name", ["dumbbell", "lemniscate", "circle"])
def test_the_nearest_point_is_that_of_a_search_along_the_whole_drive_and_over_the_seam(name):
    path, p = KNOWN[name]
    route = Route.along(path)
    length = float(route.length)
    arcs = np.arange(0, 2.3 * length, 0.03)  # two laps and more, 3 cm in each step
    tight = float(np.abs(at(route, np.linspace(0, length, 2000)).curvature).max())
    aside = 0.5 / tight * np.sin(1.7 * arcs) * np.cos(0.31 * arcs)
    positions = beside(route, arcs % length, aside)
    found = drive(route, positions)
    assert np.all((np.asarray(found.arc) >= 0) & (np.asarray(found.arc) < length))
    off = np.asarray(found.arc) - arcs
    np.testing.assert_allclose(off - length * np.round(off / length), 0, atol=1e-6)  # its foot is known, by hand
    for k in range(1, len(arcs), 23):  # and by a search
        place = brute(quintic(route), positions[k], arcs[k] % length)
        assert abs((float(found.arc[k]) - place + length / 2) % length - length / 2) < 1e-6
    np.testing.assert_allclose(jax.vmap(lambda place, x: place.across(x))(found, array(positions)), aside, atol=1e-8)


@pytest.mark.parametrize("offset", [-0.2, 0.0, 0.2])
def test_a_hairpin_is_followed_round_and_to_its_open_end(offset):
    route = Route.corners([[0, 0], [5, 0], [5, 0.6], [0, 0.6]], radius=0.3)
    length = float(route.length)
    assert length == pytest.approx(2 * 4.7 + 0.3 * np.pi, abs=1e-9)
    arcs = np.arange(0, length, 0.02)
    positions = beside(route, arcs, offset * np.ones_like(arcs))
    found = drive(route, positions)
    curve = quintic(route)
    for k in range(1, len(arcs), 11):
        assert float(found.arc[k]) == pytest.approx(brute(curve, positions[k], arcs[k]), abs=1e-6)
    lined = Lined((0, 0), 0.0, [(4.7, 0.0), (0.3 * np.pi, 1 / 0.3), (4.7, 0.0)])

    def ideal(s):
        return np.array([lined(min(max(x, 0), length))[0] for x in np.atleast_1d(s)])

    feet = [brute(ideal, positions[k], arcs[k]) for k in range(1, len(arcs), 40)]
    np.testing.assert_allclose(found.arc[1::40], feet, atol=2e-4)  # of lines and arcs: 1e-5 m off, at a radius of 0.1
    # beyond the end, and before the beginning, it stays there
    beyond = np.c_[np.linspace(0.2, -0.8, 50), np.full(50, 0.65)]
    after = drive(route, beyond, arc=length - 0.2)
    np.testing.assert_allclose(after.arc, np.minimum(length - beyond[:, 0], length), atol=1e-6)
    assert bool(route.arrived(jax.tree.map(lambda x: x[-1], after)))
    before = drive(route, np.c_[np.linspace(0.2, -0.8, 50), np.full(50, 0.1)], arc=0.2)
    np.testing.assert_allclose(before.arc, np.maximum(np.linspace(0.2, -0.8, 50), 0), atol=1e-6)


@pytest.fixture(scope="module")
def long_route():
    angle = 2 * np.pi * np.arange(10_000) / 10_000
    radius = 300 * (1 + 0.2 * np.sin(3 * angle) + 0.02 * np.cos(40 * angle))
    return Route.through(radius[:, None] * np.c_[np.cos(angle), np.sin(angle)], 1.0, closed=True)


def test_the_nearest_point_on_a_way_through_ten_thousand_points(long_route):
    length = float(long_route.length)
    arcs = np.concatenate([np.arange(length - 20, length + 20, 0.04), np.arange(700, 740, 0.04)])
    for part in np.split(arcs, 2):
        aside = 0.4 * np.sin(part)
        positions = beside(long_route, part % length, aside)
        found = drive(long_route, positions, arc=part[0])
        off = np.asarray(found.arc) - part
        np.testing.assert_allclose(off - length * np.round(off / length), 0, atol=1e-6)
        for k in range(1, len(part), 97):
            place = brute(quintic(long_route), positions[k], part[k])
            assert abs((float(found.arc[k]) - place + length / 2) % length - length / 2) < 1e-6


def test_a_branch_that_is_crossed_is_not_taken_however_the_vehicle_stands_or_moves():
    route = Route.along(Dumbbell())
    length = float(route.length)
    half = length / 2  # where it crosses itself
    for start in (0.0, half):
        arcs = start + np.linspace(-0.6, 0.6, 61)
        for aside in (-0.3, -0.1, 0.1, 0.3):
            found = drive(route, beside(route, arcs % length, aside * np.ones(61)), arc=arcs[0])
            off = np.asarray(found.arc) - arcs
            np.testing.assert_allclose(off - length * np.round(off / length), 0, atol=1e-6)
    still = np.tile([0.0, 0.1], (200, 1))  # stands beside the crossing
    place = route.at(array(0.1), array(0.0))
    found = driven(route, place, array(still), array(np.zeros((200, 2))), array(0.05))
    assert float(found.arc[-1]) == pytest.approx(brute(quintic(route), still[0], 0.1), abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("arc", [0.05, 1.1, 2.0, 4.0])
def test_the_slopes_of_the_nearest_point_agree_with_differences_and_with_geometry(arc):
    route = Route.along(Dumbbell())
    before = route.at(array(arc - 0.03), array(0.0))
    here = route.at(array(arc), array(0.0))
    tangent, curvature = np.asarray(here.tangent), float(here.curvature)
    aside = 0.3 / max(abs(curvature), 1.0)
    position = array(np.asarray(here.position) + aside * np.array([-tangent[1], tangent[0]]))

    @jax.jit
    def foot(route, before, position):
        return route.follow(position, before, array([0.5, 0.3]), array(0.05)).arc

    slopes = jax.jit(jax.jacfwd(foot, argnums=2))(route, before, position)
    back = jax.jit(jax.jacrev(foot, argnums=2))(route, before, position)
    np.testing.assert_allclose(slopes, tangent / (1 - curvature * aside), atol=1e-4)
    np.testing.assert_allclose(back, slopes, atol=1e-12)
    steps = 1e-5 * np.eye(2)
    far = [foot(route, before, position + d) - foot(route, before, position - d) for d in array(steps)]
    np.testing.assert_allclose(slopes, np.array(far) / 2e-5, atol=1e-4)


def test_in_single_precision_it_is_off_by_rounding():
    route = Route.along(Dumbbell())
    single = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), route)
    length = float(route.length)
    arcs = np.arange(0, 1.5 * length, 0.03)
    positions = beside(route, arcs % length, 0.1 * np.sin(3 * arcs))
    velocities = np.gradient(positions, axis=0) / 0.05
    first = jax.tree.map(lambda x: x.astype(jnp.float32), route.at(array(0.0), array(0.0)))
    found = driven(single, first, *(jnp.asarray(x, jnp.float32) for x in (positions, velocities, 0.05)))
    assert found.arc.dtype == jnp.float32 and found.position.dtype == jnp.float32
    off = np.asarray(found.arc, float) - arcs
    np.testing.assert_allclose(off - length * np.round(off / length), 0, atol=2e-5)


# ----------------------------------------------------------------------------------------------------------- the start


def test_beside_the_crossing_it_starts_on_the_branch_that_it_looks_along():
    path = Dumbbell()
    route = Route.along(path)
    length = float(route.length)
    along = np.arctan2(1, 2)
    for side in (-0.3, -0.15, 0.15, 0.3):
        for error in np.linspace(-0.4, 0.4, 17):
            position = side * np.array([-np.sin(along), np.cos(along)])
            place = searched(route, array(position), array(along + error))
            arc = float(place.arc)
            assert min(arc, length - arc) < 0.35, (side, error)
            off = arc - brute(quintic(route), position, 0.0)
            assert abs(off - length * round(off / length)) < 1e-6


def test_far_from_the_route_it_finds_the_nearest_place():
    route = Route.along(Circle(radius=2.0))
    for angle in np.linspace(0.1, 6.2, 9):
        outside = 40 * np.array([np.cos(angle), np.sin(angle)])
        place = searched(route, array(outside), array(angle + np.pi / 2))
        assert float(place.arc) == pytest.approx(2 * angle, abs=1e-6)
    bent = Route.through(BENT, 1.0)
    for position in ([30.0, 1.0], [-20.0, -5.0], [3.0, 40.0]):
        grid = np.linspace(0, float(bent.length), 20001)
        away = np.linalg.norm(np.asarray(at(bent, grid).position) - position, axis=1)
        found = float(np.linalg.norm(searched(bent, array(position), array(0.4)).position - array(position)))
        assert found == pytest.approx(away.min(), abs=0.05)  # of two places that are as near the way it looks decides


# -------------------------------------------------------------------------------------------------------- several legs

TURNING = [[0, 0, 0.8], [1, 0, 0.8], [2, 0, -0.4], [1, 0.3, -0.4], [0, 1, -0.4]]


def test_where_the_sign_changes_a_leg_ends_and_the_next_is_driven_backwards():
    route = Route.through(TURNING)
    assert np.asarray(route.legs)[3].tolist() == [1, -1] and np.asarray(route.legs)[0].tolist() == [0, 2]
    arcs = np.arange(0, 1.96, 0.03)
    forward = drive(route, beside(route, arcs, 0.05 * np.sin(arcs)))
    np.testing.assert_allclose(forward.arc, arcs, atol=1e-6)
    assert np.all(np.asarray(forward.leg) == 0) and np.all(np.asarray(forward.sign) == 1)
    np.testing.assert_allclose(forward.remaining, 2 - arcs, atol=1e-6)
    last = jax.tree.map(lambda x: x[-1], forward)
    follow = jax.jit(route.follow)
    near = follow(array([1.975, 0.01]), last, array([0.1, 0.0]), array(0.05))  # 25 mm left: not yet
    assert float(near.leg) == 0
    over = follow(array([1.985, 0.01]), near, array([0.1, 0.0]), array(0.05))
    assert (float(over.leg), float(over.arc), float(over.sign)) == (1, 2, -1)
    np.testing.assert_allclose(over.position, [2, 0], atol=1e-12)
    # it travels to the left and looks to the right; a heading that is turned to the left is so by the same angle
    tangent = np.asarray(over.tangent)
    assert tangent[0] < 0
    heading = np.arctan2(-tangent[1], -tangent[0])
    assert float(over.heading()) == pytest.approx(heading) and abs(heading) < 0.6
    assert float(over.heading_error(array(heading + 0.1))) == pytest.approx(0.1)
    arcs = np.arange(2.0, float(route.length), 0.03)
    back = beside_leg(route, arcs, 1)
    velocities = jnp.gradient(array(back), axis=0) / 0.05
    found = driven(route, over, array(back), velocities, array(0.05))
    np.testing.assert_allclose(found.arc, arcs, atol=1e-6)
    for k in range(1, len(arcs), 7):
        assert float(found.arc[k]) == pytest.approx(brute(quintic(route, 1), back[k], arcs[k]), abs=1e-6)
    assert not np.asarray(jax.vmap(route.arrived)(found))[:-1].any()


def beside_leg(route, arcs, leg):
    found = at(route, arcs, leg)
    left = np.c_[-np.asarray(found.tangent)[:, 1], np.asarray(found.tangent)[:, 0]]
    return np.asarray(found.position) + 0.05 * np.sin(3 * (arcs - arcs[0]))[:, None] * left


def test_lines_that_turn_back_are_legs_too():
    route = Route.corners([[0, 0], [2, 0], [0, 0.1]], [0.5, -0.3, -0.3], radius=0.3)
    begins, _, _, signs, _ = np.asarray(route.legs)
    assert signs.tolist() == [1, -1] and begins.tolist() == [0, 2]
    assert float(route.length) == pytest.approx(2 + np.hypot(2, 0.1))
    first, second = at(route, [1.0], 0), at(route, [3.0], 1)
    assert float(first.speed[0]) == 0.5 and float(second.speed[0]) == 0.3  # without limits of acceleration
    np.testing.assert_allclose(second.tangent[0], np.array([-2, 0.1]) / np.hypot(2, 0.1), atol=1e-12)
    np.testing.assert_allclose(second.position[0], [2 - 2 / np.hypot(2, 0.1), 0.1 / np.hypot(2, 0.1)], atol=1e-9)


# ----------------------------------------------------------------------------------------------------------- the clock


def test_by_the_clock_a_vehicle_stops_at_the_end_as_its_deceleration_says():
    limits = SpeedLimits(deceleration=0.4)
    route = Route.corners([[0, 0], [10, 0]], 1.0, radius=1.0, limits=limits)  # 64 pieces: 1.25 m to stop are 8 of them
    assert route.lap() is None and route.end() == pytest.approx(8.75 + 2.5, rel=1e-12)
    t = np.array([0.0, 3.0, 8.75, 9.5, 10.25, 11.25, 20.0])
    after = np.clip(t - 8.75, 0, 2.5)
    positions, headings = clocked(route, array(t))
    np.testing.assert_allclose(positions[:, 0], np.minimum(t, 8.75) + after - 0.2 * after**2, atol=1e-9)
    np.testing.assert_allclose(headings, 0, atol=1e-12)


def test_by_the_clock_a_vehicle_moves_as_the_profile_says_by_an_independent_integration():
    limits = SpeedLimits(acceleration=0.5, deceleration=0.4, lateral_acceleration=0.3, stop=False)
    route = Route.through(BENT, [0.5, 1.0, 2.0, 1.0, 0.7], limits=limits)
    knots = np.linspace(0, float(route.length), route.squares.shape[1] + 1)
    low, change = np.asarray(route.squares)
    squares = np.r_[low, low[-1] + change[-1]]

    def speed(t, s):
        return np.sqrt(np.interp(s, knots, squares))

    end = route.end()
    run = solve_ivp(speed, (0, end), [0.0], rtol=1e-10, atol=1e-12, max_step=0.01, dense_output=True)
    t = np.linspace(0, end, 77)
    np.testing.assert_allclose(clock(route, array(t))[0], run.sol(t)[0], atol=1e-6)


def test_by_the_clock_a_cusp_is_a_stop_and_the_second_leg_looks_ahead():
    route = Route.through(TURNING, limits=SpeedLimits(acceleration=0.4, deceleration=0.4))
    headings = np.asarray(clocked(route, array(np.linspace(0, route.end(), 200)))[1])
    assert np.abs(headings).max() < 1.2  # it never looks back
    legs = np.asarray(clock(route, array(np.linspace(0, route.end(), 200)))[1])
    assert legs[0] == 0 and legs[-1] == 1 and np.all(np.diff(legs) >= 0)
    ahead = route.ahead_of_clock(array(1.0), array(1.5))
    assert float(ahead) == -0.5
    lap = Route.along(Circle(radius=1.0))
    assert float(lap.ahead_of_clock(array(0.1), array(2 * np.pi - 0.1))) == pytest.approx(0.2, abs=1e-12)


# ------------------------------------------------------------------------------------------ what no route is made of

SQUARE = [[0, 0], [2, 0], [2, 2], [0, 2]]
BAD = {
    "one point": (lambda: Route.through([[0, 0]]), r"points must be at least 2 .* given 1"),
    "one corner": (lambda: Route.corners([[0, 0]], radius=0.1), r"points must be at least 2 .* given 1"),
    "equal points": (lambda: Route.through([[0, 0], [1, 0], [1, 0], [2, 0]]), r"points must differ .* 2 and number 3"),
    "equal corners": (
        lambda: Route.corners([[0, 0], [1, 0], [1, 0], [2, 1]], radius=0.1),
        r"points must differ .* 2 and number 3 are equal",
    ),
    "first corner again": (
        lambda: Route.corners([*SQUARE, [0, 0]], radius=0.1, closed=True),
        r"points must differ .* 5 and number 1 are equal; a closed path needs no repetition",
    ),
    "NaN": (lambda: Route.through([[0, 0], [1, np.nan], [2, 0]]), "points must be finite; number 2 is not"),
    "NaN corner": (lambda: Route.corners([[0, 0], [1, np.nan]], radius=1.0), "points must be finite; number 2"),
    "speed 0": (lambda: Route.through(BENT, 0.0), "speed must not be 0; it is 0"),
    "one speed 0": (lambda: Route.through(BENT, [0, 1, 1, 1, 1]), "speed must not be 0 at the first"),
    "negative half width": (lambda: Route.through(BENT, half_width=-0.1), r"half_width must be .* >= 0; got -0.1"),
    "half width NaN": (lambda: Route.through(BENT, half_width=np.nan), "half_width must be finite .* got nan"),
    "half widths": (lambda: Route.along(Circle(), half_width=np.ones((3, 2))), r"half_width must be .* \(3, 2\)"),
    "two signs": (lambda: Route.through(SQUARE, [1, 1, -1, 1], closed=True), "speed must have one sign on a closed"),
    "sign at the end": (
        lambda: Route.through([[0, 0], [1, 0], [2, 0]], [1, 1, -1]),
        "speed must not .* last point.*-1",
    ),
    "a turn that is none": (
        lambda: Route.corners([[0, 0], [2, 0], [2, 2]], [1, -1, -1], radius=0.1),
        r"speed must change its sign only where .*; not at point number 2 \(2, 0\)",
    ),
    "a turn that keeps the sign": (
        lambda: Route.corners([[0, 0], [2, 0], [2, 2], [2, 0]], 1.0, radius=0.1),
        r"speed must change its sign where .*; it keeps it at point number 3 \(2, 2\)",
    ),
    "a radius too large": (
        lambda: Route.corners([[0, 0], [1, 0], [1, 1]], radius=2.0),
        r"radius must leave room .* 2 m takes 2 m of the 1 m from point number 1",
    ),
    "two radii too large": (
        lambda: Route.corners([[0, 0], [3, 0], [3, 1], [0, 1]], radius=0.6),
        r"radius must leave room .* 0.6 m takes 1.2 m of the 1 m from point number 2",
    ),
    "both": (lambda: Route.corners(SQUARE, radius=0.1, tolerance=0.1), "one of radius and tolerance .* 0.1 and 0.1"),
    "neither": (lambda: Route.corners(SQUARE), "one of radius and tolerance must be given; got None and None"),
    "radius 0": (lambda: Route.corners(SQUARE, radius=0.0), "radius must be finite and > 0; got 0.0"),
    "tolerance": (lambda: Route.corners(SQUARE, tolerance=-1.0), "tolerance must be finite and > 0; got -1.0"),
    "no end": (lambda: Route.along(agvjax.Line()), "until must be given, finite and > 0"),
    "stands": (lambda: Route.along(agvjax.Line(velocity=np.zeros(2)), until=3.0), "the path must move; at t = "),
    "closed and back": (
        lambda: Route.corners([[0, 0], [2, 0], [0, 0.01]], radius=0.1, closed=True),
        "points of a closed route must not turn back",
    ),
}


@pytest.mark.parametrize("make, message", BAD.values(), ids=BAD)
def test_what_no_route_can_be_made_of_is_refused_by_its_value_and_the_rule(make, message):
    with pytest.raises(ValueError, match=message):
        make()
