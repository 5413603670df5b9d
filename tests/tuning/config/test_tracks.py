"""Paths of files as others write them, on maps near and far, and where vehicles start on them."""

import dataclasses

import jax
import numpy as np
import pytest

import agvjax
from agvjax import InputError
from tuning.config import dump, load, mapped, whereabouts
from tuning.config.load import resolve
from tuning.ensemble.draws import Between, OneOf, Plus
from tuning.studies.speed.study import fastest

FAR = np.array([500123.4, 5412345.6])  # m, as of UTM
BEND = np.column_stack([np.arange(0, 60, 3.0), 4 * np.sin(np.arange(0, 60, 3.0) / 12)])


def written(tmp_path, header, rows, name="track.csv", mark=","):
    file = tmp_path / name
    file.write_text(header + "\n" + "".join(mark.join(map(repr, row)) + "\n" for row in np.asarray(rows).tolist()))
    return str(file)


def track(file, *settings, kind="waypoints", files=("unicycle",), **table):
    """The configuration of a path from a file, and what was said."""
    said = []
    words = "".join(f", {name} = {value}" for name, value in table.items())
    path = f'scenario.path = {{ type = "{kind}", file = "{file}"{words} }}'
    return load([*files], [path, *settings], note=said.append), said


def test_a_racing_line_is_read_as_it_is_published(tmp_path):
    rows = np.column_stack([np.arange(20.0), BEND, np.zeros((20, 2)), np.linspace(3, 5, 20), np.zeros(20)])
    header = "# 17b4\n# 603f\n# s_m; x_m; y_m; psi_rad; kappa_radpm; vx_mps; ax_mps2"
    file = written(tmp_path, header, rows, mark=";")
    config, said = track(file)
    np.testing.assert_array_equal(config.scenario.path.points, rows[:, [1, 2, 5]])
    assert said == [f"{file}: x is x_m; y is y_m; speed is vx_mps; s_m, psi_rad, kappa_radpm, ax_mps2 not read"]


def test_widths_of_a_track_are_the_corridor_of_a_route_unless_it_has_its_own(tmp_path):
    rows = np.column_stack([BEND, np.full(20, 1.5), np.full(20, 2.5)])  # right, left
    file = written(tmp_path, "# x_m,y_m,w_tr_right_m,w_tr_left_m", rows)
    widths = track(file, kind="route")[0].scenario.path.half_widths
    np.testing.assert_allclose(widths[[0, 2]], [[2.5], [1.5]] * np.ones(widths.shape[1]), rtol=1e-12)
    config, said = track(file, kind="route", half_width=1.0)
    np.testing.assert_array_equal(config.scenario.path.half_widths[[0, 2]], 1.0)
    assert "w_tr_right_m, w_tr_left_m not read" in said[0]
    assert said[-1].endswith("its widths do not count beside scenario.path.half_width = 1.0")
    config, said = track(file, kind="route", tolerance=0.1)
    assert config.scenario.path.half_widths is None and "w_tr_right_m, w_tr_left_m not read" in said[0]


def test_a_velocity_is_the_speed_unless_another_is_said(tmp_path):
    file = written(tmp_path, "x,y,z,velocity", np.column_stack([BEND, np.zeros(20), np.full(20, 7.0)]))
    config, said = track(file)
    assert np.all(config.scenario.path.points[:, 2] == 7) and said == [f"{file}: speed is velocity; z not read"]
    config, said = track(file, speed=2.0)
    assert np.all(config.scenario.path.points[:, 2] == 2) and said == [f"{file}: z, velocity not read"]
    config, said = track(file, columns='{ speed = { column = "velocity", unit = "km/h" } }')
    np.testing.assert_allclose(config.scenario.path.points[:, 2], 7 / 3.6, rtol=1e-12)


def test_without_a_speed_it_is_said_which_one_holds(tmp_path):
    file = written(tmp_path, "x,y,yaw", np.column_stack([BEND, np.zeros(20)]))
    _, (text,) = track(file)
    assert "yaw not read; no column speed: 1 m/s (scenario.path.speed, or scenario.path.columns.speed)" in text


