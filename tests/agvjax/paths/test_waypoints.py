"""Paths through points, noise in a band, records; the files and tables they are made of."""

import tomllib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from agvjax import BandLimitedNoise, Recorded, Waypoints, replace
from agvjax.paths.heading import reference
from tuning import config as configuration
from tuning.config.load import resolve
from tuning.io.csv_file import read

# ------------------------------------------------------------------------------------------------------------- paths


def around(count, radius=2.0):
    """Points on a circle."""
    angle = 2 * np.pi * np.arange(count) / count
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


BENT = np.array([[0.0, 0.0], [1.0, 0.2], [1.8, 1.0], [1.5, 2.4], [0.2, 2.9]])


@jax.jit
def motion(path, times):
    """Reference at times."""
    return jax.vmap(lambda t: reference(path, None, t))(jnp.asarray(times))


def instants(path, count=4001):
    """Times from start to end."""
    return np.linspace(0, float(path.duration), count)


@pytest.mark.parametrize(("count", "off"), [(8, 0.06), (16, 0.014), (32, 0.0035), (64, 0.0009)])
def test_points_on_a_circle_give_its_curvature_and_lap(count, off):
    path = Waypoints.through(around(count), 1.5, closed=True)
    shape = path.geometry()
    np.testing.assert_allclose(shape.curvature, 0.5, rtol=off)  # of second order in the spacing
    clockwise = Waypoints.through(around(count)[::-1], closed=True).geometry(50)
    np.testing.assert_allclose(clockwise.curvature, -0.5, rtol=off)
    np.testing.assert_allclose(shape.speed, 1.5, rtol=1e-5)
    np.testing.assert_allclose(shape.acceleration[:, 1], 1.5**2 / 2, rtol=off)
    np.testing.assert_allclose(shape.acceleration[:, 0], 0, atol=1e-4)
    np.testing.assert_allclose(path.duration, 2 * np.pi * 2 / 1.5, rtol=off**2)
    np.testing.assert_allclose(shape.arc[-1], 4 * np.pi, rtol=off**2)
    np.testing.assert_allclose(np.linalg.norm(shape.position, axis=1), 2, rtol=off**2)


def test_a_closed_path_comes_back_with_the_same_motion():
    speeds = 1 + 0.5 * np.cos(np.arange(12))
    path = Waypoints.through(around(12) * [1.0, 0.6], speeds, closed=True)
    lap, times = float(path.duration), np.array([0.0, 0.3, 2.0, 5.0])
    now, later = motion(path, times), motion(path, times + 3 * lap)
    jax.tree.map(lambda mine, wanted: np.testing.assert_allclose(mine, wanted, rtol=0, atol=1e-11), later, now)
    seam = motion(path, [lap - 1e-7, lap + 1e-7])  # in value, first and second derivative
    for one in (seam.position, seam.velocity, seam.acceleration):
        np.testing.assert_allclose(one[0], one[1], atol=1e-5)


@pytest.mark.parametrize("closed", [False, True])
def test_it_passes_through_its_points_at_their_speeds_in_their_order(closed):
    speeds = np.array([0.5, 1.0, 2.0, 1.0, 0.3])
    path = Waypoints.through(BENT, speeds, closed)
    times = instants(path, 200_001)
    ref = motion(path, times)
    away = np.linalg.norm(np.asarray(ref.position)[None] - BENT[:, None], axis=-1)
    at = away.argmin(axis=1)
    assert np.all(np.diff(at) > 0) and at[0] == 0
    np.testing.assert_array_less(away.min(axis=1), 2 * times[1])  # no nearer instant was looked at
    speed = np.linalg.norm(ref.velocity, axis=1)
    np.testing.assert_allclose(speed[at], speeds, rtol=1e-3)
    assert speed.min() > 0.3 * (1 - 1e-3) and speed.max() < 2.0 * (1 + 1e-3)  # nowhere out of the range given
    # to far better than those instants: the distance from the point to the line between two of them
    for point, i in zip(BENT[1:4], at[1:4], strict=True):
        a, b = np.asarray(ref.position[i - 1]), np.asarray(ref.position[i + 1])
        aside = np.linalg.det([b - a, point - a]) / np.linalg.norm(b - a)
        assert abs(aside) < 1e-6 * 3.2  # the path's size
    np.testing.assert_allclose(path(jnp.asarray(0.0)), BENT[0], atol=1e-12)


