"""Routes in TOML: what a table makes, that it is written back, and what is refused by key, value and rule."""

import tomllib

import numpy as np
import pytest

import agvjax
from tuning.config.load import load
from tuning.config.write import dump
from tuning.tune.rules import faults

CORNERS = {"type": "route", "points": [[0, 0], [4, 0], [4, 3]], "radius": 1.0, "speed": 0.5}


def route(**table):
    return load([], more={"scenario.path": {"type": "route"} | table}).scenario.path


def test_lines_with_a_rounded_corner_have_the_length_of_lines_and_arc():
    path = route(points=[[0, 0], [4, 0], [4, 3]], radius=1.0, speed=0.5)
    assert float(path.length) == pytest.approx(3 + np.pi / 2 + 2)
    assert path.half_widths is None


def test_points_are_joined_by_a_spline_and_a_shape_is_followed():
    line = route(points=[[0, 0], [1, 0], [2, 0], [4, 0]], limits={"stop": False})
    assert float(line.length) == pytest.approx(4) and line.end() == pytest.approx(4)
    assert float(route(along="circle").length) == pytest.approx(2 * np.pi, rel=1e-6)
    assert float(route(along={"type": "circle", "radius": 3.0}).length) == pytest.approx(6 * np.pi, rel=1e-6)


def test_a_file_brings_speeds_directions_and_a_corridor(tmp_path):
    file = tmp_path / "way.csv"
    rows = ["x,y,speed,left,right"] + [f"{x},0,{0.5 if x < 4 else -0.25},{0.1 * (x + 1)},0.2" for x in range(5)]
    file.write_text("\n".join(rows[:5]) + "\n")
    path = route(file=str(file))
    assert float(path.length) == pytest.approx(3) and path.legs.shape[1] == 1
    np.testing.assert_allclose(path.half_widths[0, 0], 0.1, rtol=1e-12)
    np.testing.assert_allclose(path.half_widths[2], 0.2, rtol=1e-12)
    back = route(points=[[0, 0, 0.5], [1, 0, 0.5], [2, 0, -0.25], [1, 0.2, -0.25], [0, 0.5, -0.25]])
    assert list(back.legs[3]) == [1, -1]


def test_stops_are_points_of_speed_0_and_last_as_long_as_it_is_said(tmp_path):
    points = [[0, 0, 0.5], [2, 0, 0.5], [3, 0, 0], [5, 0, 0.5]]
    assert [*route(points=points).legs[4]] == [0, 0] and [*route(points=points).legs[0]] == pytest.approx([0, 3])
    assert [*route(points=points, dwell=2).legs[4]] == [2, 0]
    assert [*route(points=[p[:2] for p in points], dwell=[0, 1.5, 3, 0]).legs[4]] == [1.5, 3, 0]
    assert [*route(points=points, dwell=2, radius=1.0).legs[0]] == pytest.approx([0, 3])
    config = load([], more={"scenario.path": {"type": "route", "points": points, "dwell": 2.0, "half_width": 0.3}})
    again = load([], more={"scenario.path": tomllib.loads(dump(config))["scenario"]["path"]}).scenario.path
    np.testing.assert_array_equal(again.legs, config.scenario.path.legs)


@pytest.mark.parametrize(
    "speeds, dwell, begins, words",
    [
        ([0, 2, 2, 0, 2, 2, 2, 2, 2, 0], 3.0, [0, 3], ["stops at 1 of 10 points", "speed 0 at 2 of 10 points"]),
        ([2, 2, 0, 0, 0, 2, 2, 0, 2, 2], 1.0, [0, 2, 7], ["stops at 2 of 10 points", "speed 0 at 2 of 10 points"]),
    ],
)
def test_speeds_of_0_in_a_file_are_stops_where_it_drives_on(tmp_path, speeds, dwell, begins, words):
    file, said = tmp_path / "way.csv", []
    file.write_text("x,y,speed\n" + "".join(f"{x},0,{v}\n" for x, v in enumerate(speeds)))
    table = {"type": "route", "file": str(file), "dwell": dwell, "limits": {"deceleration": 0.5}}
    path = load([], more={"scenario.path": table}, note=said.append).scenario.path
    assert path.legs[0].tolist() == pytest.approx(begins)
    assert path.legs[4].tolist() == [dwell] * (len(begins) - 1) + [0]
    assert all(word in " ".join(said) for word in words)


