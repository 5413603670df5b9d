"""Regulated pure pursuit against what Nav2's own source answers, see tests/data/rpp/README.md.

Nav2's paths are polylines, ours are laid along the same lines with corners rounded by 10 um and pieces that are up to
10 um off. What the law does not do is left out: turning in place, a curvature carrot of its own, a local map that cuts
the path off.
"""

import dataclasses
import functools
import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from agvjax import Base, Measurement, RegulatedPurePursuit, Route, Sampled, SpeedLimits

DATA = json.loads((Path(__file__).parents[2] / "data" / "rpp" / "vectors.json").read_text())
NAMES = {f.name for f in dataclasses.fields(RegulatedPurePursuit)}
OFF = 1e-4  # m, of the carrot: rounding and pieces, each 1e-5, seen at an angle
ON_SPOT = ("turn on the spot", "one pose")


def law(case):
    given = {name: value for name, value in case["parameters"].items() if name in NAMES}
    return RegulatedPurePursuit(max_angular_velocity=100.0, **given)  # Jazzy clips no yaw rate


def steps(keep):
    """Cases and their steps."""
    return [
        (case, step)
        for case in DATA["cases"]
        for step in case["steps"]
        if "refused" not in step and case.get("costmap_size", 200.0) == 200.0 and keep(case, step)
    ]


def points(name):
    return np.array(DATA["paths"][name])[:, :2]


def last_in_view(case, step):
    """The last pose that was kept, in the robot's frame, and how long the way to it is from the first one kept."""
    x, y, yaw = step["pose"]
    kept = points(case["path"])[step["nearest"] : step["nearest"] + step["poses"]]
    away = kept[-1] - [x, y]
    return np.linalg.norm(away), float(np.sum(np.linalg.norm(np.diff(kept, axis=0), axis=1)))


@functools.cache
def route(name, sign=1.0):
    return Route.corners(points(name), sign * 100.0, tolerance=1e-5)


def foot(name, step):
    """Where along the lines the nearest point is, from the pose on that Nav2 kept first and the one before it."""
    line = points(name)
    marks = np.r_[0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))]
    best, found = np.inf, 0.0
    for j in range(max(step["nearest"] - 1, 0), min(step["nearest"] + 1, len(line) - 1)):
        d = line[j + 1] - line[j]
        share = np.clip((np.array(step["pose"][:2]) - line[j]) @ d / (d @ d), 0, 1)
        away = np.linalg.norm(line[j] + share * d - step["pose"][:2])
        if away < best:
            best, found = away, marks[j] + share * (marks[j + 1] - marks[j])
    return found


def steepness(name, step):
    """Cosine of the angle between the view to Nav2's carrot and the path there; 1 where it is the last pose."""
    line, (x, y, yaw) = points(name), step["pose"]
    away = step["carrot"][0] * np.array([np.cos(yaw), np.sin(yaw)]) + step["carrot"][1] * np.array(
        [-np.sin(yaw), np.cos(yaw)]
    )
    carrot, last = np.array([x, y]) + away, line[step["nearest"] + step["poses"] - 1]
    if np.linalg.norm(carrot - last) < 1e-6:
        return 1.0
    d = np.diff(line, axis=0)
    share = np.clip(np.sum((carrot - line[:-1]) * d, axis=1) / np.sum(d * d, axis=1), 0, 1)
    off = np.linalg.norm(line[:-1] + share[:, None] * d - carrot, axis=1)
    off[: max(step["nearest"] - 1, 0)] = np.inf
    k = int(np.argmin(off))
    return float(d[k] @ away / np.linalg.norm(d[k]) / np.linalg.norm(away))


# --------------------------------------------------------------------------------------------------------- in pieces


def test_the_look_ahead():
    some = steps(lambda case, step: not case["parameters"].get("allow_reversing"))
    assert len(some) > 200
    found = [float(law(case).look_ahead(jnp.asarray(step["speed"][0]))) for case, step in some]
    np.testing.assert_allclose(found, [step["lookahead"] for _, step in some], rtol=1e-9)


def test_a_least_look_ahead_above_the_largest_is_written_as_that_and_changes_nothing():
    crossed = RegulatedPurePursuit(min_lookahead_dist=3.1, max_lookahead_dist=0.32)
    assert crossed.canonical() is crossed  # it does not count
    crossed = dataclasses.replace(crossed, use_velocity_scaled_lookahead_dist=True)
    found = Sampled(inner=crossed, vehicle=Base(), period=0.05).canonical().inner
    assert float(found.min_lookahead_dist) == pytest.approx(0.32) and float(found.max_lookahead_dist) == 0.32
    for speed in (0.0, 0.1, 1.0, 5.0):
        assert float(found.look_ahead(jnp.asarray(speed))) == float(crossed.look_ahead(jnp.asarray(speed)))
    usual = dataclasses.replace(crossed, min_lookahead_dist=0.1)
    assert float(usual.canonical().min_lookahead_dist) == pytest.approx(0.1)