def test_a_linear_speed_along_a_line_takes_the_time_of_the_logarithm():
    path = Waypoints.through([[0, 0], [3, 4]], [0.5, 2.0])
    np.testing.assert_allclose(path.duration, 5 / 1.5 * np.log(2.0 / 0.5), rtol=1e-12)  # v = .5 + 1.5 s / 5
    t = instants(path, 50)
    s = 0.5 * 5 / 1.5 * np.expm1(1.5 * t / 5)
    ref = motion(path, t)
    np.testing.assert_allclose(ref.position, s[:, None] * [0.6, 0.8], atol=1e-8 * 5)
    np.testing.assert_allclose(ref.velocity, (0.5 + 0.3 * s)[:, None] * [0.6, 0.8], rtol=1e-4)


def test_a_stop_that_is_nearly_one_is_reached_in_finite_time():
    path = Waypoints.through([[0, 0], [1, 0], [2, 1], [3, 1]], [1, 1, 1, 0.01])
    found = path.geometry()
    np.testing.assert_allclose(found.speed[[0, -1]], [1, 0.01], rtol=1e-4)
    np.testing.assert_allclose(found.position[-1], [3, 1], atol=1e-9)
    assert found.speed.min() > 0.0099 and path.duration < 10


def test_derivatives_agree_with_finite_differences():
    path, h = Waypoints.through(BENT, [0.5, 1.0, 2.0, 1.0, 0.7]), 1e-4
    t = instants(path, 30)[1:-1]
    ref, before, after = motion(path, t), motion(path, t - h), motion(path, t + h)
    np.testing.assert_allclose(ref.velocity, (after.position - before.position) / (2 * h), atol=1e-5)
    np.testing.assert_allclose(ref.acceleration, (after.velocity - before.velocity) / (2 * h), atol=1e-3)
    np.testing.assert_allclose(ref.heading, np.arctan2(*np.asarray(ref.velocity).T[::-1]), atol=1e-12)
    np.testing.assert_allclose(ref.heading_rate, (after.heading - before.heading) / (2 * h), atol=1e-3)
    # the acceleration is continuous, at the points too
    steps = np.abs(np.diff(np.asarray(motion(path, instants(path)).acceleration), axis=0))
    assert steps.max() < 0.05


def test_an_open_path_ends_standing_and_still_looking_ahead():
    path = Waypoints.through([[0, 0], [3, 4]], 2.0)
    begin, end, after = (jax.tree.map(lambda x, i=i: x[i], motion(path, [0.0, 2.5, 3.5])) for i in range(3))
    np.testing.assert_allclose(begin.velocity, [1.2, 1.6], rtol=1e-6)  # nothing is halved at either end
    np.testing.assert_allclose(end.position, [3, 4], atol=1e-7)
    np.testing.assert_allclose(after.position, [3, 4], atol=1e-7)
    np.testing.assert_array_equal(after.velocity, [0, 0])
    np.testing.assert_allclose([end.heading, after.heading], np.arctan2(4, 3), rtol=1e-6)
    assert float(after.heading_rate) == 0.0


def test_another_duration_runs_the_same_path_at_another_pace():
    path = Waypoints.through(BENT)
    slow = replace(path, {"duration": 2 * path.duration})
    t = jnp.asarray(1.3)
    np.testing.assert_allclose(slow(2 * t), path(t), rtol=1e-14)
    np.testing.assert_allclose(motion(slow, [2 * t]).velocity, motion(path, [t]).velocity / 2, rtol=1e-12)