def test_two_columns_without_names_are_x_and_y_and_more_have_to_be_named(tmp_path):
    file = tmp_path / "track.csv"
    file.write_text("".join(f"{x!r} {y!r}\n" for x, y in BEND.tolist()))
    config, said = track(file)
    np.testing.assert_array_equal(config.scenario.path.points[:, :2], BEND)
    assert "x is 1; y is 2" in said[0]
    file.write_text("".join(f"{x!r} {y!r} 0\n" for x, y in BEND.tolist()))
    with pytest.raises(InputError, match="it has no header, and its columns are called 1, 2, 3"):
        track(file)
    config, _ = track(file, columns='{ x = "1", y = "2" }')
    np.testing.assert_array_equal(config.scenario.path.points[:, :2], BEND)
    file.write_text("48.0001 11.0001\n48.0002 11.0002\n48.0003 11.0004\n")
    with pytest.raises(InputError, match='degrees are columns = { lat = "1", lon = "2" }'):
        track(file)


def test_speeds_of_zero_are_counted_and_taken_for_a_crawl(tmp_path):
    file = written(tmp_path, "x,y,velocity", np.column_stack([BEND, [0.0, *np.full(18, 10.0), 0.0]]))
    config, said = track(file)
    np.testing.assert_allclose(config.scenario.path.points[[0, 10, 19], 2], [0.5, 10, 0.5])
    assert "speed 0 at 2 of 20 points taken for 5% of the largest" in said[1]


def test_a_spacing_thins_any_file_and_what_it_leaves_out_is_counted(tmp_path):
    file = written(tmp_path, "x,y,speed", np.column_stack([np.arange(20.0), np.zeros(20), np.ones(20)]))
    config, said = track(file, spacing=2.5)
    assert config.scenario.path.points[:, 0].tolist() == [0, 3, 6, 9, 12, 15, 19]
    assert said[0].startswith(f"{file}: 13 of 20 points left out, nearer than 2.5 m to the one before")
    for value, words in (("-1", "a number >= 0 in m"), ('"a"', "a number >= 0 in m")):
        with pytest.raises(InputError, match=words):
            track(file, spacing=value)


def test_a_recorded_drive_brings_its_speed(tmp_path):
    t = np.arange(0, 30, 0.05)
    x = 2.0 * np.clip(t - 5, 0, 20)  # at 2 m/s, from rest and to rest
    noise = 0.01 * np.random.default_rng(0).normal(size=(2, len(t)))
    file = written(tmp_path, "time,x,y,heading", np.column_stack([t, x + noise[0], noise[1], 0 * t]))
    config, said = track(file)
    points = config.scenario.path.points
    assert np.median(points[:, 2]) == pytest.approx(2.0, rel=0.03) and len(points) < len(t) / 2
    text = " ".join(said)
    assert "t is time; heading not read" in text and "points left out" in text and "s at rest apart" in text
    config, said = track(file, speed=1.5)
    assert np.all(config.scenario.path.points[:, 2] == 1.5) and "speeds are" not in " ".join(said)


def test_times_that_are_none_are_left_unread_unless_asked_for(tmp_path):
    file = written(tmp_path, "t,x,y", np.column_stack([np.zeros(20), BEND]))
    config, said = track(file)
    assert np.all(config.scenario.path.points[:, 2] == 1)
    assert said[0].startswith(
        f"its times are not read: {file}, row 3, column t: 0 must be above the time before, which"
    )
    assert "t not read; no column speed" in said[1]
    with pytest.raises(InputError, match="0 must be above the time before, which is the same"):
        track(file, columns='{ t = "t" }')
    assert track(file, columns='{ t = "" }')[1][0].startswith(f"{file}: no column speed")


def test_what_belongs_to_a_file_is_refused_without_one():
    for key, value in (("columns", '{ x = "a" }'), ("spacing", "1.0")):
        for kind in ("waypoints", "route"):
            with pytest.raises(InputError, match=f"scenario.path.{key} = .* absent where there is no file"):
                load([], [f"scenario.path={{type='{kind}',points=[[0,0],[1,1]],{key}={value}}}"])


def test_latitude_and_longitude_are_laid_into_a_plane(tmp_path):
    pytest.importorskip("pyproj")
    file = written(
        tmp_path, "lat,lon,speed", np.column_stack([48 + BEND[:, 0] * 1e-5, 11 + 0 * BEND[:, 0], BEND[:, 1] * 0 + 1])
    )
    config, said = track(file)
    path = config.scenario.path
    assert np.ptp(path.points[:, 0]) < 1e-6 and path.points[-1, 1] == pytest.approx(57e-5 * 111_200, rel=1e-3)
    assert config.scenario.start.heading == pytest.approx(np.pi / 2, abs=1e-9) and "to the east" in said[0]


