"""Where path and start lie: what is refused, and what is said."""

import dataclasses
import re

import numpy as np
import pytest

import agvjax
from tuning.config import load
from tuning.config.ends import Moving
from tuning.config.whereabouts import faults, notes
from tuning.ensemble.draws import Between, Plus, Span

pytestmark = pytest.mark.slow  # whole commands and programs, minutes in all

START = "start.position"
CORNERS = [[0, 0], [10, 0], [10, 2], [0, 2]]


def config_of(path=None, *settings):
    config = load([], list(settings))
    return (
        config
        if path is None
        else dataclasses.replace(config, scenario=dataclasses.replace(config.scenario, path=path))
    )


def started(config, x, y):
    return dataclasses.replace(config, scenario=agvjax.replace(config.scenario, {START: np.array([x, y])}))


def waypoints(points, closed=False, speed=1.0):
    return agvjax.Waypoints.through(np.asarray(points, float), speed, closed)


@pytest.mark.parametrize("preset", [[], ["unicycle"], ["car"], ["robot"]])
def test_nothing_is_said_of_the_problems_that_are_there(preset):
    config = load(preset)
    moving = Moving.drawn(config.ensemble.draws)
    assert notes(config) == notes(config, moving) == faults(config, moving) == []


@pytest.mark.parametrize(
    "setting", ["scenario.start.position=[9000, 0]", "scenario.path={type='line',origin=[0, -2e4]}"]
)
def test_places_that_single_precision_does_not_resolve_are_refused_with_it(setting):
    """At 2^13 m the numbers of 24 bits are 2^-10 m apart."""
    (fault,) = faults(config_of(None, setting, "precision=32"))
    assert fault.key == "precision" and "--precision 64" in fault.rule and "0.001 m apart" in fault.rule
    assert faults(config_of(None, setting)) == []
    assert faults(config_of(None, "scenario.start.position=[8000, 0]", "precision=32")) == []


@pytest.mark.parametrize(("precision", "most"), [(32, 2**13), (64, 2**42)])
def test_a_heading_of_more_turns_than_the_numbers_resolve_is_refused(precision, most):
    """At 2^13 rad the numbers of 24 bits are 2^-10 rad apart, at 2^42 rad those of 53."""
    (fault,) = faults(config_of(None, f"scenario.start.heading={-1.1 * most}", f"precision={precision}"))
    assert fault.key == "scenario.start.heading" and "0.001 rad apart" in fault.rule
    assert faults(config_of(None, f"scenario.start.heading={0.9 * most}", f"precision={precision}")) == []


def test_drawn_and_swept_starts_count_too():
    config = config_of(None, "precision=32")
    for name, draw in ((START, Plus(0.0, 9000.0)), (f"{START}[1]", Between(0.0, 9000.0))):
        assert [f.key for f in faults(config, [Moving("sweep.over", {name: Span(draw, 3)})])] == ["precision"]


def test_starts_of_which_none_is_near_the_path_are_refused():
    there = config_of(waypoints(np.add(CORNERS, [300, 200])))
    about = Moving.drawn({START: Between(-0.5, 0.5)})
    (fault,) = faults(there, about)
    # from (.5, .5), the nearest corner of the draws
    assert fault.key == f"ensemble.draws.{START}" and f"lies {np.hypot(299.5, 199.5):.4g} m or more away" in fault.rule
    assert faults(started(there, 300.0, 200.0), Moving.drawn({START: Plus(-0.5, 0.5)})) == []
    assert faults(there, [Moving("sweep.over", {START: Span(Between(-0.5, 0.5), 3)})]) == []  # how far is far?
    assert faults(there, Moving.drawn({START: Between(-0.5, 400.0)})) == []  # some are near


def test_a_start_off_the_path_is_said_where_it_is_not_drawn():
    config = started(config_of(waypoints(CORNERS[:2])), 3.0, -4.0)
    (text, *_) = notes(config)
    assert "starts at (3, -4) (scenario.start.position), 5 m from (0, 0), where scenario.path begins" in text
    drawn = [text for text in notes(config, Moving.drawn({START: Plus(0.0, 1.0)})) if "begins" in text]
    # the nearest corner of the draws is (3, -3)
    assert drawn == [
        f"every vehicle starts {np.hypot(3, 3):.3g} m or more (ensemble.draws.{START} or sweep.over) from (0, 0), where"
        " scenario.path begins"
    ]
    assert not any("begins" in text for text in notes(config, Moving.drawn({START: Plus(-5.0, 5.0)})))
    assert not any("starts at" in text for text in notes(started(config, 0.5, 0.5)))


@pytest.mark.parametrize(
    ("path", "lap"), [(waypoints([[0, 0], [20, 0], [40, 0]]), 40.0), (agvjax.Circle(omega=0.25), 8 * np.pi)]
)
def test_a_run_shorter_than_its_path_is_said(path, lap):
    said = [text for text in notes(config_of(path)) if "simulate.horizon" in text]
    assert said == [f"the run ends after 12 s (simulate.horizon), the path takes {lap:.4g} s"]
    assert not any("horizon" in text for text in notes(config_of(path, "simulate.horizon=41")))


def test_a_curve_that_swings_out_between_its_points_is_said():
    path = waypoints(CORNERS)
    (text,) = [text for text in notes(config_of(path)) if "smooth curve" in text]
    # the distance from the segments, on a fine grid of both, over the first and the longest of them
    curve = path.geometry(20_000).position
    lines = [np.linspace(a, b, 2001) for a, b in zip(CORNERS[:-1], CORNERS[1:], strict=True)]
    near = np.min([np.min(np.linalg.norm(curve[::20, None] - line[::5], axis=2), axis=1) for line in lines], axis=0)
    assert float(re.search(r"by (\S+) m", text)[1]) == pytest.approx(near.max(), rel=0.01)
    straight = waypoints([[x, 0.0] for x in range(11)])
    round_ = [[np.cos(a), np.sin(a)] for a in np.linspace(0, 2 * np.pi, 16, endpoint=False)]
    for calm in (straight, waypoints(round_, closed=True)):
        assert not any("smooth curve" in text for text in notes(config_of(calm)))


def test_columns_that_are_not_read_are_named(tmp_path):
    file, said = tmp_path / "track.csv", []
    file.write_text("x,y,z,yaw\n0,0,8,0\n10,0,8,0\n20,1,8,0\n")
    table = f"scenario.path={{type='waypoints',file='{file}'}}"
    load([], [table], note=said.append)
    assert len(said) == 1 and "z, yaw not read; no column speed: 1 m/s (scenario.path.speed" in said[0]
    with pytest.warns(UserWarning, match="z, yaw not read"):
        load([], [table])
    file.write_text("x,y,speed\n0,0,8\n10,0,8\n20,1,8\n")
    load([], [table], note=said.append)
    push = tmp_path / "push.csv"
    push.write_text("t,x,wind\n0,0,1\n1,0,1\n")
    load([], [f"scenario.disturbance={{type='recorded',file='{push}'}}"], note=said.append)
    assert len(said) == 2 and "wind not read" in said[1]
