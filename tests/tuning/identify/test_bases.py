"""Bases that are sent twists, and vehicles that are sent steering angles: their logs tell what they do."""

import csv
import json

import numpy as np
import pytest

import agvjax
from tuning import config as configuration
from tuning.cli.main import main
from tuning.config.load import resolve
from tuning.identify.excitation import Room, candidate
from tuning.identify.fit import fit
from tuning.identify.log import Log
from tuning.identify.parameters import named, parameters, prepared
from tuning.identify.rules import faults
from tuning.identify.run import first_drive
from tuning.identify.task import task

STEP = 0.02


def held(seed, rows, low, high):
    """Levels that are drawn, each held for 0.8 s; every third is small."""
    rng = np.random.default_rng(seed)
    levels = rng.uniform(low, high, (rows // 40 + 1, len(low)))
    levels[::3] *= 0.25
    return np.repeat(levels, 40, axis=0)[:rows]


def dead(u, threshold, slope=0.95):
    return slope * np.sign(u) * max(abs(u) - threshold, 0.0)


def rolled(place, left, right, track, h):
    """Where a base is after h s, its wheels rolling at these speeds."""
    (x, y, psi), speed = place, (left + right) / 2
    return x + speed * np.cos(psi) * h, y + speed * np.sin(psi) * h, psi + (right - left) / track * h


def sent_a_twist(seed, rows=2000, late=5, track=0.42, lag=0.2):
    """A base by hand: its driver takes the wheels to be 0.5 m apart, where they are 0.42; 100 ms late."""
    twist, rng = held(seed, rows, [-0.7, -1.2], [0.9, 1.2]), np.random.default_rng(seed)
    place, left, right, h = (0.0, 0.0, 0.0), 0.0, 0.0, STEP / 10
    table = np.empty((rows, 6))
    for i in range(rows):
        table[i] = (i * STEP, *place, *twist[i])
        v, w = twist[max(i - late, 0)]
        for _ in range(10):
            place = rolled(place, left, right, track, h)
            left += (dead(v - 0.25 * w, 0.08) - left) / lag * h
            right += (dead(v + 0.25 * w, 0.05) - right) / lag * h
    table[:, 1:4] += rng.normal(size=(rows, 3)) * [3e-3, 3e-3, 2e-3]
    return ("t", "x", "y", "heading", "cmd_v", "cmd_w"), table


def steered(seed, rows=2000, late=3, wheelbase=0.33):
    """A small car by hand: speed lags 0.25 s, steering 0.1 s, both 60 ms late; 0.02 rad of play, gain 0.9."""
    sent, rng = held(seed, rows, [-0.6, -0.35], [1.2, 0.35]), np.random.default_rng(seed)
    x = y = psi = speed = angle = 0.0
    table = np.empty((rows, 7))
    for i in range(rows):
        table[i] = (i * STEP, x, y, psi, speed, *sent[i])
        v, delta = sent[max(i - late, 0)]
        for _ in range(10):
            h = STEP / 10
            x, y = x + speed * np.cos(psi) * h, y + speed * np.sin(psi) * h
            psi += speed * np.tan(angle) / wheelbase * h
            speed += (dead(v, 0.06) - speed) / 0.25 * h
            angle += (dead(delta, 0.02, 0.9) - angle) / 0.1 * h
    table[:, 1:5] += rng.normal(size=(rows, 4)) * [3e-3, 3e-3, 2e-3, 1e-2]
    return ("t", "x", "y", "heading", "speed", "speed_cmd", "steering_angle_cmd"), table


def slipping(seed, rows=3000, late=4, track=0.258, lag=0.15):
    """A small base by hand that is sent a few speeds: each wheel grips otherwise (by 30 %) every 2 to 6 s."""
    rng, i = np.random.default_rng(seed), 0
    twist, grip = np.empty((2, rows, 2))
    while i < rows:
        n = int(rng.integers(30, 150))
        twist[i : i + n] = rng.choice([0.0, 0.07, 0.086]), rng.uniform(-0.5, 0.5) * rng.choice([0.2, 1.0])
        i += n
    i = 0
    while i < rows:
        n = int(rng.integers(100, 300))
        grip[i : i + n] = 1 + 0.3 * rng.normal(size=2)
        i += n
    place, left, right, h = (0.0, 0.0, 0.0), 0.0, 0.0, STEP / 10
    table = np.empty((rows, 6))
    for i in range(rows):
        table[i] = (i * STEP, *place, *twist[i])
        v, w = twist[max(i - late, 0)]
        for _ in range(10):
            place = rolled(place, *grip[i] * (left, right), track, h)
            left += (v - w * track / 2 - left) / lag * h
            right += (v + w * track / 2 - right) / lag * h
    table[:, 1:4] += rng.normal(size=(rows, 3)) * [3e-4, 3e-4, 1e-3]
    return ("t", "x", "y", "heading", "cmd_v", "cmd_w"), table


def written(file, header, rows):
    with file.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(header)
        writer.writerows(rows.tolist())
    return str(file)


def identified(folder, drive, preset, *options):
    """What one drive tells, and how well another is predicted."""
    log, other = (written(folder / f"{name}.csv", *drive(seed)) for name, seed in (("log", 1), ("other", 2)))
    more = [x for key in ("starts=1", "bootstrap=100", "drives=0", "memory=0.3") for x in ("--set", f"identify.{key}")]
    out = folder / "out"
    argv = ["identify", log, "--unseen", other, "--config", preset, *more, *options, "--out", str(out), "--quiet"]
    assert main(argv) == 0
    return out, json.loads((out / "estimates.json").read_text())


def close(told, name, value, share, least=0.0):
    e = told["parameters"][name]
    assert e["identified"], (name, e)
    assert abs(e["value"] - value) <= max(share * abs(value), least), (name, e["value"])


@pytest.mark.slow
def test_a_base_that_is_sent_a_twist_is_found(tmp_path):
    out, told = identified(tmp_path, sent_a_twist, "base", "--fit", "deadzone,delay,vehicle")
    for side, threshold in (("left", 0.08), ("right", 0.05)):
        for part in ("right", "left"):
            close(told, f"deadzone.{side}.threshold_{part}", threshold, 0.1, 0.005)
            close(told, f"deadzone.{side}.slope_{part}", 0.95, 0.03)
        close(told, f"actuators.{side}.delay.time", 0.1, 0.0, 0.01)
    close(told, "plant.track", 0.42, 0.03)
    close(told, "plant.time_constant", 0.2, 0.1)
    (ahead,) = told["predictions"]
    assert told["good"] and ahead["rms"] < 0.5 * min(ahead["plain"].values())
    assert "These numbers are good for" in (out / "report.md").read_text().splitlines()[4]
    assert configuration.load([str(out / "scenario.toml")], []).scenario.plant.track == pytest.approx(0.42, rel=0.03)


def mounted_aside(seed, ahead=-0.06, left=0.04, turned=0.03):
    """The same base, its pose that of markers behind and beside its axle, turned to the left."""
    header, table = sent_a_twist(seed)
    c, s = np.cos(table[:, 3]), np.sin(table[:, 3])
    table[:, 1:4] += np.stack([c * ahead - s * left, s * ahead + c * left, 0.0 * c + turned], axis=1)
    return header, table


@pytest.mark.slow
def test_where_a_sensor_is_mounted_is_found_and_is_in_the_scenario_that_is_tuned_for(tmp_path):
    out, told = identified(tmp_path, mounted_aside, "base", "--fit", "deadzone,delay,vehicle,sensor")
    for name, value, within in (("ahead", -0.06, 3e-3), ("left", 0.04, 3e-3), ("turned", 0.03, 3e-3)):
        close(told, f"sensor.{name}", value, 0.0, within)
        assert told["parameters"][f"sensor.{name}"]["low"] <= value <= told["parameters"][f"sensor.{name}"]["high"]
    close(told, "plant.track", 0.42, 0.03)
    sensor = configuration.load([str(out / "scenario.toml")], []).scenario.sensor
    assert isinstance(sensor, agvjax.Mounted)
    assert sensor.turned == pytest.approx(0.03, abs=3e-3) and sensor.position == pytest.approx(3e-3, rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 3])
def test_wheels_that_grip_otherwise_now_and_then_are_not_taken_for_slow_motors(seed, tmp_path):
    """Of a lag of 0.15 s: where every stretch could begin with motors of any speed, 0.7 and 2.9 s were found."""
    sides = [f"scenario.deadzone.{side}" for side in ("left", "right")]
    known = [f"{side}.{key}" for side in sides for key in ("threshold_right=0", "threshold_left=0", "slope_left=1")]
    wishes = {"identify.fit": ["deadzone.left.slope_right", "deadzone.right.slope_right", "plant.track", "lag"]}
    config = configuration.load(["base"], [*known, "scenario.plant.track=0.3"], faults, wishes)
    found = fit(task([written(tmp_path / "log.csv", *slipping(seed))], config), 1, 6.0, 0)
    lag = dict(zip([q.name for q in found.parameters], found.p, strict=True))["plant.time_constant"]
    assert abs(lag - 0.15) < 0.1


@pytest.mark.slow
def test_a_vehicle_that_is_sent_a_steering_angle_is_found(tmp_path):
    _, told = identified(tmp_path, steered, "ackermann", "--fit", "deadzone,delay,lag")
    for part in ("right", "left"):
        close(told, f"deadzone.speed.threshold_{part}", 0.06, 0.1, 0.005)
        close(told, f"deadzone.speed.slope_{part}", 0.95, 0.03)
        close(told, f"deadzone.steering_angle.threshold_{part}", 0.02, 0.1, 0.003)
        close(told, f"deadzone.steering_angle.slope_{part}", 0.9, 0.03)
    for name in ("speed", "steering_angle"):
        close(told, f"actuators.{name}.delay.time", 0.06, 0.0, 0.01)
    close(told, "plant.time_constant", 0.25, 0.1)
    close(told, "plant.steering_time", 0.1, 0.15)
    assert told["good"]


def test_a_drive_for_a_base_is_sent_what_its_deadzones_leave_of_a_twist():
    """What is delivered at both wheels, 0.5 m apart, is a speed and a yaw rate within what is allowed, from rest."""
    scenario = resolve({"scenario": {"plant": "base"}}).scenario
    room = Room(speed=0.5, yaw_rate=1.0, limits=(np.inf, np.inf), extent=5.0, duration=20.0, period=0.05)
    _, u = candidate(scenario, room, np.random.default_rng(0).random(20))
    left, right = np.sign(u).T * np.maximum(np.abs(u.T) - 0.06, 0.0) * 0.95
    v, w = (left + right) / 2, (right - left) / 0.5
    assert 0.24 < np.abs(v).max() < 0.5 + 1e-9 and 0.49 < np.abs(w).max() < 1.0 + 1e-9
    assert v.min() < 0 < v.max() and w.min() < 0 < w.max() and abs(v[0]) < 1e-9
    t = 0.05 * np.arange(len(u))
    assert (u[(t % 10 > 8 - 1e-6) | (t % 10 < 1e-6)] == 0).all() and (np.abs(u[(t > 3) & (t < 7)]) > 0.06).all()


@pytest.mark.slow
def test_a_drive_that_is_suggested_for_a_base_tells_thresholds_and_drift():
    """Both would be unknown of a base that never stands: left and right thresholds and a drift look alike."""
    expected = first_drive(resolve({"scenario": {"plant": "base"}, "identify": {"drives": 4}})).expected
    for side in ("left.threshold_right", "left.threshold_left", "right.threshold_right", "right.threshold_left"):
        assert expected[f"deadzone.{side}"] < 0.05 * 0.06
    assert expected["plant.drift"] < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["base", "ackermann"])