def rolled(config, dtype, steps=1500):
    run = agvjax.simulate(config.controller, config.scenario, dt=0.002, n_steps=steps, save_every=50, dtype=dtype)
    assert bool(run.ok)
    return run


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["waypoints", "route"])
def test_a_map_far_away_is_driven_in_single_precision_as_one_nearby(tmp_path, kind):
    near, _ = track(written(tmp_path, "x,y,speed", np.column_stack([BEND, np.ones(20)]), "near.csv"), kind=kind)
    far, _ = track(written(tmp_path, "x,y,speed", np.column_stack([BEND + FAR, np.ones(20)]), "far.csv"), kind=kind)
    with jax.enable_x64(False):
        assert whereabouts.faults(dataclasses.replace(far, precision=32)) == []
        a, b = rolled(near, "float32"), rolled(far, "float32")
    shift = FAR - np.round(FAR)  # inside, a far path begins within half a metre of zero
    np.testing.assert_allclose(np.asarray(a.position, float), np.asarray(b.position, float) - shift, atol=2e-4)
    drawn = mapped.drawn(b, far.scenario)
    np.testing.assert_allclose(drawn.position - FAR, np.asarray(a.position, float), atol=2e-4)
    np.testing.assert_allclose(mapped.corners(far.scenario.path) - FAR, BEND, atol=1e-9)
    assert mapped.drawn(a, near.scenario) is a


def test_a_far_map_is_written_and_read_in_its_own_coordinates(tmp_path):
    file = written(tmp_path, "x,y,speed", np.column_stack([BEND + FAR, np.ones(20)]))
    settings = ["scenario.start.position=[500120.25, 5412345.5]"]
    settings += ["ensemble.draws={start.position={between=[[500120.0,500121.0],[5412345.0,5412346.0]]}}"]
    settings += ["sweep.over=[{'start.position[1]'={one_of=[5412345.0,5412346.5]}}]"]
    config, _ = track(file, *settings)
    o = np.round(FAR)
    np.testing.assert_array_equal(config.scenario.start.position, [500120.25, 5412345.5] - o)
    assert config.ensemble.draws["start.position"] == Between((-3.0, -1.0), (-2.0, 0.0))
    assert config.sweep.over[0]["start.position[1]"].draw == OneOf((-1.0, 0.5))
    text = dump(config)
    assert "500120.25" in text and "5412346.5" in text
    again = resolve(__import__("tomllib").loads(text))
    assert dump(again) == text
    np.testing.assert_array_equal(again.scenario.path.coefficients, config.scenario.path.coefficients)
    with pytest.raises(InputError, match=r"ensemble.draws.start.position .* must be \{ between"):
        track(file, "ensemble.draws={start.position={one_of=[5412345.0]}}")
    (text,) = [n for n in whereabouts.notes(track(file, settings[0])[0]) if "starts at" in n]
    assert "starts at (500120, 5.41235e+06)" in text


def test_a_far_route_is_exported_by_the_coordinates_of_its_map(tmp_path):
    file = written(tmp_path, "x,y,speed", np.column_stack([BEND + FAR, np.ones(20)]))
    route = track(file, kind="route")[0].scenario.path
    assert np.abs(np.asarray(route.table)[[0, 6], 0]).max() < 1
    np.testing.assert_allclose(np.asarray(mapped.laid(route).table)[[0, 6], 0], FAR, atol=1e-6)


def test_without_a_start_vehicles_start_where_a_path_through_points_does(tmp_path):
    rows = np.column_stack([300 + np.arange(9.0), 200 + 2 * np.arange(9.0), np.full(9, 1.5)])
    file = written(tmp_path, "x,y,speed", rows)
    start = track(file)[0].scenario.start
    np.testing.assert_allclose(start.position, [300, 200], atol=1e-9)
    np.testing.assert_allclose(start.velocity, 1.5 * np.array([1, 2]) / np.sqrt(5), rtol=1e-6)
    assert start.heading == pytest.approx(np.arctan(2))
    start = track(file, "scenario.start.heading=0.5")[0].scenario.start
    assert start.heading == 0.5 and np.allclose(start.position, [300, 200])
    start = track(file, "scenario.start.position=[1.0, 2.0]")[0].scenario.start
    assert start.position.tolist() == [1, 2]
    np.testing.assert_array_equal(start.velocity, load(["unicycle"]).scenario.start.velocity)
    back = track(written(tmp_path, "x,y,speed", rows * [1, 1, -1]), kind="route")[0].scenario.start
    assert back.heading == pytest.approx(np.arctan(2) - np.pi) and back.velocity[0] > 0
    shape = load([], ["scenario.path=circle"]).scenario.start
    np.testing.assert_array_equal(shape.position, agvjax.Start().position)


