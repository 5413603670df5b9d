"""How fast it may go: what the speeds tried say, where a run binds, what is refused; and a small problem to its end."""

import csv
import json
import math
import re
import types

import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from commands import arguments, run
from runs import trajectory
from tuning.cli.main import main
from tuning.config.load import load
from tuning.config.routes import faster
from tuning.studies.speed.page import sentences
from tuning.studies.speed.place import farthest
from tuning.studies.speed.study import at, fastest, long_enough
from tuning.studies.speed.tried import Tried, answer
from tuning.tune.finer import validation


def tried(factor, worst, **given):
    """A speed in a study of vehicles that do what is asked and whose limits are met."""
    numbers = {"speed": factor, "lateral": factor**2, "driven": 0.9 * factor, "mean": worst / 2, "outside": worst - 0.1}
    numbers |= {"start": 1.0, "diverged": 0, "short": 0, "excess": 0.0, "iterations": 5, "vehicle": 1}
    return Tried(**({"factor": factor, "worst": worst} | numbers | {"z": (0.1,), "gains": (1.0,)} | given))


def told(*speeds, within=0.05):
    return "\n".join(sentences(sorted(speeds), answer(list(speeds), within), within, 256))


def test_the_answer_is_the_highest_speed_that_holds_and_the_next_one_above_it():
    speeds = [tried(2.0, 0.2), tried(0.5, 0.01), tried(1.2, 0.049), tried(1.3, 0.051)]
    best, above = answer(speeds, 0.05)
    assert (best, above) == (speeds[2], speeds[3])
    said = told(*speeds)
    assert "Up to 1.2 m/s" in said and "At 1.3 m/s the worst of 256 vehicles is 51.0 mm off." in said
    assert "highest speed tried" not in said and "every lower speed" not in said
    assert answer(speeds, 0.0).best == speeds[3]  # the corridor of this study is 0.1 m wide


def test_what_is_not_known_is_said():
    held = [tried(1.0, 0.02), tried(1.5, 0.03)]
    assert answer(held, 0.05) == (held[1], None) and "That is the highest speed tried" in told(*held)
    assert answer(held, 0.01) == (None, held[0]) and "At no speed" in told(*held, within=0.01)
    assert "At 1 m/s the worst of 256 vehicles is 20.0 mm off." in told(*held, within=0.01)
    assert "0.7 m/s does not" in told(tried(0.7, 0.06), *held)
    assert "A reference above 1 m/s" in told(tried(1.0, 0.02, driven=0.9), tried(1.5, 0.03, driven=0.903))
    assert "3 of the 256 vehicles do not drive" in told(tried(1.0, 0.02, short=3))


@pytest.mark.parametrize("spoilt", [{"diverged": 1}, {"excess": 0.1}, {"why": "no gradient", "excess": math.inf}])
def test_a_speed_does_not_hold_where_runs_diverge_or_limits_are_not_met(spoilt):
    assert tried(1.0, 0.02).holds(0.05) and not tried(1.0, 0.02, **spoilt).holds(0.05)


def test_the_place_that_binds_is_after_the_start_and_in_a_corridor_nearest_to_a_side():
    across = jnp.array([0.9, 0.3, -0.2, 0.15, 0.1])
    room = jnp.array([1.0, 1.0, 1.0, 0.1, 1.0]), jnp.array([1.0, 1.0, 0.9, 1.0, 0.9])
    beside = types.SimpleNamespace(cross_track=across, room=room)
    made = trajectory(jnp.array([0.0, 5.0, 6.0, 7.0, 8.0]), route=beside)
    assert farthest(made, 4.0, corridor=False) == 1  # not 0, of the start
    assert farthest(made, 4.0, corridor=True) == 3  # 0.05 m beyond the left side


# --------------------------------------------------------------------------------------------------- another speed


def test_a_profile_says_how_fast_and_how_hard_sideways():
    circle = agvjax.Route.along(agvjax.Circle(radius=2.0, omega=0.3))
    assert fastest(circle) == pytest.approx((0.6, 0.18), rel=1e-6)  # v = r w, v^2 / r