def along(case):
    """Whether the path is driven one way, without a cusp."""
    return case["path"] not in (*ON_SPOT, "cusp") and not case["parameters"].get("allow_reversing")


@jax.jit
def carrots(pursuit, way, arcs, positions, looks):
    def one(arc, position, look):
        return pursuit.carrot(way.at(arc, jnp.zeros_like(arc)), way, position, look)

    return jax.vmap(one)(arcs, positions, looks)


@pytest.mark.slow
def test_the_carrot():
    """But for vehicles farther away than the look-ahead, where Nav2 takes the nearest pose and we the nearest point."""
    some = steps(lambda case, step: along(case))
    seen, far = 0, 0
    for name in dict.fromkeys(case["path"] for case, _ in some):
        mine = [step for case, step in some if case["path"] == name]
        pose = np.array([step["pose"] for step in mine])
        arcs = np.array([foot(name, step) for step in mine])
        looks = np.array([step["lookahead"] for step in mine])
        first = np.array([points(name)[step["nearest"]] for step in mine])
        wanted = np.array([step["carrot"] for step in mine])
        way, size = route(name), 64  # one shape for all: a program for each path is enough
        pad = [np.resize(a, (size, *a.shape[1:])) for a in (arcs, pose[:, :2], looks)]
        found = np.asarray(carrots(RegulatedPurePursuit(), way, *(jnp.asarray(a) for a in pad)))[: len(mine)]
        away, c, s = found - pose[:, :2], np.cos(pose[:, 2]), np.sin(pose[:, 2])
        body = np.c_[away[:, 0] * c + away[:, 1] * s, away[:, 1] * c - away[:, 0] * s]
        near = np.linalg.norm(first - pose[:, :2], axis=1) < looks
        # where the path hardly leaves the circle of the look-ahead, Newton's bounded steps do not get there
        crossing = np.array([steepness(name, step) for step in mine])
        plain, grazes = near & (crossing > 0.4), near & (crossing <= 0.4)
        np.testing.assert_allclose(body[plain], wanted[plain], atol=OFF, err_msg=name)
        np.testing.assert_allclose(np.linalg.norm(body[grazes], axis=1), looks[grazes], rtol=0.03, err_msg=name)
        spacing = np.linalg.norm(np.diff(points(name), axis=0), axis=1).max()
        np.testing.assert_array_less(np.linalg.norm(body - wanted, axis=1)[~near], spacing * (1 + 1e-6))
        seen, far = seen + near.sum(), far + (~near).sum()
    assert seen > 180 and far < seen / 5, (seen, far)


def curved(case):
    return not case["parameters"].get("use_fixed_curvature_lookahead", False)


def test_the_curvature_and_the_regulated_speed_in_nav2s_order():
    some = steps(lambda case, step: curved(case) and "carrot" in step)
    here = route("straight").at(jnp.asarray(0.0), jnp.asarray(0.0))
    seen = 0
    for case, step in some:
        pursuit = law(case)
        x, y = step["carrot"]
        square = x * x + y * y
        curvature = 2 * y / max(square, 1e-3)
        if square > 1e-3:
            assert curvature == pytest.approx(step["curvature"], rel=1e-6, abs=1e-9)
        else:
            assert step["curvature"] == 0 and abs(curvature) < 2 / np.sqrt(1e-3)  # straight on; ours goes to 0 smoothly
            continue
        distance, rest = last_in_view(case, step)
        near = pursuit.approach_velocity_scaling_dist
        left = distance if rest < near else np.inf  # Nav2: by the way that is left, in proportion to the distance
        place = dataclasses.replace(here, remaining=jnp.asarray(min(left, 1e6)))
        top = jnp.asarray(pursuit.desired_linear_vel)
        found = float(pursuit.slowed(top, jnp.asarray(step["curvature"]), place))
        assert found == pytest.approx(abs(step["regulated"]), rel=1e-8), case["topic"]
        seen += 1
    assert seen > 250


# ---------------------------------------------------------------------------------------------------------- as a whole


@jax.jit
def twists(pursuit, way, arcs, leg, poses, speeds):
    def one(arc, pose, speed):
        position, heading = pose[:2], pose[2]
        velocity = speed[0] * jnp.stack([jnp.cos(heading), jnp.sin(heading)])
        seen = Measurement(position=position, velocity=velocity, heading=heading, yaw_rate=speed[1])
        return pursuit.steer((), way.at(arc, leg), way, seen, 0.05)[0]

    return jax.vmap(one)(arcs, poses, speeds)