def test_the_start_of_a_preset_goes_with_its_path(tmp_path):
    file = written(tmp_path, "x,y,speed", np.column_stack([BEND + [300, 200], np.full(20, 8.0)]))
    config, said = track(file, files=("car",))
    np.testing.assert_allclose(config.scenario.start.position, [300, 200], atol=1e-9)
    assert [text for text in said if "start of car is of its own path" in text]
    assert isinstance(config.ensemble.draws["start.position"], Plus)
    assert whereabouts.faults(config) == []
    config, said = track(file, "scenario.start.position=[301.0, 200.0]", files=("car",))
    assert config.scenario.start.velocity.tolist() == [8, 4] and not [text for text in said if "start of" in text]


def test_points_of_a_later_table_take_the_place_of_those_before(tmp_path):
    file = written(tmp_path, "x,y", np.column_stack([np.arange(5.0) * 4, [0.0, 0, 0, 4, 8]]))
    config, _ = track(file, files=("base",), kind="route", closed="false")
    path = config.scenario.path
    np.testing.assert_array_equal(mapped.corners(path)[-1], [16, 8])
    # what the preset says besides stays: its corridor
    assert float(path.half_widths[0, 0]) == 0.25 and not path.closed
    again, _ = track(file, "scenario.path.points=[[0,0],[9,0],[9,9]]", files=("base",), kind="route", closed="false")
    assert len(mapped.corners(again.scenario.path)) == 3


def test_points_with_speeds_of_their_own_need_no_other_of_a_preset():
    path = "scenario.path = { points = [[0, 0, 0.5], [2, 0, 0.5], [4, 0.2, 0.3], [6, 0.4, 0.3]], closed = false }"
    route = load(["base"], [path], note=lambda text: None).scenario.path
    assert fastest(route)[0] == pytest.approx(0.5, abs=0.01)  # the preset's is 0.8
    with pytest.raises(agvjax.InputError, match="scenario.path.speed"):
        load(["base"], [path, "scenario.path.speed = 0.8"], note=lambda text: None)


def test_draws_of_the_built_in_bases_are_about_their_start():
    for name, there in (("base", [[1, -0.3], [1, 0.3]]), ("forklift", [[0, -0.1], [0, 0.1]])):
        config = load([name])
        box = config.ensemble.draws["start.position"].box(np.asarray(config.scenario.start.position))
        np.testing.assert_allclose(box, there)


def test_a_spline_of_a_route_that_swings_out_is_said_and_rounded_corners_are_not():
    corners = "[[0,0],[10,0],[10,2],[0,2]]"
    path = f"scenario.path={{type='route',points={corners}}}"
    text = " ".join(whereabouts.notes(load([], [path])))
    curve = " ".join(whereabouts.notes(load([], [path.replace("route", "waypoints")])))
    assert "a route with radius or tolerance is of straight lines" in text
    assert text[text.index("leaves") : text.index("of their")] == curve[curve.index("leaves") : curve.index("of their")]
    assert "leaves" not in " ".join(whereabouts.notes(load([], [path[:-1] + ",tolerance=0.1}"])))


def test_times_in_milliseconds_are_told_by_how_slowly_it_would_be_driven(tmp_path):
    rows = [(1000 * k, 2 * np.cos(0.1 * k), np.sin(0.1 * k)) for k in range(40)]
    with pytest.raises(agvjax.InputError, match=r"0\.0002 m/s at most; if they are in ms, say columns"):
        track(written(tmp_path, "t,x,y", rows))
    told = '{ t = { column = "t", unit = "ms" } }'
    assert any("it was driven, 0.1" in words for words in track(written(tmp_path, "t,x,y", rows), columns=told)[1])


def test_a_row_of_empty_cells_is_a_hole_and_at_the_end_nothing(tmp_path):
    lines = [f"{k},{0.1 * k * k},1" for k in range(8)]
    file = tmp_path / "track.csv"
    file.write_text("\n".join(["x,y,speed", *lines, ",,", ""]))
    assert len(track(file)[0].scenario.path.points) == 8
    file.write_text("\n".join(["x,y,speed", *lines[:4], ",,", *lines[4:]]))
    with pytest.raises(agvjax.InputError, match="row 6, column x: '' must be a finite number"):
        track(file)