def test_a_tolerance_takes_the_place_of_a_radius_that_was_said_before():
    preset = load(["base"]).scenario.path
    other = load(["base"], more={"scenario.path": {"tolerance": 0.1}}).scenario.path
    # four corners of a right angle: each arc is shorter than its tangents by (2 - pi / 2) radius, of tolerance / (√2-1)
    shorter = 4 * (2 - np.pi / 2) * (1.0 - 0.1 / (np.sqrt(2) - 1))
    assert float(other.length) - float(preset.length) == pytest.approx(shorter, rel=1e-9)
    back = load(["base"], ["scenario.path.tolerance=0.1", "scenario.path.radius=1.0"]).scenario.path
    assert float(back.length) == pytest.approx(float(preset.length))
    with pytest.raises(agvjax.InputError, match="one of radius and tolerance must be given; got 1.0 and 0.1"):
        load(["base"], more={"scenario.path": {"tolerance": 0.1, "radius": 1.0}})


def test_what_is_read_is_written_and_read_again():
    given = CORNERS | {"half_width": [0.2, 0.3], "limits": {"acceleration": 0.4, "stop": False}}
    config = load([], more={"scenario.path": given})
    text = dump(config)
    assert 'type = "route"' in text and "radius = 1.0" in text
    again = load([], more={"scenario.path": tomllib.loads(text)["scenario"]["path"]}).scenario.path
    for name in ("table", "squares", "legs", "half_widths"):
        np.testing.assert_array_equal(getattr(again, name), getattr(config.scenario.path, name))


@pytest.mark.parametrize(
    "table, words",
    [
        ({"points": [[0, 0]]}, ("scenario.path.points", "at least 2")),
        ({"points": [[0, 0], [0, 0], [1, 0]]}, ("scenario.path.points", "number 1 and number 2 are equal")),
        ({"points": [[0, 0], [1, 0]], "speed": 0.0}, ("scenario.path.speed = 0", "must not be 0")),
        ({"points": [[0, 0], [1, 0]], "half_width": -0.1}, ("scenario.path.half_width = -0.1", ">= 0")),
        ({"points": [[0, 0], [1, 0], [1, 1]], "radius": 3.0}, ("scenario.path.radius = 3", "room")),
        ({"points": [[0, 0], [1, 0], [1, 1]], "radius": "wide"}, ("scenario.path.radius", "a number")),
        ({"points": [[0, 0], [1, 0]], "limits": {"acceleration": 0}}, ("limits.acceleration = 0", "> 0")),
        ({"points": [[0, 0], [1, 0]], "limits": {"jerks": 1}}, ("limits.jerks", "one of speed")),
        ({"points": [[0, 0], [1, 0]], "until": 3.0}, ("scenario.path.until", "absent")),
        ({"points": [[0, 0], [1, 0], [2, 0]], "dwell": 2}, ("scenario.path.dwell = 2", "none has speed 0")),
        ({"points": [[0, 0], [1, 0], [2, 0]], "dwell": [0, -2, 0]}, ("scenario.path.dwell", ">= 0", "-2")),
        ({"points": [[0, 0], [1, 0], [2, 0]], "dwell": "long"}, ("scenario.path.dwell", "a number in s, or one for")),
        ({"along": "circle", "dwell": 2.0}, ("scenario.path.dwell", "absent")),
        ({"along": "square"}, ("scenario.path.along", "dumbbell")),
        ({"along": "circle", "radius": 2.0}, ("scenario.path.radius", "absent")),
        ({"along": "line"}, ("scenario.path.along", "until must be given")),
        ({}, ("scenario.path.file", "points")),
    ],
)
def test_what_no_route_can_be_made_of_is_said_with_key_value_and_rule(table, words):
    with pytest.raises(agvjax.InputError) as said:
        route(**table)
    assert all(word in str(said.value) for word in words), str(said.value)