def test_single_precision_keeps_the_time():
    path = Waypoints.through(around(16), 1.5, closed=True)
    small = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), path)
    t = np.linspace(0, 2 * float(path.duration), 500).astype(np.float32)
    exact, found = motion(path, t.astype(float)), motion(small, t)
    assert found.acceleration.dtype == jnp.float32
    for name, most in {"position": 2e-5, "velocity": 2e-5, "acceleration": 1e-4}.items():
        np.testing.assert_allclose(getattr(found, name), getattr(exact, name), atol=most)


@pytest.mark.slow
def test_a_vehicle_follows_it():
    path = Waypoints.through(around(12, 1.0) + [-1.0, 0.0], 0.5, closed=True)
    scenario = agvjax.Scenario(path=path)
    assert agvjax.check(scenario).path.coefficients.dtype == jnp.float64
    law = agvjax.Backstepping()
    run = agvjax.simulate(law, scenario, dt=2e-3, n_steps=3000, save_every=300, dtype=jnp.float32)
    assert bool(run.ok) and run.position.dtype == jnp.float32
    np.testing.assert_allclose(run.reference_position, jax.vmap(path)(2e-3 * jnp.arange(0, 3001.0, 300)), atol=1e-5)
    assert np.linalg.norm(run.position[-1] - run.reference_position[-1]) < 0.1


@pytest.mark.parametrize(
    ("points", "speed", "closed", "said"),
    [
        ([[0, 0]], None, False, "points must be at least 2 for an open path; given 1"),
        ([[0, 0], [1, 0]], None, True, "points must be at least 3 for a closed path; given 2"),
        ([[0, 0], [1, np.nan]], None, False, "points must be finite; number 2 is not"),
        ([[0, 0], [1, 0], [1, 0]], None, False, "number 2 and number 3 are equal"),
        ([[0, 0], [1, 0], [1, 1e-6], [2, 0]], None, False, "number 2 and number 3 are only 1e-06 m apart, against 1 m"),
        ([[0, 0], [1, 0], [1, 1e-3], [1, 2e-3], [2, 0]], None, False, "number 2 and number 3 are only 0.001 m apart"),
        ([[0, 0], [1e-3, 0], [1, 0], [2, 0]], None, False, "number 1 and number 2 are only 0.001 m apart"),
        ([[0, 0], [1, 0], [1, 1], [1e-3, 0]], None, True, "a closed path needs no repetition of its first point"),
        ([[0, 0], [1, 0], [1, 1], [0, 0]], None, True, "a closed path needs no repetition of its first point"),
        ([[0, 0], [1, 0]], 0.0, False, "speed must be > 0; it is 0"),
        ([[0, 0], [1, 0]], [1, -2], False, "speed must be > 0; number 2 is -2"),
        ([[0, 0], [1, 0]], [1, np.inf], False, "speed must be finite; number 2 is not"),
        ([[0, 0], [1, 0]], [1, 1, 1], False, "one for each of 2 points"),
        ([0, 1, 2], None, False, "points must be of shape"),
        ([[0, 0], [1]], None, False, "points must be numbers, as many in every row"),
        ([[0, 0], ["a", 1]], None, False, "points must be numbers"),
        ([[0, 0], [1, 0], [2, 0], [1.9, 0], [3, 0]], None, False, "from number 3 to number 4 it goes back by 0.1 m"),
        ([[0, 0], [1, 0], [1, 1], [-1, 1], [-1, 0], [0.1, 0]], None, True, "passed number 1 before number 6"),
        ([[0, 0], [1, 0], [1, 1], [-1, 1], [-1, 0], [-0.1, 0], [0.8, 0]], None, True, "1 before number 7"),
        ([[0, 0], [1, 0], [0, 0]], None, False, "near its sharpest turn at x = 1 m, y = 0 m"),
    ],
)
def test_what_no_path_can_be_made_of_is_said(points, speed, closed, said):
    with pytest.raises(ValueError, match=said):
        Waypoints.through(points, speed, closed)