def commanded(case, step, sign=1.0):
    """The twist of our law, and what is left of the way."""
    way, arc = route(case["path"], sign), foot(case["path"], step)
    parts = [jnp.asarray(x)[None] for x in (arc, step["pose"], step["speed"])]
    pursuit = jax.tree.map(lambda x: jnp.asarray(x, float), law(case))
    return np.asarray(twists(pursuit, way, parts[0], jnp.asarray(0.0), *parts[1:]))[0], float(way.length) - arc


WHOLE = ("straight", "s-bend", "left, radius 2", "right, radius 0.4", "rounded rectangle", "hairpin")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] * (n in ("straight", "s-bend"))) for n in WHOLE]
)
def test_the_twist(name):
    def keep(case, step):
        if case["path"] != name or not along(case) or not curved(case) or step["rotates"]:
            return False
        return np.linalg.norm(points(name)[step["nearest"]] - step["pose"][:2]) < step["lookahead"]

    some = steps(keep)
    assert some
    for case, step in some:
        found, left = commanded(case, step)
        near = law(case).approach_velocity_scaling_dist
        distance, rest = last_in_view(case, step)
        if min(left, rest) < near:  # we by the way from the nearest point, Nav2 by the distance
            theirs = min(distance / near, 1) if rest < near else 1.0  # and there only from the nearest pose on
            scale = law(case).desired_linear_vel * (abs(min(left / near, 1) - theirs) + 1e-3)
            assert abs(found[0] - step["command"][0]) <= scale
            continue
        off = 8 * OFF / step["lookahead"] ** 2  # of the curvature 2 y / d^2
        speed, turn = step["command"]
        slower = off * law(case).regulated_linear_scaling_min_radius * abs(speed)
        assert found[0] == pytest.approx(speed, abs=slower + 1e-9)
        assert found[1] == pytest.approx(turn, abs=off * abs(speed) + slower * abs(step["curvature"]) + 1e-9)


@pytest.mark.parametrize("name", ["behind", "behind, curved"])
def test_backwards_the_twist_is_nav2s_where_it_may_reverse(name):
    some = steps(lambda c, s: c["path"] == name and c["topic"] == "backwards" and not s["rotates"])
    assert some
    for case, step in some:
        found, left = commanded(case, step, sign=-1.0)
        if left < law(case).approach_velocity_scaling_dist + 0.1:
            continue
        assert found[0] == pytest.approx(step["command"][0], abs=1e-4)
        assert found[1] == pytest.approx(step["command"][1], abs=1e-3)


# ------------------------------------------------------------------------------------------------------------- slopes


def test_the_twist_has_the_slope_of_differences():
    way, pursuit = Route.corners([[0, 0], [3, 0], [3, 3]], 0.5, radius=1.0), RegulatedPurePursuit()

    @jax.jit
    def twist(look, position):
        law = dataclasses.replace(pursuit, lookahead_dist=look)
        seen = Measurement(position=position, velocity=jnp.zeros(2), heading=jnp.asarray(0.2), yaw_rate=jnp.zeros(()))
        return law.steer((), way.at(jnp.asarray(1.7), jnp.asarray(0.0)), way, seen, 0.05)[0]

    look, position = jnp.asarray(0.6), jnp.asarray([1.7, 0.1])
    slopes = jax.jacfwd(twist, argnums=(0, 1))(look, position)
    h = 1e-6
    np.testing.assert_allclose(slopes[0], (twist(look + h, position) - twist(look - h, position)) / (2 * h), atol=1e-4)
    for i, d in enumerate(h * np.eye(2)):
        far = (twist(look, position + d) - twist(look, position - d)) / (2 * h)
        np.testing.assert_allclose(slopes[1][:, i], far, atol=1e-4)


def test_at_the_carrot_itself_the_law_steers_straight_on():
    way = Route.corners([[0, 0], [3, 0]], 0.5, radius=1.0, limits=SpeedLimits(stop=False))
    end = way.at(jnp.asarray(3.0), jnp.asarray(0.0))
    turns = []
    for aside in (0.1, 0.03, 0.01, 1e-3, 1e-4, 0.0):
        position = jnp.asarray([3.0, aside])
        zero = jnp.zeros(())
        seen = Measurement(position=position, velocity=jnp.zeros(2), heading=zero, yaw_rate=zero)
        pursuit = RegulatedPurePursuit(max_angular_velocity=100.0)
        turns.append(float(pursuit.steer((), end, way, seen, 0.05)[0][1]))
    assert np.all(np.abs(turns) <= 0.05 * 2 / np.sqrt(1e-3) + 1e-9)
    np.testing.assert_allclose(np.abs(turns[3:]), 0.05 * 2 * np.array([1e-3, 1e-4, 0.0]) / 1e-3, atol=1e-12)
