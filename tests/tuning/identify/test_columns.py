"""Columns of logs as robots write them: quaternions, twists, steering angles, points that are not the reference."""

import csv
import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import agvjax
from tuning import config as configuration
from tuning.config.load import resolve
from tuning.identify.load import load
from tuning.identify.log import Log, Sent
from tuning.identify.model import channels
from tuning.identify.segments import cut, leaps, with_inputs
from tuning.io.csv_file import Column, units_like

BASE = agvjax.Base(track=0.6)
CAR = agvjax.Ackermann(wheelbase=0.4)
TWO, FOUR = Column("", quaternion=("qz", "qw")), Column("", quaternion=("qx", "qy", "qz", "qw"))


def driven(rows=600, step=0.02):
    """By hand: a body that turns to both sides and rolls where it looks, and the twist that it was sent."""
    t = step * np.arange(rows)
    v, w = 0.6 + 0.3 * np.sin(0.8 * t), 0.9 * np.cos(0.5 * t)
    psi = 1.8 * np.sin(0.5 * t)
    place = np.cumsum([v * np.cos(psi), v * np.sin(psi)], axis=1) * step
    noise = np.random.default_rng(0).normal(size=(3, rows)) * [[2e-3], [2e-3], [1e-3]]
    x, y, psi = np.stack([*place, psi]) + noise
    return {"t": t, "x": x, "y": y, "heading": psi, "cmd_v": v, "cmd_w": w}