@pytest.mark.parametrize("path", [{}, {"limits": {"lateral_acceleration": 0.4, "speed": 0.7}}])
def test_at_another_speed_speed_and_lateral_acceleration_are_larger_and_the_way_is_the_same(path):
    config = load(["base"], more={f"scenario.path.{name}": value for name, value in path.items()})
    route, quick = config.scenario.path, at(config, 1.5)
    new = quick.scenario.path
    np.testing.assert_array_equal(new.table, route.table)
    (speed, lateral), (more, harder) = fastest(route), fastest(new)
    assert (more, harder) == pytest.approx((1.5 * speed, 1.5**2 * lateral), rel=1e-9)
    assert quick.controller.inner.desired_linear_vel == pytest.approx(1.2)
    assert new.end() == route.end() and new.lap() == pytest.approx(route.lap() / 1.5, rel=1e-9)
    np.testing.assert_allclose(faster(faster(route, 1.2), 1.25).squares, new.squares, rtol=1e-12)


def test_what_it_may_slow_down_with_stays():
    limits = {"deceleration": 0.2}
    config = load([], more={"scenario.path": {"type": "route", "points": [[0, 0], [2, 0], [4, 0]], "limits": limits}})
    route = faster(config.scenario.path, 2.0)
    ends = np.r_[route.squares[0], route.squares[0, -1] + route.squares[1, -1]]
    rise = np.diff(ends) / (2 * 4 / len(route.squares[0]))
    assert rise.min() == pytest.approx(-0.2)  # v^2 / 2 falls by so much a metre


def test_along_a_shape_the_clock_runs_faster():
    config = load([], more={"scenario.path": {"type": "route", "along": "circle", "faster": 1.25}})
    assert config.scenario.path.lap() == pytest.approx(
        float(load([], ["scenario.path=circle"]).scenario.path.lap()) / 1.25
    )


def test_a_law_without_a_speed_of_its_own_is_left_alone():
    law = agvjax.Sampled(inner=agvjax.PathPID(), vehicle=agvjax.Base(), period=0.05)
    assert agvjax.leaves(law.faster(2.0)) == agvjax.leaves(law)


def test_runs_are_long_enough_for_the_slowest_speed():
    config = load(["base"], ["speed.low=0.4"])
    longer = long_enough(config).simulate.horizon
    lap = float(config.scenario.path.length) / (0.4 * 0.8)
    assert 1.25 * lap + 20 <= longer < 1.25 * lap + 21 and long_enough(config).simulate.horizon == longer
    short = load(["base"], ["simulate.horizon=200"])
    assert long_enough(short).simulate.horizon == 200


@pytest.mark.parametrize(
    "settings, words",
    [
        (["--config", "unicycle"], "controller.inner = NeuroBackstepping: must be a law that follows a route"),
        ([], "controller = NeuroBackstepping: must be a law that follows a route"),
        (["--config", "base", "--set", "scenario.path.half_width=0"], "speed.within = 0"),
        (["--config", "base", "--within", "0"], "--within = 0"),
        (["--config", "base", "--within", "-1"], "--within = -1"),
        (["--config", "base", "--set", "speed.low=3"], "speed.low = 3"),
        (["--config", "base", "--set", "speed.after=40"], "speed.after = 40"),
        (["--config", "base", "--set", "tune.gains=all"], "tune.gains = all"),
        (["--config", "base", "--set", "tune.search.rounds=1"], "tune.search.rounds = 1"),
        (["--config", "base", "--set", "scenario.path.faster=0"], "scenario.path.faster = 0"),
    ],
)
def test_what_has_no_highest_speed_is_refused_by_key_value_and_rule(settings, words, tmp_path, capsys):
    assert main(["speed", "--out", str(tmp_path / "out"), *settings]) == 2
    said = capsys.readouterr().err
    assert words in said and "Traceback" not in said, said
    assert not (tmp_path / "out").exists()


# ----------------------------------------------------------------------------------------------------- to its end

SMALL = """
ensemble.size=4 ensemble.validation_size=4 tune.screen=0 tune.iterations=6 speed.low=0.75 speed.high=3 speed.points=3
speed.halvings=1 simulate.dt=0.01 tune.dt=0.01 simulate.integrator=euler tune.integrator=euler simulate.horizon=10
speed.after=3 scenario.path.closed=false scenario.path.points=[[1,0],[4,0],[4,3]]
""".split()
WITHIN = 0.1