def test_a_drive_is_suggested_in_columns_that_identify_reads(preset, tmp_path):
    out = tmp_path / "out"
    few = [x for key in ("drives=2", "duration=10", "memory=0.3") for x in ("--set", f"identify.{key}")]
    assert main(["identify", "--config", preset, *few, "--out", str(out), "--quiet"]) == 0
    header = (out / "excitation.csv").read_text().splitlines()[0].split(",")
    own = {"base": ["left", "right"], "ackermann": ["speed_cmd", "steering_angle_cmd"]}[preset]
    assert header == ["t", *own, "expected_x", "expected_y", "expected_heading"]


def names_of(preset, *fit):
    scenario = resolve({"scenario": {"plant": preset}}).scenario
    return named(prepared(scenario, fit, 0.02, 0.5), fit)


def test_groups_ask_a_base_for_no_number_twice():
    """A lag of the motors that they have already, and a push that turns as a drift does."""
    assert names_of("base", "lag") == ("plant.time_constant",)
    assert set(names_of("ackermann", "lag")) == {"plant.time_constant", "plant.steering_time"}
    both = names_of("base", "vehicle", "disturbance")
    assert "plant.drift" in both and "disturbance.heading.constant" not in both
    assert "disturbance.heading.constant" in names_of("base", "disturbance")
    assert "disturbance.heading.constant" in names_of("base", "vehicle", "disturbance.heading.constant")
    assert names_of("unicycle", "lag") == tuple(
        f"actuators.{name}.lag.time_constant" for name in ("acceleration", "yaw_acceleration")
    )


