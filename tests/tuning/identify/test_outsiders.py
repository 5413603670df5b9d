"""Logs as people bring them: a robot that never moves, headings at pi, short levers, wild cells."""

import csv
import json
import warnings
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from agvjax import Fault
from claimed import meant, unqualified
from tuning import config as configuration
from tuning.cli.main import main
from tuning.config.load import resolve
from tuning.identify import figures
from tuning.identify import task as tasks
from tuning.identify.load import load
from tuning.identify.log import moved, same_drive, white_noise
from tuning.identify.parameters import Parameter, parameters
from tuning.identify.predict import Prediction
from tuning.identify.segments import cut, leaps
from tuning.identify.states import first_states
from tuning.identify.verdict import _edge
from tuning.io.csv_file import LARGEST, Column

pytestmark = pytest.mark.slow  # whole commands and programs, minutes in all

HEADER = ("t", "x", "y", "heading", "vx", "vy", "acceleration", "yaw_acceleration")
NOISE = np.array([2e-3, 2e-3, 1e-3, 4e-3, 4e-3])


def circling(lever=0.4, heading=0.0, rows=600, step=0.02, noise=NOISE):
    """A body on a circle whose speed swings, by hand: the reference point is `lever` ahead of its axle."""
    t = step * np.arange(rows)
    v, w = 0.8 + 0.3 * np.sin(1.1 * t), 0.5 + 0.4 * np.sin(0.7 * t)
    psi = heading + 0.5 * t + 0.4 / 0.7 * (1 - np.cos(0.7 * t))
    rate = np.stack([v * np.cos(psi) - lever * w * np.sin(psi), v * np.sin(psi) + lever * w * np.cos(psi)])
    place = np.cumsum(rate, axis=1) * step
    seen = np.stack([*place, psi, *rate], axis=1) + np.random.default_rng(0).normal(size=(rows, 5)) * noise
    return np.column_stack([t, seen, 0.33 * np.cos(1.1 * t), 0.28 * np.cos(0.7 * t)])


def still(rows=1000, size=0.1):
    """A robot that stays where it is, whatever it is told."""
    t = 0.02 * np.arange(rows)
    seen, u = np.random.default_rng(1).normal(size=(rows, 5)) * NOISE, size * np.sin(2 * t)
    return np.column_stack([t, seen, u, u])