def test_points_may_lie_much_closer_in_a_bend_than_on_a_straight():
    turn = np.linspace(0, np.pi / 2, 12)
    bend = np.c_[1 - np.cos(turn), np.sin(turn)]
    path = Waypoints.through(np.r_[[[0, -60], [0, -30]], bend, [[30, 1], [60, 1]]])  # 0.14 m beside 30 m
    assert len(path.points) == 16


@pytest.mark.parametrize("turns", [1.02, 1.1])
def test_a_lap_that_runs_past_its_beginning_is_named(turns):
    """As a recorder writes it that was stopped a little late: joined to its first point it would be a hook."""
    angle = np.linspace(0, 2 * np.pi * turns, 30)
    lap = np.c_[10 * np.cos(angle), 6 * np.sin(angle)] + np.random.default_rng(0).normal(size=(30, 2)) * 0.02
    with pytest.raises(ValueError, match="it has passed number 1 before number 30; leave out the last ones"):
        Waypoints.through(lap, closed=True)
    assert np.abs(Waypoints.through(lap[angle < 2 * np.pi - 0.1], closed=True).geometry().curvature).max() < 0.5


@pytest.mark.parametrize(
    ("points", "closed"),
    [
        ([[0, 0], [10, 1], [0, 2], [10, 3], [0, 4]], False),  # there and back, between long legs
        ([[0, 0], [10, 0], [10, 0.5], [0, 0.5]], True),
        ([[10, 0], [5, 1], [0, 0]], True),
        (np.c_[np.arange(0.0, 20), 0.2 * np.sin(np.arange(0.0, 20))], True),  # closed by a long way back
        (np.c_[10 * np.sin(np.arange(0.1, 6.3, 0.3)), 5 * np.sin(2 * np.arange(0.1, 6.3, 0.3))], True),
    ],
)
def test_sharp_turns_and_a_crossing_are_no_slip(points, closed):
    try:
        Waypoints.through(points, closed=closed)
    except ValueError as error:
        assert "go on along the path" not in str(error)


# ------------------------------------------------------------------------------------------------------- disturbances


def samples(disturbance, count=2**16, dt=0.05, dtype=float):
    """Values at times."""
    return np.asarray(jax.jit(jax.vmap(disturbance))(jnp.asarray(dt * np.arange(count), dtype)))


def test_noise_has_its_root_mean_square_and_nothing_outside_its_band():
    rms = np.array([0.1, 0.2, 0.3])
    found = samples(BandLimitedNoise(amplitude=rms, low=2.0, high=6.0, seed=3.0))
    np.testing.assert_allclose(np.sqrt(np.mean(found**2, axis=0)), rms, rtol=2e-3)
    assert np.abs(np.corrcoef(found.T) - np.eye(3)).max() < 0.05  # the same frequencies in each channel would leave 0.2
    power = np.abs(np.fft.rfft(found * np.hanning(len(found))[:, None], axis=0)) ** 2
    omega = 2 * np.pi * np.fft.rfftfreq(len(found), 0.05)
    outside = (omega < 2.0) | (omega > 6.0)
    assert np.all(power[outside].sum(axis=0) < 1e-6 * power.sum(axis=0))
    for low in (2.0, 3.0, 4.0, 5.0):  # as much in one quarter as in another
        part = power[(omega >= low) & (omega < low + 1)].sum(axis=0) / power.sum(axis=0)
        np.testing.assert_allclose(part, 0.25, atol=0.02)


def test_noise_is_a_function_of_its_seed_which_may_be_batched():
    t = jnp.asarray(1.7)

    @jax.jit
    def one(seed):
        return BandLimitedNoise(seed=seed)(t)

    seeds = jnp.arange(5.0)
    found = np.asarray(jax.vmap(one)(seeds))
    assert np.unique(found.round(9)).size == 15  # every seed and channel another
    np.testing.assert_allclose(found[3], BandLimitedNoise(seed=3.0)(t), rtol=1e-12)
    np.testing.assert_array_equal(one(seeds[2]), one(seeds[2]))
    np.testing.assert_array_equal(jax.jacfwd(one)(1.0), np.zeros(3))
    single = samples(jax.tree.map(jnp.float32, BandLimitedNoise()), 200, dtype=jnp.float32)
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, samples(BandLimitedNoise(), 200), atol=1e-4)
    twice = BandLimitedNoise(amplitude=0.4)
    np.testing.assert_allclose(twice(t), twice.scale(BandLimitedNoise(amplitude=1.0)(t)), rtol=1e-14)