@pytest.fixture
def log_of(tmp_path):
    """Columns, by name, as a log."""

    def made(columns, plant=BASE, places=None, ahead=0.0):
        with (tmp_path / "log.csv").open("w", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow(columns)
            writer.writerows(np.column_stack(list(columns.values())).tolist())
        return load(str(tmp_path / "log.csv"), plant, places or {}, ahead)

    return made


@pytest.fixture
def refusal(log_of):
    """The one fault that columns are refused for."""

    def fault(*args, **more):
        with pytest.raises(agvjax.InputError) as error:
            log_of(*args, **more)
        (one,) = error.value.faults
        return one

    return fault


def without(columns, *names, **more):
    return {name: x for name, x in columns.items() if name not in names} | more


# ---- commands


def test_a_twist_becomes_the_speeds_of_the_wheels(log_of):
    """V -+ w track / 2, with the track that the driver takes it to have."""
    drive = driven()
    log = log_of(drive)
    assert log.commands == ("left", "right") and log.sent.names == ("cmd_v", "cmd_w")
    left, right = drive["cmd_v"] - 0.3 * drive["cmd_w"], drive["cmd_v"] + 0.3 * drive["cmd_w"]
    np.testing.assert_allclose(log.inputs, np.column_stack([left, right]), rtol=1e-5, atol=1e-6)


def test_of_commands_under_two_names_it_must_be_said_which_they_are(log_of):
    """One of them may be what the wheels were measured to do."""
    drive = driven()
    both = drive | {"left": 0 * drive["t"] + 0.1, "right": 0 * drive["t"] + 0.2}
    with pytest.raises(agvjax.InputError, match=r"left, right and cmd_v, cmd_w.*which are the commands"):
        log_of(both)
    assert log_of(both, places={"left": Column("left")}).inputs[5].tolist() == pytest.approx([0.1, 0.2])
    assert log_of(both, places={"left": Column(""), "right": Column("")}).inputs[5, 0] != pytest.approx(0.1)
    named = {"cmd_v": Column("cmd_v"), "cmd_w": Column("cmd_w", "deg/s")}
    turn = np.deg2rad(drive["cmd_w"][5])
    assert log_of(both, places=named).inputs[5, 1] == pytest.approx(drive["cmd_v"][5] + 0.3 * turn, rel=1e-5)


def test_a_speed_without_a_sign_is_known_though_the_vehicle_seldom_goes_backwards(log_of):
    drive = driven()
    back = drive["cmd_v"] < 0.4  # a third of the time: turned round, and going on
    psi = drive["heading"] + np.pi * back
    shown = without(drive, "heading", heading=psi, speed=np.abs(drive["cmd_v"]))
    with pytest.raises(agvjax.InputError, match="identify.columns.speed.*it has no sign"):
        log_of(shown)
    log_of(shown | {"speed": np.where(back, -drive["cmd_v"], drive["cmd_v"])})


def test_a_frame_turned_by_a_quarter_is_named(log_of):
    drive = driven()
    with pytest.raises(agvjax.InputError, match="turned by a quarter"):
        log_of(drive | {"x": -drive["y"], "y": drive["x"]})


def test_a_steering_angle_is_commanded_beside_the_speed_that_is_measured(log_of):
    drive = driven()
    angle = np.arctan(0.4 * drive["cmd_w"] / drive["cmd_v"])
    sent = {"speed": drive["cmd_v"], "speed_cmd": 1.1 * drive["cmd_v"], "steering_angle_cmd": np.rad2deg(angle)}
    degrees = {"steering_angle_cmd": Column("steering_angle_cmd", "deg")}
    log = log_of(without(drive, "cmd_v", "cmd_w", **sent), CAR, degrees)
    assert log.commands == ("speed", "steering_angle")
    np.testing.assert_allclose(log.inputs, np.column_stack([1.1 * drive["cmd_v"], angle]), rtol=1e-6)
    np.testing.assert_allclose(log.measured["speed"], drive["cmd_v"])
    np.testing.assert_allclose(log_of(drive, CAR).inputs, np.column_stack([drive["cmd_v"], angle]), rtol=1e-5)


def test_a_base_that_takes_a_twist_is_told_it_by_either_name(log_of):
    """Its commands are a speed and a yaw rate, which may be measured beside."""
    drive = driven()
    named = without(
        drive, "cmd_v", "cmd_w", speed_cmd=drive["cmd_v"], yaw_rate_cmd=drive["cmd_w"], speed=drive["cmd_v"]
    )
    for columns in (drive, named):
        log = log_of(columns, agvjax.TwistBase())
        np.testing.assert_allclose(log.inputs, np.column_stack([drive["cmd_v"], drive["cmd_w"]]), rtol=1e-6)
        assert log.commands == ("speed", "yaw_rate") and ("speed" in log.measured) == (columns is named)


def test_a_bend_of_a_channel_without_noise_is_no_spike(log_of):
    """A speed that follows its command to the last digit, with corners where levels change; and one cell that leaps."""
    drive, speed = driven(), np.zeros(600)
    levels = np.repeat(np.random.default_rng(1).uniform(0.2, 1.0, 12), 50)
    for i in range(1, 600):
        speed[i] = speed[i - 1] + 0.02 / 0.3 * (levels[i - 1] - speed[i - 1])
    heading, t = 1.8 * np.sin(0.5 * drive["t"]), drive["t"]
    x, y = np.cumsum([speed * np.cos(heading), speed * np.sin(heading)], axis=1) * 0.02
    columns = {"t": t, "x": x, "y": y, "heading": heading, "speed": speed, "cmd_v": levels, "cmd_w": 0 * t}
    assert not leaps(log_of(columns)).any()
    speed[333] += 0.5
    assert np.argwhere(leaps(log_of(columns))).tolist() == [[333, 3]]


def test_a_log_without_commands_is_told_both_ways_to_give_them(refusal):
    fault = refusal(without(driven(), "cmd_w"))
    assert (
        "left, right or cmd_v, cmd_w" in fault.rule and "no columns left and right, nor cmd_v and cmd_w" in fault.rule
    )


def test_units_are_those_of_what_a_column_holds(refusal):
    assert refusal(driven(), places={"cmd_w": Column("cmd_w", "mm")}).rule == "one of rad/s, deg/s, rpm"
    assert refusal(driven(), places={"left": Column("cmd_v", "cm"), "right": Column("cmd_w")}).rule.startswith(
        "one of m/s, mm/s, km/h"
    )
    assert refusal(driven(), places={"heading": Column("heading", "quaternion")}).rule.startswith("one of rad, deg; ")
    assert units_like("Nm") == ["Nm", "mNm"] and units_like("m/s^2") == ["m/s^2"] and "km/h" in units_like("N/m")


def test_commands_are_doubted_as_the_file_has_them():
    """A twist of the other sign in its second column is both wheels of the base exchanged."""
    values = np.random.default_rng(0).normal(size=(200, 2))

    def wheels(twist):
        return twist @ np.array([[1.0, 1.0], [-0.3, 0.3]])

    t, pose = 0.02 * np.arange(200), dict.fromkeys(("x", "y", "heading"), np.zeros(200))
    log = Log("a", 0.0, t, wheels(values), ("left", "right"), pose, Sent(("cmd_v", "cmd_w"), values, wheels))
    segments, _ = cut([log], 1.0, 0.2, 5.0)
    turned = log._replace(inputs=log.sent.inputs(log.sent.values @ np.diag([1.0, -1.0])))
    after = with_inputs(segments, [turned])
    there = segments.rows >= 0
    np.testing.assert_allclose(after.inputs[there], segments.inputs[there][:, ::-1])
    assert not after.inputs[~there].any()


# ---- headings


@pytest.mark.parametrize("place", [TWO, FOUR])
def test_a_heading_is_told_by_a_quaternion(log_of, place):
    drive = driven()
    parts = Rotation.from_euler("z", drive["heading"][:, None]).as_quat()
    columns = without(drive, "heading", **dict(zip(("qx", "qy", "qz", "qw"), parts.T, strict=True)))
    np.testing.assert_allclose(
        log_of(columns, places={"heading": place}).measured["heading"], drive["heading"], atol=1e-9
    )


def test_a_vehicle_that_tilts_has_the_heading_of_its_nose(log_of):
    """Where its own x axis lies in the plane; SciPy turns that axis."""
    drive = driven()
    tilt = 0.3 * np.sin(drive["t"]), 0.2 * np.cos(2 * drive["t"])
    turned = Rotation.from_euler("ZYX", np.column_stack([drive["heading"], *tilt]))
    nose = turned.apply([1.0, 0.0, 0.0])
    columns = without(drive, "heading", **dict(zip(("qx", "qy", "qz", "qw"), turned.as_quat().T, strict=True)))
    heading = log_of(columns, places={"heading": FOUR}).measured["heading"]
    np.testing.assert_allclose(
        np.exp(1j * heading), (nose[:, 0] + 1j * nose[:, 1]) / np.hypot(*nose[:, :2].T), atol=1e-9
    )


def test_numbers_that_are_no_quaternion_are_refused(refusal):
    drive = driven()
    columns = without(drive, "heading", qz=np.sin(drive["heading"] / 2), qw=0.5 * np.cos(drive["heading"] / 2))
    assert "must add up to 1, not to 0.25" in refusal(columns, places={"heading": TWO}).rule


def test_a_part_of_a_quaternion_is_no_heading_and_is_answered_with_what_to_write(refusal):
    drive = driven(1500)
    columns = without(drive, heading=np.sin(drive["heading"] / 2))
    fault = refusal(columns)
    assert fault.key == "identify.columns.heading" and 'quaternion = ["qx", "qy", "qz", "qw"]' in fault.rule


def test_a_part_of_a_quaternion_that_turns_little_is_noticed_too(refusal):
    """Half of the heading, which is off by little at every place; but by the same factor everywhere."""
    drive = driven(2000)
    few = 0.35 * np.sin(0.5 * drive["t"])
    drive["x"], drive["y"] = np.cumsum([drive["cmd_v"] * np.cos(few), drive["cmd_v"] * np.sin(few)], axis=1) * 0.02
    fault = refusal(drive | {"heading": np.sin(few / 2)})
    assert "of a quaternion" in fault.rule


@pytest.mark.parametrize(
    "table",
    [{"quaternion": ["a", "b", "c"]}, {"quaternion": ["a", "a"]}, {"quaternion": ["a", "b"], "unit": "rad"}],
)
def test_a_quaternion_is_two_or_four_columns_without_a_unit(table):
    with pytest.raises(agvjax.InputError, match="identify.columns.heading"):
        resolve({"identify": {"columns": {"heading": table}}})
    with pytest.raises(agvjax.InputError, match="identify.columns.x"):
        resolve({"identify": {"columns": {"x": {"quaternion": ["a", "b"]}}}})


def test_a_quaternion_is_written_as_it_is_read(tmp_path):
    config = resolve({"identify": {"columns": {"heading": {"quaternion": ["qz", "qw"], "factor": -1.0}}}})
    (tmp_path / "config.toml").write_text(configuration.dump(config))
    again = configuration.load([str(tmp_path / "config.toml")], []).identify.columns
    assert again == {"heading": Column("", factor=-1.0, quaternion=("qz", "qw"))}


# ---- another point


def test_a_pose_is_moved_ahead_along_its_heading(log_of, refusal):
    drive = driven()
    log = log_of(drive, ahead=0.3)
    np.testing.assert_allclose(log.measured["x"], drive["x"] + 0.3 * np.cos(drive["heading"]), atol=1e-12)
    np.testing.assert_allclose(log.measured["y"], drive["y"] + 0.3 * np.sin(drive["heading"]), atol=1e-12)
    rate = np.gradient(drive["x"], 0.02), np.gradient(drive["y"], 0.02)
    assert refusal(drive | {"vx": rate[0], "vy": rate[1]}, ahead=0.3).key == "identify.ahead"


def test_a_position_is_told_by_latitude_and_longitude(log_of):
    drive = driven()
    north, east = 111_194.9, 111_194.9 * np.cos(np.radians(48.0))  # m of a degree on a sphere of 6371 km
    fix = without(drive, "x", "y", lat=48.0 + drive["y"] / north, lon=11.0 + drive["x"] / east)
    log = log_of(fix, places={"lat": Column("lat"), "lon": Column("lon")})
    for name in ("x", "y"):  # the earth is no sphere: within 4 in a thousand, from the first point
        moved = drive[name] - drive[name][0]
        np.testing.assert_allclose(log.measured[name], moved, atol=4e-3 * np.abs(moved).max())
    radians = {name: Column(name, "rad") for name in ("lat", "lon")}
    also = log_of({**fix, "lat": np.radians(fix["lat"]), "lon": np.radians(fix["lon"])}, places=radians)
    np.testing.assert_allclose(also.measured["x"], log.measured["x"], atol=1e-6)


def test_latitudes_that_are_none_are_refused(refusal):
    drive = driven()
    places = {"lat": Column("y"), "lon": Column("x")}
    assert "must be degrees" in refusal({**drive, "y": drive["y"] + 98.0}, places=places).rule
    assert "no column lon" in refusal({**drive, "lat": drive["y"]}, places={"lat": Column("lat")}).rule


def test_a_measured_steering_angle_is_compared_with_that_of_the_wheel(log_of):
    """It ended in a traceback, of a car as of a base, which steers none."""
    car = agvjax.Ackermann()
    state = dataclasses.replace(car.start(agvjax.Start()), reached=np.array([0.5, -0.2]))
    still = dict.fromkeys(car.actuators, np.zeros(()))
    np.testing.assert_allclose(channels(car, state, still, ("steering_angle", "speed")), [-0.2, 0.5])
    sent = driven()
    angle = np.arctan2(CAR.wheelbase * sent["cmd_w"], sent["cmd_v"])
    log = log_of(sent | {"steering_angle": angle}, CAR)
    np.testing.assert_allclose(log.measured["steering_angle"], angle, atol=1e-5)
    log = log_of(sent | {"steering_angle": angle})
    assert "steering_angle" not in log.measured and "steering_angle is not used: Base has no wheel" in log.notes[-1]
    with pytest.raises(agvjax.InputError, match=r"identify.columns.steering_angle = delta: must be left out: Base"):
        log_of(sent | {"delta": angle}, places={"steering_angle": Column("delta")})