@pytest.mark.parametrize("name", ["base", "forklift"])
def test_a_built_in_problem_follows_a_route(name):
    config = load([name], [])
    assert config.controller.follows() and config.scenario.path.by_arc()
    assert "cross_track_late" in config.tune.goals and set(config.tune.limits) == {"pace", "total_chatter"}


def test_what_follows_from_a_bad_path_is_not_said_besides():
    with pytest.raises(agvjax.InputError) as refused:
        load(["base"], ["scenario.path.points=[[0, 0], [0, 0]]"], faults, note=lambda text: None)
    assert [fault.key for fault in refused.value.faults] == ["scenario.path.points"]


def test_a_law_that_follows_needs_a_route():
    law = agvjax.Sampled(inner=agvjax.PathPID(), vehicle=agvjax.Base(), period=0.05)
    scenario = agvjax.Scenario.of(agvjax.Base(), disturbance=agvjax.NoDisturbance())
    with pytest.raises(ValueError, match=r"Dumbbell goes by a clock: make it Route.along\(path\)"):
        agvjax.simulate(law, scenario, n_steps=2)


def test_a_route_of_ones_own_takes_the_place_of_the_presets(tmp_path):
    """From a file, points or a shape: where a later table has another of them, nothing of the earlier path is left."""
    (tmp_path / "track.csv").write_text("x,y,speed\n0,0,0.5\n5,0,0.5\n5,5,0.5\n")
    file = f'scenario.path.file="{tmp_path / "track.csv"}"'
    path = load(["base"], [file, "scenario.path.radius=2.0"], note=[].append).scenario.path
    assert float(path.length) == pytest.approx(3 + np.pi + 3) and not path.closed  # the preset has 1 m, closed
    assert load(["base"], ['scenario.path.along="circle"'], note=[].append).scenario.path.closed
    again = load(
        ["base"], [file, "scenario.path.points=[[0,0],[9,0],[9,9]]", "scenario.path.radius=2.0"], note=[].append
    ).scenario.path
    assert float(again.length) == pytest.approx(7 + np.pi + 7)
    corners = load(
        ["base"], ["scenario.path.points=[[0,0],[9,0],[9,9],[0,9]]"], note=[].append
    ).scenario.path  # the same source
    assert float(corners.length) == pytest.approx(4 * 7 + 2 * np.pi)  # closed, 1 m
    (tmp_path / "both.toml").write_text('scenario.path = { file = "track.csv", points = [[0, 0], [1, 0]] }')
    with pytest.raises(agvjax.InputError, match=r"scenario\.path\.points.*absent where there is a file"):
        load(["base", str(tmp_path / "both.toml")], note=[].append)


@pytest.mark.parametrize(
    "files, metric", [([], "total_rmse"), (["base"], "cross_track_late"), (["forklift"], "cross_track_late")]
)
def test_what_fails_in_a_sweep_is_an_error_that_the_law_has(files, metric):
    """A law that follows a route has a total_rmse of 0, of which no multiple means anything."""
    assert {name: (bound.value, bound.absolute) for name, bound in load(files).sweep.fails.items()} == {
        metric: (1.5, False)
    }