def test_a_record_is_interpolated_and_held_at_its_ends():
    times, values = np.array([0.5, 1.0, 3.0]), np.array([[0.0, 1, 2], [3, -4, 5], [6, 7, 9]])
    record = Recorded(times=times, values=values, amplitude=np.array([1.0, 2.0, -0.5]))
    t = np.linspace(-1, 4, 41)
    wanted = np.column_stack([np.interp(t, times, column) for column in values.T]) * [1, 2, -0.5]
    np.testing.assert_allclose(jax.vmap(record)(jnp.asarray(t)), wanted, atol=1e-14)
    np.testing.assert_array_equal(Recorded()(jnp.asarray(0.3)), [0, 0, 0])
    assert agvjax.faults(Recorded()) == []
    assert [p.key for p in agvjax.faults(replace(record, {"times": times[::-1]}))] == ["times"]


# ------------------------------------------------------------------------------------------------------------- files


def written(folder, text, name="file.csv"):
    """A file."""
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return str(path)


def test_columns_are_read_by_name(tmp_path):
    text = "\ufeffname, y ,x\r\na,2,1\r\n\r\n,4e0,+3\r\n"  # in any order, after a byte-order mark, between others
    found = read(written(tmp_path, text), ("x", "y"), ("speed",))
    assert set(found) == {"x", "y"}
    np.testing.assert_array_equal(found["x"], [1, 3])
    np.testing.assert_array_equal(found["y"], [2, 4])


@pytest.mark.parametrize(
    "text",
    [
        "# x,y\n1,2\n3,4\n",
        "# 3b5f\n# of today\n# s_m; x; y\n0.0; 1; 2\n# half way\n2.8; 3; 4\n",
        "# made by hand, in m\nx\ty\n1\t2\n3\t4\n",
        "#x y\n 1   2\n 3   4 \n",
        "x, y\n1, 2\n3, 4\n",
        'x;"y"\n1;"2"\n3;4\n;\n',
    ],
)
def test_separators_and_comments_are_understood(text, tmp_path):
    found = read(written(tmp_path, text), ("x", "y"))
    np.testing.assert_array_equal([found["x"], found["y"]], [[1, 3], [2, 4]])


def test_stamps_with_a_date_are_seconds(tmp_path):
    stamps = ["2025-11-28T23:59:59.75Z", "2025-11-29T01:00:00.25+01:00", "2025-11-29 00:00:01"]
    text = "t,x\n" + "".join(f"{stamp},0\n" for stamp in stamps)
    np.testing.assert_allclose(np.diff(read(written(tmp_path, text), ("t", "x"))["t"]), [0.5, 0.75], atol=1e-6)