def test_a_sensor_may_be_looked_for_where_no_other_number_says_the_same():
    """How far ahead it is of a vehicle with an offset L, that offset says."""
    assert names_of("base", "sensor") == ("sensor.ahead", "sensor.left", "sensor.turned")
    assert names_of("unicycle", "sensor") == ("sensor.left", "sensor.turned")
    assert names_of("base", "sensor.turned") == ("sensor.turned",) and not faults(
        resolve({"scenario": {"plant": "base"}, "identify": {"fit": ["sensor.turned"]}})
    )
    (wrong,) = faults(resolve({"scenario": {"plant": "base"}, "identify": {"fit": ["sensor.position"]}}))
    assert wrong.key == "identify.fit" and "sensor.ahead" in wrong.rule


def test_one_delay_may_be_asked_for_by_its_name():
    """The element that it is of is added, as for the group; not to the other actuator."""
    fit = ("actuators.left.delay.time",)
    scenario = prepared(resolve({"scenario": {"plant": "base"}}).scenario, fit, 0.02, 0.5)
    assert named(scenario, fit) == fit and set(scenario.actuators) == {"left"}
    assert scenario.actuators["left"]["delay"].slots >= 25


def test_a_lag_of_motors_is_looked_for_as_long_as_a_stretch_knows_what_was_sent_before_it():
    """Up to two memories, unless a longer one is assumed; what ends there is told what moves that edge."""
    scenario = resolve({"scenario": {"plant": "base"}}).scenario
    log = Log("drive", 0.0, 0.02 * np.arange(100), np.zeros((100, 2)), ("left", "right"), {})
    (lag,) = parameters(scenario, ("plant.time_constant",), [log], 0.01, 0.5)
    assert lag.high == 1.0 and "identify.memory" in lag.most
    slow = agvjax.replace(scenario, {"plant.time_constant": 1.5})
    (lag,) = parameters(slow, ("plant.time_constant",), [log], 0.01, 0.5)
    assert lag.high > 1.5