def written(file, rows, header=HEADER):
    with open(file, "w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(header)
        writer.writerows([["" if np.isnan(x) else repr(float(x)) for x in row] for row in rows])
    return str(file)


@pytest.fixture
def log_of(tmp_path):
    """Rows as a log of a unicycle."""
    return lambda rows, columns={}, header=HEADER: load(
        written(tmp_path / "log.csv", rows, header), agvjax.Unicycle(), columns
    )


@pytest.fixture
def refusal(log_of):
    """The faults that rows are refused for."""

    def faults(rows, columns=None, header=HEADER) -> list[Fault]:
        with pytest.raises(agvjax.InputError) as error:
            log_of(rows, columns or {}, header)
        return error.value.faults

    return faults


# ---- what a model lacks

SKID = """
[scenario.plant]
type = "differential_drive"
drive = { type = "speed", gain = 40 }
mass = 500
inertia = 800
L = 0.05
wheel_radius = 0.3
track = 1.9
friction = 0.0
viscous = 0.0
[scenario.deadzone]
wheel_speed_left = { slope_right = 1.0, slope_left = 1.0, threshold_right = 0.1, threshold_left = 0.1 }
wheel_speed_right = { slope_right = 1.0, slope_left = 1.0, threshold_right = 0.1, threshold_left = 0.1 }
[identify]
drives = 0
fit = ["deadzone", "delay", "plant.track", "plant.drive.gain", "plant.inertia"]
segment = 3.0
"""


def skidding(rows=4000, step=0.05, late=5, radius=0.3, track=1.165, lever=0.05):
    """A skid-steer by hand: all is 0.25 s late, speed lags 0.55 s, a turn builds up in 6 s and ends in 0.3 s."""
    rng, many = np.random.default_rng(1), rows // 120 + 1
    v, w = (np.repeat(rng.uniform(*ends, many), 120)[:rows] for ends in ((-1.5, 1.6), (-1.2, 1.2)))
    x = y = psi = speed = turn = 0.0
    table = np.empty((rows, 7))
    for i in range(rows):
        pose = x + lever * np.cos(psi), y + lever * np.sin(psi), psi
        table[i] = (i * step, *pose, turn, (v[i] - w[i] * track / 2) / radius, (v[i] + w[i] * track / 2) / radius)
        asked, h, wanted = max(i - late, 0), step / 10, 0.8 * w[max(i - late, 0)]
        for _ in range(10):
            x, y, psi = x + speed * np.cos(psi) * h, y + speed * np.sin(psi) * h, psi + turn * h
            speed += (0.95 * v[asked] - speed) / 0.55 * h
            turn += (wanted - turn) / (6.0 if abs(wanted) > abs(turn) and wanted * turn >= 0 else 0.3) * h
    table[:, 1:5] += rng.normal(size=(rows, 4)) * [0.03, 0.03, 0.01, 0.02]
    table[1::2, 1:4] = np.nan
    return table


def test_a_delay_that_the_model_bends_is_not_told(tmp_path):
    """The model turns as fast as it stops turning; its delays would be 0.20 and 0.17 s, with intervals below 0.25."""
    (tmp_path / "c.toml").write_text(SKID)
    header = ("t", "x", "y", "heading", "yaw_rate", "wheel_speed_left", "wheel_speed_right")
    log, out = written(tmp_path / "log.csv", skidding(), header), tmp_path / "out"
    assert main(["identify", log, "--config", str(tmp_path / "c.toml"), "--out", str(out), "--quiet"]) == 1
    found = json.loads((out / "estimates.json").read_text())["parameters"]
    for name in ("actuators.wheel_speed_left.delay.time", "actuators.wheel_speed_right.delay.time"):
        assert not found[name]["identified"] or found[name]["low"] <= 0.25 <= found[name]["high"]
    report = (out / "report.md").read_text()
    assert meant(report) == ["95 % interval"] and not unqualified(report)
    assert "how it turns" in report and "not good: they explain the drive no better than a first-order lag" in report


# ---- a robot that never moved


def test_whether_anything_moved(log_of):
    assert moved(log_of(circling())) and not moved(log_of(still()))
    coarse = still()
    coarse[:, 1:6] = np.round(coarse[:, 1:6], 2)  # a sensor that flickers between two of its steps
    assert not moved(log_of(coarse))
    crept = still()
    crept[:, 1] += 0.02 * crept[:, 0] / crept[-1, 0]  # 2 cm in 20 s
    assert moved(log_of(crept))


def test_a_robot_that_never_moved_tells_nothing(tmp_path):
    """Not a threshold, not a push of 0, and no prediction; what was assumed stays, and is said to."""
    log, other, out = still(600), written(tmp_path / "other.csv", circling()), tmp_path / "out"
    options = ["--fit", "deadzone,disturbance", "--unseen", other, "--set", "identify.starts=1", "--quiet"]
    options += ["--set", "identify.bootstrap=5", "--set", "identify.drives=0", "--set", "scenario.plant=unicycle"]
    assert main(["identify", written(tmp_path / "log.csv", log), *options, "--out", str(out)]) == 1
    told = json.loads((out / "estimates.json").read_text())
    assert told["parameters"] and not any(e["identified"] for e in told["parameters"].values())
    assert told["predictions"] == [] and not (out / "predictions.png").exists()
    report = (out / "report.md").read_text()
    assert "Nothing is identified" in report and "agvjax tune" not in report
    before, after = resolve({"scenario": {"plant": "unicycle"}}), configuration.load([str(out / "scenario.toml")], [])
    assert agvjax.leaves(after.scenario).keys() == agvjax.leaves(before.scenario).keys()
    for name, value in agvjax.leaves(before.scenario).items():
        assert np.array_equal(agvjax.leaves(after.scenario)[name], value), name
        if name.startswith("deadzone."):
            draw = after.ensemble.draws[name]
            assert (draw.low, draw.high) == (0.5, 1.5)
            kept = f"drawn from {0.5 * float(value):.4g} to {1.5 * float(value):.4g}, as assumed"
            assert any(name in line and kept in line for line in report.splitlines())


def posed(low=0.0, high=0.1, least="", most="above"):
    return Parameter("deadzone.a.threshold_right", "1", 0.05, low, high, 0.05, 0.005, least, most)


def test_one_number_of_a_deadzone_may_be_fitted_alone(tmp_path):
    """The others stay as they are assumed, by which the fit is no good; the picture is drawn all the same."""
    out, fitted = tmp_path / "out", "deadzone.acceleration.slope_right"
    options = ["--fit", fitted, "--set", "scenario.plant=unicycle", "--quiet"]
    options += [x for key in ("starts=1", "bootstrap=5", "drives=0") for x in ("--set", f"identify.{key}")]
    assert main(["identify", written(tmp_path / "log.csv", circling()), *options, "--out", str(out)]) == 1
    assert set(json.loads((out / "estimates.json").read_text())["parameters"]) == {fitted}
    assert (out / "deadzones.png").exists()
    before, after = resolve({"scenario": {"plant": "unicycle"}}), configuration.load([str(out / "scenario.toml")], [])
    changed = [
        n for n, x in agvjax.leaves(after.scenario).items() if not np.array_equal(x, agvjax.leaves(before.scenario)[n])
    ]
    assert set(changed) <= {fitted}


def test_a_value_at_or_near_the_end_of_where_it_was_looked_for_is_a_bound():
    assert "ends at 0.1" in _edge(posed(), 0.1, 1e-6, 0.0)
    assert "ends at 0.0951" in _edge(posed(), 0.0951, 1e-6, 0.0)  # within a twentieth of the largest command
    assert "its interval reaches 0.1" in _edge(posed(), 0.09, 0.0101, 0.0)
    assert _edge(posed(), 0.09, 0.0099, 0.0) == ""
    assert _edge(posed(), 0.0, 0.01, 0.0) == ""  # no threshold at all is a value, as nothing lies below 0
    assert "the log pushes beyond it" in _edge(posed(), 0.0, 0.01, -3.1)
    assert "shift" in _edge(posed(low=0.006, high=6, least="shift"), 0.0061, 0.0, 0.0)
    assert "ends at 0.006" in _edge(posed(low=0.006, high=6, least="shift"), 0.006, 0.0, 0.0)


def test_edges_say_what_moves_them(log_of):
    config = resolve({"scenario": {"plant": "unicycle"}, "identify": {"fit": ["deadzone", "delay", "lag", "vehicle"]}})
    model = tasks.model_of(config, HEADER[1:6], HEADER[6:], 0.02)
    wanted = {q.name: q for q in parameters(model.scenario, model.names, [log_of(circling())], 0.01, 0.7)}
    delay = wanted["actuators.acceleration.delay.time"]
    assert delay.high == 0.7 and "longer than 0.7 s, identify.memory" in delay.most and delay.least == ""
    assert wanted["actuators.acceleration.lag.time_constant"].high == 1.4
    assert "must be above 0: shift the pose" in wanted["plant.L"].least
    threshold = wanted["deadzone.acceleration.threshold_left"]
    assert threshold.high == pytest.approx(0.33, abs=1e-3) and "a bound at best" in threshold.most
    assert all(q.low <= q.nominal <= q.high for q in wanted.values())


# ---- headings


@pytest.mark.parametrize("turns", ["pi", "two pi", "degrees"])
def test_headings_beyond_a_turn_are_those_without_leaps(log_of, turns):
    """The same drive with its headings as they are and within a turn: nothing is left out of either, and they agree."""
    rows = circling(heading=np.pi - 0.1)
    whole, folded = log_of(rows), rows.copy()
    folded[:, 3] = np.angle(np.exp(1j * rows[:, 3])) if turns == "pi" else rows[:, 3] % (2 * np.pi)
    folded[:, 3] *= 180 / np.pi if turns == "degrees" else 1
    log = log_of(folded, {"heading": Column("heading", "deg")} if turns == "degrees" else {})
    assert np.ptp(folded[:, 3]) > 6 and not leaps(log).any() and not leaps(whole).any()
    off = log.measured["heading"] - whole.measured["heading"]
    assert np.allclose(off, 2 * np.pi * np.round(off[0] / (2 * np.pi)), atol=1e-6)
    assert white_noise([log.measured["heading"]]) == pytest.approx(1e-3, rel=0.15)


def test_a_heading_that_is_no_angle_is_refused(refusal):
    rows = circling()
    rows[:, 3] = np.sin(rows[:, 3] / 2)  # of a quaternion
    (fault,) = refusal(rows)
    assert fault.key == "identify.columns.heading" and "2 atan2(z, w)" in fault.rule


@pytest.mark.parametrize("skew", [0.12, -0.3])
def test_a_heading_that_is_off_by_one_angle_throughout_is_refused(refusal, log_of, skew):
    """A sensor mounted askew on a vehicle that turns to both sides.

    What the reference point swings out by is no such angle, and a wild place shows none.
    """
    t = 0.02 * np.arange(1500)
    v, w = 0.8 + 0.3 * np.sin(1.1 * t), 0.6 * np.cos(0.5 * t)
    psi = 1.2 * np.sin(0.5 * t)
    rate = np.stack([v * np.cos(psi) - 0.4 * w * np.sin(psi), v * np.sin(psi) + 0.4 * w * np.cos(psi)])
    seen = np.stack([*np.cumsum(rate, axis=1) * 0.02, psi]).T
    seen += np.random.default_rng(0).normal(size=seen.shape) * NOISE[:3]
    rows, header = np.column_stack([t, seen, v, w]), HEADER[:4] + HEADER[6:]
    rows[700, 1:3] += 30.0
    log_of(rows, header=header)
    rows[:, 3] -= skew
    (fault,) = refusal(rows, header=header)
    assert fault.key == "identify.columns.heading"
    assert float(fault.rule.partition("add ")[2].split()[0]) == pytest.approx(skew, abs=0.02)


def test_a_unit_of_another_kind_is_answered_with_those_of_its_own(refusal):
    (fault,) = refusal(circling(), {"heading": Column("heading", "quaternion")})
    assert fault.key == "identify.columns.heading.unit" and fault.rule.startswith("one of rad, deg; a quaternion is")


def test_velocities_of_the_vehicle_s_own_frame_are_refused(refusal, log_of):
    rows = circling()
    c, s = np.cos(rows[:, 3]), np.sin(rows[:, 3])
    rows[:, 4:6] = np.stack([rows[:, 4] * c + rows[:, 5] * s, rows[:, 5] * c - rows[:, 4] * s], axis=1)
    faults = refusal(rows)
    assert {fault.key for fault in faults} == {"identify.columns.vx", "identify.columns.vy"}
    assert all("frame of the vehicle" in fault.rule for fault in faults)
    log = log_of(rows, {"speed": Column("vx"), "vy": Column("")})  # as the refusal says
    assert "speed" in log.measured and not {"vx", "vy"} & set(log.measured)


def test_a_yaw_rate_that_counts_the_other_way_and_a_speed_without_sign_are_refused(refusal):
    rows = circling()
    turn = np.gradient(rows[:, 3], 0.02)
    (fault,) = refusal(np.column_stack([rows, -turn]), header=(*HEADER, "yaw_rate"))
    assert fault.key == "identify.columns.yaw_rate" and "factor = -1" in fault.rule
    back = circling()
    back[:, 3] += np.pi  # it drives backwards
    (fault,) = refusal(np.column_stack([back, np.hypot(back[:, 4], back[:, 5])]), header=(*HEADER, "speed"))
    assert fault.key == "identify.columns.speed"


# ---- states, and pictures of them


@pytest.mark.parametrize("lever", [0.4, 0.02])
def test_a_stretch_begins_with_the_yaw_rate_of_its_headings(log_of, lever):
    """However short the lever by which the velocity tells it too; half of the poses are not there."""
    rows = circling(lever, noise=np.array([3e-2, 3e-2, 1e-3, 4e-3, 4e-3]), rows=1200)
    rows[1::2, 1:4] = np.nan
    log = log_of(np.delete(rows, [4, 5], axis=1), header=[name for name in HEADER if name not in ("vx", "vy")])
    config = resolve({"scenario": {"plant": {"type": "unicycle", "L": lever}}, "identify": {"fit": ["deadzone"]}})
    model = tasks.model_of(config, ("x", "y", "heading"), HEADER[6:], 0.02)
    segments, _ = cut([log], 2.0, 0.5, 5.0)
    states = first_states(model, [log], segments)
    t = np.array([log.t[rows[live > 0][0]] for rows, live in zip(segments.rows, segments.live, strict=True)]) + 0.15
    assert model.start(jnp.zeros(6)).size == 5
    assert np.abs(states[:, 4] - (0.5 + 0.4 * np.sin(0.7 * t))).max() < 0.05


def test_lines_of_predictions_go_on_over_rows_without_a_measurement():
    t = np.tile(np.arange(6.0), (2, 1))
    errors = np.where(np.arange(6) % 2 == 0, 1e-3, np.nan) * np.ones((2, 1))
    figure = figures.predictions([Prediction("log", 5.0, 2, 1e-3, 1e-3, t, errors)])
    assert [len(line.get_xdata()) for line in figure.axes[0].lines] == [3, 3]


# ---- cells and settings


@pytest.mark.parametrize("wild", [1e10, 1e20, -9e29])
def test_a_wild_cell_is_an_outlier(log_of, wild):
    rows = circling()
    rows[100, 1] = wild
    log = log_of(rows)
    segments, counts = cut([log], 2.0, 0.5, 5.0)
    assert counts.outliers == 1 and np.abs(segments.seen).max() < 100


@pytest.mark.parametrize("text", ["1.7976931348623157e308", "-1e100", "1e400", "1_0", "١٠", "0x10", "infinity", "1 0"])
def test_what_is_no_usual_number_is_refused(tmp_path, text):
    lines = Path(written(tmp_path / "log.csv", circling())).read_text().splitlines()
    cells = lines[5].split(",")
    lines[5] = ",".join([cells[0], text, *cells[2:]])
    (tmp_path / "log.csv").write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(agvjax.InputError, match="row 6, column x.*left empty where nothing was measured"):
        load(str(tmp_path / "log.csv"), agvjax.Unicycle(), {})


def test_an_absurd_factor_and_a_wild_command_are_refused(refusal):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (fault,) = refusal(circling(), {"x": Column("x", factor=1e300)})
    assert fault.key == "identify.columns.x.factor" and f"{LARGEST:g}" in fault.rule
    rows = circling()
    rows[70, 6] = 1e9
    (fault,) = refusal(rows)
    assert fault.key == "identify.columns.acceleration" and "t = 1.4 s" in str(fault.value)


@pytest.mark.parametrize("stamp", ["31/01/2030 12:00", "12:00:00.02"])
def test_a_time_that_is_no_whole_date_is_answered_with_what_to_write(tmp_path, stamp):
    header, *lines = Path(written(tmp_path / "log.csv", circling())).read_text().splitlines()
    dated = [",".join([stamp, *line.split(",")[1:]]) for line in lines]
    (tmp_path / "log.csv").write_text("\n".join([header, *dated]))
    with pytest.raises(agvjax.InputError, match="row 2, column t.* must be seconds, or a date with a time of day"):
        load(str(tmp_path / "log.csv"), agvjax.Unicycle(), {})


def test_seconds_and_nanoseconds_stand_in_two_columns(tmp_path, refusal, log_of):
    rows = circling()
    ns = np.round(rows[:, 0] * 1e9)
    stamps = np.column_stack([1.7e9 + ns // 1e9, ns % 1e9, rows[:, 1:]])
    header = ("sec", "nanosec", *HEADER[1:])
    (fault,) = refusal(stamps, {"t": Column("sec")}, header)
    assert 'nanoseconds = "its name"' in fault.rule
    columns = {"t": Column("sec", nanoseconds="nanosec")}
    assert np.allclose(log_of(stamps, columns, header).t, rows[:, 0], atol=1e-6)
    config = resolve({"identify": {"columns": {"t": {"column": "sec", "nanoseconds": "nanosec"}}}})
    assert config.identify.columns == columns
    (tmp_path / "config.toml").write_text(configuration.dump(config))
    assert configuration.load([str(tmp_path / "config.toml")], []).identify.columns == columns
    stamps[7, 1] = 1e9
    assert "must be from 0 to 999999999" in refusal(stamps, columns, header)[0].rule
    (fault,) = refusal(stamps, {"x": Column("x", nanoseconds="nanosec")}, header)
    assert fault.key == "identify.columns.x.nanoseconds"


@pytest.mark.parametrize(
    ("option", "key"),
    [
        ("identify.segment=1e-9", "identify.segment"),
        ("identify.segment=1e9", "identify.segment"),
        ("identify.segment=0.01", "identify.segment"),
        ("identify.memory=1e308", "identify.memory"),
        ("identify.speed=1e308", "identify.speed"),
        ("identify.yaw_rate=1e308", "identify.yaw_rate"),
        ("identify.extent=1e308", "identify.extent"),
        ("identify.duration=1e308", "identify.duration"),
        ("identify.duration=1e-9", "identify.duration"),
        ("identify.duration=2", "identify.duration"),
        ("identify.duration=1e6", "identify.duration"),
        ("identify.horizon=1e308", "identify.horizon"),
        ("scenario.actuators.acceleration={delay={type='delay',time=0.6,slots=999}}", "identify.memory"),
    ],
)
def test_settings_of_absurd_size_are_named(tmp_path, capsys, option, key):
    out = tmp_path / "out"
    assert main(["identify", "--set", "scenario.plant=unicycle", "--set", option, "--out", str(out), "--quiet"]) == 2
    assert f"{key} = " in capsys.readouterr().err and not out.exists()


def test_a_drive_that_was_learned_from_is_no_unseen_one(tmp_path, capsys, log_of):
    rows = circling(rows=1200)
    log, copy = written(tmp_path / "log.csv", rows), written(tmp_path / "late.csv", rows[400:])
    options = ["--set", "scenario.plant=unicycle", "--out", str(tmp_path / "out"), "--quiet"]
    assert main(["identify", log, "--unseen", copy, *options]) == 2
    assert "--unseen = late.csv" in capsys.readouterr().err and not (tmp_path / "out").exists()
    assert not same_drive(log_of(rows), log_of(circling(lever=0.41)))