BAD_FILES = {
    "empty": ("", "is empty; its first row must name the columns t"),
    "blank": (" \n\n", "is empty"),
    "binary": (b"\x89PNG\xff\xfe", "no text file in UTF-8"),
    "zeros": (b"t,x\n\x00\x00,1\n", "no text file"),
    "header": ("t,x\n", "at least 2 rows below its header; it has 0"),
    "one": ("t,x\n0,1\n", "at least 2 rows below its header; it has 1"),
    "column": ("time,x\n0,1\n1,1\n", "has no column t; its first row has time, x"),
    "numbers": ("0,1\n1,2\n2,3\n", "has no column t; it has no header, and its columns are called 1, 2"),
    "decimal commas and points": ("t;x\n0,5;1\n1,5;2.5\n", "one decimal mark: 0,5 in row 2, 2.5 in row 3"),
    "date alone": (
        "t,x\n2025-11-28,1\n2025-11-29,2\n",
        "row 2, column t: '2025-11-28' must be seconds, or a date",
    ),
    "time of day alone": ("t,x\n09:30:00.5,1\n09:30:01,2\n", "where they stand in two columns, make one of them"),
    "date that there is none": ("t,x\n2025-02-30T00:00:00,1\n1,2\n", "'2025-02-30T00:00:00' must be seconds, or a"),
    "twice": ("t,x,x\n0,1,1\n1,1,1\n", "more than one column x"),
    "text": ("t,x\n0,1\n1,fast\n", "row 3, column x: 'fast' must be a finite number"),
    "gap": ("t,x\n0,1\n\n1,\n", "row 4, column x: '' must be a finite number"),
    "nan": ("t,x\n0,nan\n1,1\n", "row 2, column x: 'nan' must be a finite number"),
    "inf": ("t,x\n0,1\n1,-inf\n", "row 3, column x: '-inf' must be a finite number"),
    "ragged": ("t,x\n0,1\n1\n", "row 3: must have 2 cells like its header; it has 1"),
    "time": ("t,x\n0,1\n2,1\n\n2,1\n", "row 5, column t: 2 must be above the time before, which is the same"),
}


@pytest.mark.parametrize("kind", BAD_FILES)
def test_a_bad_file_is_named_with_its_row_and_column(kind, tmp_path):
    text, said = BAD_FILES[kind]
    name = written(tmp_path, text)
    with pytest.raises(ValueError) as raised:
        read(name, ("t",), ("x", "y", "heading"))
    assert said in str(raised.value) and name in str(raised.value)
    shown = wrong({"disturbance": {"type": "recorded", "file": name}})
    assert "scenario.disturbance.file = " in shown and str(raised.value) in shown


def test_a_file_that_is_not_there_or_is_a_folder(tmp_path):
    for name in (tmp_path / "none.csv", tmp_path):
        with pytest.raises(ValueError, match="cannot be read: (No such file|it is a folder)"):
            read(name, ("x",))


def wrong(scenario):
    """What the command line says of a scenario, which is one thing."""
    with pytest.raises(agvjax.InputError) as raised:
        resolve({"scenario": scenario})
    assert len(raised.value.faults) == 1
    return str(raised.value)


# ------------------------------------------------------------------------------------------------------------ tables


def resolved(**scenario):
    """The scenario of a table, once read and once more from what is written of it."""
    config = resolve({"scenario": scenario})
    text = configuration.dump(config)
    assert "file" not in text.partition("[scenario.path]")[2].partition("\n[")[0]
    again = resolve(tomllib.loads(text))
    assert configuration.dump(again) == text
    jax.tree.map(np.testing.assert_array_equal, config.scenario, again.scenario)
    return again.scenario


def test_a_track_from_a_file_is_kept_with_its_numbers(tmp_path):
    rows = np.column_stack([BENT, [0.5, 1.0, 2.0, 1.0, 0.1 + 0.2]])
    text = "x,y,speed\n" + "".join(f"{x!r},{y!r},{v!r}\n" for x, y, v in rows.tolist())
    name = written(tmp_path, text)
    path = resolved(path={"type": "waypoints", "file": name, "closed": True}).path
    np.testing.assert_array_equal(path.points, rows)
    assert path.closed is True
    np.testing.assert_array_equal(path.coefficients, Waypoints.through(BENT, rows[:, 2], True).coefficients)


RACELINE = "# 3b5f\n# s_m; x_m; y_m; vx_kmh\n"


def test_a_racing_line_is_read_by_the_names_of_its_columns(tmp_path):
    rows = np.column_stack([around(8), np.linspace(3.6, 7.2, 8)])
    text = RACELINE + "".join(f"0;{100 * x!r};{y!r};{v!r}\n" for x, y, v in [*rows.tolist(), rows[0].tolist()])
    columns = {"x": {"column": "x_m", "unit": "cm"}, "y": "y_m", "speed": {"column": "vx_kmh", "unit": "km/h"}}
    table = {"type": "waypoints", "file": written(tmp_path, text), "columns": columns, "closed": True}
    with pytest.warns(UserWarning, match="s_m not read$"):
        path = resolved(path=table).path  # that ends where it begins
    np.testing.assert_allclose(path.points, rows * [1, 1, 1 / 3.6], rtol=1e-12)
    columns["speed"] = ""
    with pytest.warns(UserWarning, match=r"s_m, vx_kmh not read; no column speed: 1 m/s \(scenario.path.speed"):
        np.testing.assert_array_equal(resolved(path=table).path.points[:, 2], 1.0)