def test_other_points_for_a_route_of_ones_own_change_its_points_alone(tmp_path):
    """As for a law that was tuned on one route and is taken along another: speed, limits and corners stay."""
    mine = {"type": "route", "points": [[0, 0], [10, 0], [10, 5], [0, 5]], "closed": True, "radius": 1.0, "speed": 0.5}
    mine |= {"half_width": 0.3, "limits": {"acceleration": 0.4, "lateral_acceleration": 0.2}}
    written = dump(load([], more={"scenario.path": mine}))
    assert "speed = 0.5" in written  # a number to be changed, not one of each point
    (tmp_path / "config.toml").write_text(written)
    (tmp_path / "other.csv").write_text("x,y\n0,0\n6,0\n6,6\n0,6\n")
    config = str(tmp_path / "config.toml")
    path = load([config], [f'scenario.path.file="{tmp_path / "other.csv"}"'], note=[].append).scenario.path
    assert float(path.length) == pytest.approx(4 * 4 + 2 * np.pi) and path.closed
    squares, half = np.asarray(path.squares)[0], np.asarray(path.half_widths)
    assert np.sqrt(squares.max()) == pytest.approx(0.5) and np.all(half[[0, 2]] == 0.3)
    assert squares[squares > 0].min() == pytest.approx(0.2 * 1.0, rel=1e-3)  # in the corners of 1 m
    slower = load([config], ["scenario.path.speed=0.3"], note=[].append).scenario.path
    assert np.sqrt(np.asarray(slower.squares)[0].max()) == pytest.approx(0.3)


def test_a_setting_beside_gains_counts_on_top_of_the_configuration_they_were_tuned_for(tmp_path):
    config = load(["base"], ["scenario.path.speed=0.4"])
    (tmp_path / "config.toml").write_text(dump(config))
    (tmp_path / "gains.toml").write_text(
        '[controller]\ntype = "sampled"\nperiod = 0.05\nvehicle = "base"\ninner = "path_pid"\n'
    )
    said = []
    asked = ["scenario.deadzone.left.threshold_right=0.08"]
    found = load([str(tmp_path / "gains.toml")], asked, note=said.append)
    assert type(found.controller.inner).__name__ == "PathPID"
    assert float(found.scenario.deadzone["left"].threshold_right) == 0.08
    np.testing.assert_allclose(np.asarray(found.scenario.path.squares)[0].max(), 0.16)
    assert "config.toml" in said[0]


@pytest.mark.parametrize(
    "zeros, spacing, begins, words",
    [
        ([2.5, 3.1], 0.5, [0, 2.5, 3.1], "stops at 2 of"),
        ([2.0, 3.0], 1.0, [0, 2, 3], "stops at 2 of"),
        ([0.9], 1.0, [0, 0.9], "stops at 1 of"),
        ([2.9], 1.0, [0, 2.9], "stops at 1 of"),
        ([2.9, 3.1], 1.0, [0, 2.9], "1 stops nearer to another one than the spacing are left out"),
    ],
)
def test_thinning_leaves_stops_where_they_are(tmp_path, zeros, spacing, begins, words):
    file, said = tmp_path / "way.csv", []
    rows = [(round(0.1 * k, 1), 0.0 if round(0.1 * k, 1) in zeros else 1.0) for k in range(61)]
    file.write_text("x,y,speed\n" + "".join(f"{x},0,{v}\n" for x, v in rows))
    table = {"type": "route", "file": str(file), "dwell": 1.0, "spacing": spacing}
    path = load([], more={"scenario.path": table}, note=said.append).scenario.path
    assert path.legs[0].tolist() == pytest.approx(begins) and words in " ".join(said)


def test_a_stop_beside_a_change_of_sign_is_where_it_turns_back(tmp_path):
    file = tmp_path / "way.csv"
    rows = [(0, 1), (1, 1), (2, 0), (3, 0), (4, 0), (3, -1), (2, -1)]
    file.write_text("x,y,speed\n" + "".join(f"{x},0,{v}\n" for x, v in rows))
    table = {"type": "route", "file": str(file), "dwell": 2.0}
    path = load([], more={"scenario.path": table}, note=str).scenario.path
    assert path.legs[0].tolist() == pytest.approx([0, 4]) and path.legs[3:].T.tolist() == [[1, 2], [-1, 0]]


def test_a_list_of_dwell_times_goes_with_its_points():
    mine = {"type": "route", "points": [[0, 0], [2, 0]], "dwell": [0, 0]}
    with_it = load([], ["scenario.path.points=[[0,0],[1,0],[2,1]]"], more={"scenario.path": mine})
    assert len(np.asarray(with_it.scenario.path.legs)[0]) == 1