def distance(run, line, late):
    """The largest distance [m] of a run after a time [s] to a polygon (n, 2), and the corner nearest to it there."""
    position = np.asarray(run.position)[np.asarray(run.t) >= late - 1e-9]
    away = np.linalg.norm(position[:, None] - line[None], axis=2)
    when = np.argmax(away.min(axis=1))
    return float(away[when].min()), line[np.argmin(away[when])]


@pytest.fixture(scope="module")
def studied(tmp_path_factory):
    out = tmp_path_factory.mktemp("speed") / "out"
    more = ("--config", "base", "--within", WITHIN)
    return out, more, run(arguments("speed", out, SMALL, *more))[0]


def rows_of(out):
    with (out / "speed.csv").open() as file:
        return [
            {name: x if x in ("True", "False") else float(x) for name, x in row.items()} for row in csv.DictReader(file)
        ]


def line():
    """The lines and the arc of the small problem's corner by hand, a point every two millimetres or so.

    The last line goes on beyond the route: at its end a distance is one across it, too.
    """
    angle, way, zero = np.linspace(-np.pi / 2, 0, 1000), np.linspace(1, 5, 2000), np.zeros(2000)
    arc = np.stack([3 + np.cos(angle), 1 + np.sin(angle)], 1)
    return np.concatenate([np.stack([way, zero], 1)[way < 3], arc, np.stack([zero + 4, way], 1)])


@pytest.mark.slow
def test_the_speed_that_is_returned_holds_and_the_next_does_not(studied):
    """Each vehicle rolled out again by itself, its distance to the route that of its points to lines and an arc."""
    out, _, said = studied
    rows, given = rows_of(out), load([str(out / "config.toml")])
    best = max((row for row in rows if row["holds"] == "True"), key=lambda row: row["factor"])
    above = min((row for row in rows if row["factor"] > best["factor"]), key=lambda row: row["factor"])
    quick = load([str(out / "fastest.toml")])
    for row, holds in ((best, True), (above, False)):
        config = at(given, row["factor"])
        law = agvjax.replace(config.controller, {name: row[name] for name in given.tune.gains})
        if holds:  # the file that is left is of this route and these gains
            assert agvjax.leaves(quick.controller) == pytest.approx(agvjax.leaves(law))
            np.testing.assert_array_equal(quick.scenario.path.squares, config.scenario.path.squares)
        batch, late = validation(config), 3 / row["factor"]
        runs = [agvjax.simulate(agvjax.check(law), batch[i], **config.timing()) for i in range(batch.size)]
        far, where = zip(*(distance(made, line(), late) for made in runs), strict=True)
        assert (row["holds"] == "True") == (max(far) <= WITHIN) == holds
        assert max(far) == pytest.approx(row["worst"], abs=1e-4) and int(np.argmax(far)) == row["vehicle"]
        told = re.search(
            rf"At {row['speed']:.3g} m/s the largest distance is ([\d.]+) mm .*? at \(([-\d.]+), ([-\d.]+)\)", said
        )
        assert float(told[1]) == pytest.approx(1e3 * max(far), abs=0.2)
        np.testing.assert_allclose([float(told[2]), float(told[3])], where[int(np.argmax(far))], atol=0.03)


@pytest.mark.slow
def test_a_run_that_was_stopped_goes_on_to_the_same_result(studied):
    out, more, said = studied
    before = (out / "speed.csv").read_bytes()
    kept = sorted((out / "speeds").iterdir())
    lost = max(kept, key=lambda path: json.loads(path.read_text())["factor"])
    lost.unlink()
    (out / "speed.csv").unlink()
    times = {path: path.stat().st_mtime_ns for path in kept if path != lost}
    again = run(arguments("speed", out, SMALL, *more, "--resume"))[0]
    assert (out / "speed.csv").read_bytes() == before and lost.exists()
    assert times == {path: path.stat().st_mtime_ns for path in times}
    assert again.splitlines()[-4:] == said.splitlines()[-4:]
    run(arguments("speed", out, [*SMALL, "seed=1"], *more, "--resume"), code=2)