def test_a_record_is_read_by_the_names_of_its_columns(tmp_path):
    name = written(tmp_path, "ms,push,x\n0,1,5\n500,-1,5\n")
    columns = {"t": {"column": "ms", "unit": "ms"}, "y": {"column": "push", "factor": -2}, "x": ""}
    push = resolved(disturbance={"type": "recorded", "file": name, "columns": columns}).disturbance
    np.testing.assert_array_equal(push.times, [0, 0.5])
    np.testing.assert_array_equal(push.values, [[0, -2, 0], [0, 2, 0]])


@pytest.mark.parametrize(
    ("columns", "key", "said"),
    [
        ({"x": "x_m", "z": "y_m"}, "columns.z", "one of x, y, speed"),
        ({"x": 3}, "columns.x", '"the name of a column"'),
        ({"x": {"column": "x_m", "unit": "s"}, "y": "y_m"}, "columns.x.unit", "one of m, cm, mm"),
        ({"x": {"column": "x_m", "nanoseconds": "y_m"}}, "columns.x.nanoseconds", "left out but for t"),
        ({"x": "", "y": "y_m"}, "columns.x", "the name of a column"),
        ({"x": "x_m", "y": "y_m", "speed": "v"}, "file", "has no column v; its first row has s_m, x_m, y_m, vx_kmh"),
        ({"y": "y_mm"}, "file", 'or others named in columns = { x = "its name" }'),
        ("x_m", "columns", "a table of columns by name"),
    ],
)
def test_columns_that_are_none_are_named_with_their_key(columns, key, said, tmp_path):
    name = written(tmp_path, RACELINE + "0;1;2;1\n0;2;3;1\n")
    found = wrong({"path": {"type": "waypoints", "file": name, "columns": columns}})
    assert f"scenario.path.{key} = " in found and said in found


def test_a_track_in_place():
    path = resolved(path={"type": "waypoints", "points": BENT.tolist(), "speed": 2}).path
    np.testing.assert_array_equal(path.points, np.column_stack([BENT, np.full(5, 2.0)]))
    fast = resolved(path={"type": "waypoints", "points": [[0, 0, 1], [1, 1, 3], [2, 1, 1.5]]}).path
    np.testing.assert_array_equal(fast.points[:, 2], [1, 3, 1.5])
    assert fast.closed is False


def test_a_record_from_a_file_and_in_place(tmp_path):
    name = written(tmp_path, "heading,t,x\n0.1,0,1\n0.2,0.5,-1\n")
    push = resolved(disturbance={"type": "recorded", "file": name, "amplitude": 0.5}).disturbance
    np.testing.assert_array_equal(push.times, [0, 0.5])
    np.testing.assert_array_equal(push.values, [[1, 0, 0.1], [-1, 0, 0.2]])
    assert push.amplitude == 0.5
    given = {"type": "recorded", "times": [0, 1], "values": [[0, 0, 0], [1, 2, 3]], "amplitude": [1, 0, 2]}
    np.testing.assert_array_equal(resolved(disturbance=given).disturbance(jnp.asarray(0.5)), [0.5, 0, 3])


def test_noise_from_a_table():
    given = {"type": "band_limited_noise", "amplitude": [0.1, 0.2, 0.3], "low": 1.5, "high": 3, "seed": 7, "terms": 12}
    noise = resolved(disturbance=given).disturbance
    assert (noise.low, noise.high, noise.seed, noise.terms) == (1.5, 3.0, 7.0, 12)
    np.testing.assert_array_equal(noise.amplitude, [0.1, 0.2, 0.3])


ROUTE, PUSH = {"type": "waypoints"}, {"type": "recorded"}
LINE, ENDS = [[0, 0], [1, 1]], {"times": [0, 1], "values": [[0, 0, 0], [1, 1, 1]]}


@pytest.mark.parametrize(
    ("scenario", "key", "said"),
    [
        ({"path": "waypoints"}, "path.file", "the name of a CSV file, where there are no points"),
        ({"path": ROUTE | {"file": 3}}, "path.file", "the name of a file"),
        ({"path": ROUTE | {"file": "nowhere.csv"}}, "path.file", "cannot be read: No such file"),
        ({"path": ROUTE | {"file": "a", "points": LINE}}, "path.points", "absent where there is a file"),
        ({"path": ROUTE | {"points": LINE, "closed": 1}}, "path.closed", "true or false"),
        ({"path": ROUTE | {"points": LINE, "closed": True}}, "path.points", "at least 3 for a closed path; given 2"),
        ({"path": ROUTE | {"points": [[0, 0], [1]]}}, "path.points", "a list of [x, y]"),
        ({"path": ROUTE | {"points": [[0, 0], ["a", 1]]}}, "path.points", "a list of [x, y]"),
        ({"path": ROUTE | {"points": []}}, "path.points", "a list of [x, y]"),
        ({"path": ROUTE | {"points": [[1, 2, 3, 4]]}}, "path.points", "a list of [x, y]"),
        ({"path": ROUTE | {"points": [[0, 0], [0, 0]]}}, "path.points", "number 1 and number 2 are equal"),
        ({"path": ROUTE | {"points": [[0, 0], [float("nan"), 0]]}}, "path.points", "number 2 is not"),
        ({"path": ROUTE | {"points": [[0, 0, 1], [1, 0, 0]]}}, "path.points", "speed must be > 0; number 2 is 0"),
        ({"path": ROUTE | {"points": LINE, "speed": -1.0}}, "path.speed", "speed must be > 0"),
        ({"path": ROUTE | {"points": LINE, "speed": "fast"}}, "path.speed", "a number > 0 in m/s"),
        ({"path": ROUTE | {"points": [[0, 0, 1], [1, 0, 1]], "speed": 2}}, "path.speed", "absent where the points"),
        ({"path": ROUTE | {"points": LINE, "sped": 1}}, "path.sped", "did you mean speed?"),
        ({"disturbance": "recorded"}, "disturbance.file", "where there are no times"),
        ({"disturbance": PUSH | {"times": [0, 1]}}, "disturbance.values", "a list of [x, y, heading]"),
        ({"disturbance": PUSH | ENDS | {"times": [0, 0]}}, "disturbance.times", "each above the one before"),
        ({"disturbance": PUSH | ENDS | {"values": [[0, 0, 0]]}}, "disturbance.values", "2 finite [x, y, heading]"),
        ({"disturbance": PUSH | ENDS | {"amplitude": "big"}}, "disturbance.amplitude", "a number"),
        ({"disturbance": PUSH | ENDS | {"amplitude": float("inf")}}, "disturbance.amplitude", "finite"),
        ({"disturbance": PUSH | ENDS | {"amplitude": [1, 2]}}, "disturbance.amplitude", "array of shape (3,)"),
        ({"disturbance": {"type": "band_limited_noise", "terms": 0}}, "disturbance.terms", "a whole number >= 1"),
        ({"disturbance": {"type": "band_limited_noise", "terms": 2.5}}, "disturbance.terms", "a whole number >= 1"),
        ({"disturbance": {"type": "band_limited_noise", "low": -1}}, "disturbance.low", ">= 0"),
    ],
)
def test_a_bad_table_is_named_with_its_key(scenario, key, said, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    found = wrong(scenario)
    assert f"scenario.{key} = " in found and said in found


def test_a_record_without_a_channel_is_no_record(tmp_path):
    name = written(tmp_path, "t,push\n0,1\n1,2\n")
    assert "at least one of the columns x, y, heading" in wrong({"disturbance": PUSH | {"file": name}})
