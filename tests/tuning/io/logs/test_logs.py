"""Recordings written by others' libraries, or byte by byte, are read as they were written; what is cut off is said."""

import struct
from pathlib import Path

import numpy as np
import pytest

import agvjax
import commands
from tuning.cli.main import main
from tuning.identify.load import load
from tuning.identify.recorded import shares, unfit
from tuning.io.csv_file import Column
from tuning.io.logs import is_recording, read
from tuning.io.logs.recording import Recording, Stream
from tuning.io.logs.roles import TABLE, chosen
from tuning.io.logs.rows import Rows, stamps_of, table

START = 1_700_000_000_000_000_000  # ns
MS = 1_000_000


@pytest.fixture(scope="module")
def store():
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


def odometry(store, stamp, x, y, heading, v, w):
    t = store.types
    vector, quaternion = t["geometry_msgs/msg/Vector3"], t["geometry_msgs/msg/Quaternion"]
    pose = t["geometry_msgs/msg/Pose"](
        t["geometry_msgs/msg/Point"](x, y, 0.0), quaternion(0.0, 0.0, np.sin(heading / 2), np.cos(heading / 2))
    )
    twist = t["geometry_msgs/msg/Twist"](vector(v, 0.0, 0.0), vector(0.0, 0.0, w))
    header = t["std_msgs/msg/Header"](t["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9), "odom")
    return t["nav_msgs/msg/Odometry"](
        header,
        "base_link",
        t["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36)),
        t["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
    )


def twist(store, v, w):
    vector = store.types["geometry_msgs/msg/Vector3"]
    return store.types["geometry_msgs/msg/Twist"](vector(v, 0.0, 0.0), vector(0.0, 0.0, w))


def circle(k):
    """The pose of a drive on a circle of 2 m, .5 m/s, at k * 20 ms."""
    turned = 0.25 * 0.02 * k
    return 2 * np.sin(turned), 2 - 2 * np.cos(turned), turned


def bag(folder, store, storage, n=1000, more=()):
    """Odometry at 50 Hz stamped 7 ms before it comes, commands at 20 Hz of which half a second is lost."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    with Writer(folder, version=9, storage_plugin=StoragePlugin[storage]) as writer:
        pose = writer.add_connection("/odom", "nav_msgs/msg/Odometry", typestore=store)
        command = writer.add_connection("/cmd_vel", "geometry_msgs/msg/Twist", typestore=store)
        others = [writer.add_connection(name, kind, typestore=store) for name, kind, _ in more]
        for k in range(n):
            stamp = START + 20 * MS * k
            message = odometry(store, stamp, *circle(k), 0.5, 0.25)
            writer.write(pose, stamp + 7 * MS, store.serialize_cdr(message, "nav_msgs/msg/Odometry"))
            for one, (_, kind, made) in zip(others, more, strict=True):
                writer.write(one, stamp, store.serialize_cdr(made, kind))
        for k in range(2 * n // 5):
            if not 100 <= k < 110:
                message = store.serialize_cdr(twist(store, 0.5 + 0.001 * k, 0.25), "geometry_msgs/msg/Twist")
                writer.write(command, START + 50 * MS * k + 5 * MS, message)
    return folder


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_a_bag_of_ros_2_is_read_as_it_was_written(tmp_path, store, storage):
    recording = read(str(bag(tmp_path / "bag", store, storage)))
    assert not recording.lost and {s.topic: s.size for s in recording.streams} == {"/odom": 1000, "/cmd_vel": 390}
    found = chosen(recording, {})
    assert {name: stream.topic for name, (stream, _) in found.items()} == {
        "pose": "/odom", "speed": "/odom", "command": "/cmd_vel",
    }  # fmt: skip
    named = {"vx": Column("/odom.twist.twist.linear.x"), "told": Column("/cmd_vel.linear.x", "km/h", -1.0)}
    rows = table(recording, found, named, ["told"])
    # by stamps of the sender: a row every 20 ms, the first when both are there, 5 ms after the first pose, and another
    # 5 ms later: so half of the commands come as much too late as the others come too early (13 us: 194 and 195)
    t = rows.columns["t"] - START * 1e-9
    np.testing.assert_allclose(t, 0.010 + 0.02 * np.arange(t.size), atol=1.4e-5)
    x, y, heading = circle(t / 0.02)
    for name, expected in (("x", x), ("y", y), ("heading", heading)):
        np.testing.assert_allclose(rows.columns[name], expected, atol=2e-5)  # a chord in place of an arc
    # a command holds until the next one; half a second of them was lost, and for three periods the last one holds
    told = rows.columns["cmd_v"]
    np.testing.assert_allclose(told[:5], [0.5, 0.5, 0.501, 0.501, 0.501], atol=1e-12)
    np.testing.assert_allclose(told[5], 0.502, atol=1e-12)
    silent = (t > 0.005 + 0.05 * 99 + 3 * 0.05) & (t < 0.05 * 110)
    assert np.isnan(told[silent]).all() and np.isfinite(told[~silent]).all()
    assert (
        rows.stamps == "header"
        and "later by /odom 7 ms" in rows.notes[0]
        and "of arrival for /cmd_vel" in rows.notes[0]
    )
    assert "/cmd_vel: 1 gaps" in rows.notes
    np.testing.assert_allclose(rows.columns["vx"], 0.5, rtol=1e-12)
    np.testing.assert_allclose(rows.columns["told"], -told / 3.6, rtol=1e-12)  # named, it holds as well


def test_a_slow_sensor_fills_few_rows_and_turns_on_past_half_a_turn():
    n, slow = 200, 20
    own = START + 100 * MS * np.arange(slow)
    turned = 3.0 + 0.05 * np.arange(slow)  # past pi
    z, w = np.sin(turned / 2), np.cos(turned / 2)
    fields = {f"pose.position.{k}": np.arange(slow) * s for k, s in (("x", 0.1), ("y", 0.0))}
    fields |= {f"pose.orientation.{k}": v for k, v in (("x", 0 * z), ("y", 0 * z), ("z", z), ("w", w))}
    pose = Stream("/pose", "geometry_msgs/msg/PoseStamped", own, None, fields)
    told = START + 10 * MS * np.arange(n)
    zero = dict.fromkeys(("linear.x", "angular.z"), np.ones(n))
    recording = Recording("made", (pose, Stream("/cmd_vel", "geometry_msgs/msg/Twist", told, None, zero)), {}, ())
    columns = table(recording, chosen(recording, {})).columns
    seen = np.isfinite(columns["x"])
    assert columns["t"].size == 191 and seen.sum() == slow  # a row every 10 ms, a pose in every tenth
    np.testing.assert_allclose(columns["x"][seen], 0.1 * np.arange(slow), atol=1e-9)
    np.testing.assert_allclose(np.diff(columns["heading"][seen]), 0.05, atol=1e-9)


@pytest.mark.parametrize("late", [0, 3, 7, 11, 19])
def test_commands_that_change_in_step_with_the_rows_are_not_moved(late):
    """A pose every 20 ms and a command every second, `late` ms after one: its row begins when it came."""
    n, zeros = 500, np.zeros(500)
    fields = {"pose.position.x": zeros, "pose.position.y": zeros, "pose.orientation.w": zeros + 1}
    fields |= {f"pose.orientation.{part}": zeros for part in "xyz"}
    pose = Stream("/pose", "geometry_msgs/msg/PoseStamped", START + 20 * MS * np.arange(n), None, fields)
    told = START + (1000 * np.arange(10) + late) * MS
    twist = {"linear.x": np.arange(10.0), "angular.z": np.zeros(10)}
    recording = Recording("made", (pose, Stream("/cmd_vel", "geometry_msgs/msg/Twist", told, None, twist)), {}, ())
    columns = table(recording, chosen(recording, {})).columns
    changed = np.flatnonzero(np.diff(columns["cmd_v"])) + 1
    np.testing.assert_allclose(columns["t"][changed] - START * 1e-9, 1.0 * np.arange(1, 10) + 1e-3 * late, atol=1e-6)


@pytest.mark.parametrize(
    ("every", "late", "jitter"), [(50, 0, 0), (50, 0.4, 0), (50, 6, 0), (25, 0, 0), (30, 3, 0), (50, 0, 5), (20, 10, 1)]
)
def test_commands_on_another_grid_than_the_rows_are_on_average_not_moved(every, late, jitter):
    """A pose every 20 ms, a command every 50, 25, 30 or 20 ms. Half of them used to come 10 ms late in the first.

    The mean of 400 moves of up to half a row is known to 1 ms by three deviations where they are drawn at random.
    """
    n, zeros = 1000, np.zeros(1000)
    fields = {"pose.position.x": zeros, "pose.position.y": zeros, "pose.orientation.w": zeros + 1}
    fields |= {f"pose.orientation.{part}": zeros for part in "xyz"}
    pose = Stream("/pose", "geometry_msgs/msg/PoseStamped", START + 20 * MS * np.arange(n), None, fields)
    count = 19_000 // every
    times = every * np.arange(count) + late + np.random.default_rng(1).uniform(-jitter, jitter, count)
    twist = {"linear.x": np.arange(float(count)), "angular.z": np.zeros(count)}
    told = START + (times * MS).astype(np.int64)
    recording = Recording("made", (pose, Stream("/cmd_vel", "geometry_msgs/msg/Twist", told, None, twist)), {}, ())
    columns = table(recording, chosen(recording, {})).columns
    rows = np.flatnonzero(np.diff(columns["cmd_v"]) > 0) + 1
    moved = 1e3 * (columns["t"][rows] - START * 1e-9) - times[columns["cmd_v"][rows].astype(int)]
    assert np.abs(moved).max() <= 10.001 and np.abs(moved.mean()) < (1.0 if jitter else 0.1)


def test_of_several_topics_one_must_be_named(tmp_path, store):
    more = [("/amcl", "nav_msgs/msg/Odometry", odometry(store, START, 0.0, 0.0, 0.0, 0.0, 0.0))]
    recording = read(str(bag(tmp_path / "bag", store, "MCAP", 50, more)))
    with pytest.raises(ValueError, match=r"2 topics can be the pose: .*/odom.*name one with --topics pose="):
        chosen(recording, {})
    assert chosen(recording, {"pose": "/odom"})["pose"][0].topic == "/odom"
    with pytest.raises(ValueError, match=r"--topics pose=/gps: must be one of"):
        chosen(recording, {"pose": "/gps"})


def test_clocks_that_are_not_one_are_told_apart(tmp_path):
    """Stamps of a simulation's clock, which begins at 0, beside commands that have none."""
    n = 100
    arrival, header = START + 20 * MS * np.arange(n), 20 * MS * np.arange(1, n + 1)
    zeros = {f"pose.{k}": np.zeros(n) for k in ("position.x", "position.y", *(f"orientation.{p}" for p in "xyz"))}
    pose = Stream("/pose", "geometry_msgs/msg/PoseStamped", arrival, header, zeros | {"pose.orientation.w": np.ones(n)})
    command = dict.fromkeys(("linear.x", "angular.z"), np.ones(n))
    recording = Recording("made", (pose, Stream("/cmd_vel", "geometry_msgs/msg/Twist", arrival, None, command)), {}, ())
    rows = table(recording, chosen(recording, {}))
    assert rows.stamps == "arrival" and "another clock" in rows.notes[0] and rows.columns["t"].size == n


@pytest.mark.parametrize("storage, end", [("SQLITE3", ".db3"), ("MCAP", ".mcap")])
def test_a_bag_that_ends_too_early_gives_what_it_holds_and_says_so(tmp_path, store, storage, end):
    (whole,) = bag(tmp_path / "bag", store, storage, 4000).glob(f"*{end}")
    cut = tmp_path / f"cut{end}"
    cut.write_bytes(whole.read_bytes()[: int(0.7 * whole.stat().st_size)])
    recording = read(str(cut))
    lost = " ".join(recording.lost)
    count = sum(stream.size for stream in recording.streams) + lost.count("a message is damaged")  # the last one
    assert "ends too early" in lost and f"{count} messages were read" in lost
    assert 1000 < count < 4000 + 1590
    pose = next(stream for stream in recording.streams if stream.topic == "/odom")
    x = np.array([circle(k)[0] for k in range(pose.size)])
    np.testing.assert_allclose(pose.fields["pose.pose.position.x"], x, atol=1e-12)


def test_damaged_messages_are_counted_and_left_out(tmp_path, store):
    from rosbags.rosbag2 import StoragePlugin, Writer

    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        command = writer.add_connection("/cmd_vel", "geometry_msgs/msg/Twist", typestore=store)
        for k in range(10):
            raw = bytes(store.serialize_cdr(twist(store, 0.5, 0.0), "geometry_msgs/msg/Twist"))
            writer.write(command, START + k * MS, raw[:9] if k in (3, 4) else raw)
    recording = read(str(tmp_path / "bag"))
    assert recording.streams[0].size == 8
    assert any("/cmd_vel: a message is damaged" in line for line in recording.lost)
    assert any("2 messages are damaged in all" in line for line in recording.lost)


def ulog(path):
    """A ULog by its format (docs.px4.io, ULog file format): header, format, subscription, data."""

    def message(kind, body):
        return struct.pack("<HB", len(body), ord(kind)) + body

    names = "vehicle_local_position:uint64_t timestamp;float x;float y;float vx;float vy;float heading;"
    data = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)
    data += message("B", bytes(40)) + message("F", names.encode())
    data += message("A", struct.pack("<BH", 0, 7) + b"vehicle_local_position")
    for k in range(20):
        body = struct.pack("<HQ5f", 7, 1_000_000 + 20_000 * k, 3.0, 4.0 + k, 0.0, 1.0, 0.0)
        data += message("D", body)
    path.write_bytes(data)


def test_a_ulog_is_turned_from_north_east_down(tmp_path):
    ulog(tmp_path / "drive.ulg")
    recording = read(str(tmp_path / "drive.ulg"))
    (stream,) = recording.streams
    assert stream.size == 20 and stream.arrival[1] - stream.arrival[0] == 20 * MS
    role = chosen(recording, {})["pose"][1]
    values = role.values(stream.fields)
    np.testing.assert_allclose(values["x"], 4.0 + np.arange(20))  # its y is to the east
    np.testing.assert_allclose(values["y"], 3.0)
    np.testing.assert_allclose(values["vx"], 1.0)
    np.testing.assert_allclose(values["heading"], np.pi / 2)  # 0 looks to the north


def test_a_dataflash_log_as_text(tmp_path):
    lines = [
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
        "FMT, 150, 27, STER, Qfff, TimeUS,SteerIn,Out,Lat",
    ]
    lines += [f"STER, {1000000 + 100000 * k}, {0.1 * k}, 0.5, 0.0" for k in range(5)]
    (tmp_path / "drive.log").write_text("\n".join(lines) + "\n")
    (stream,) = (s for s in read(str(tmp_path / "drive.log")).streams if s.topic == "STER")
    np.testing.assert_allclose(stream.fields["SteerIn"], 0.1 * np.arange(5), atol=1e-6)
    assert np.diff(stream.arrival).tolist() == [100 * MS] * 4


def test_an_mdf_file_of_a_car(tmp_path):
    from asammdf import MDF, Signal

    t = 0.01 * np.arange(50)
    with MDF(version="4.10") as log:
        log.append([Signal(samples=2.0 * t, timestamps=t, name="SteeringAngle", unit="rad")])
        log.save(tmp_path / "drive.mf4")
    (stream,) = read(str(tmp_path / "drive.mf4")).streams
    assert list(stream.fields) == ["SteeringAngle"]
    np.testing.assert_allclose(stream.fields["SteeringAngle"], 2.0 * t)


def test_a_folder_and_a_file_that_are_no_recordings_are_refused_with_exit_code_2(tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    (tmp_path / "wrong.mcap").write_bytes(b"not at all" * 10)
    (tmp_path / "wrong.ulg").write_bytes(b"not at all" * 10)
    (tmp_path / "wrong.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(100))
    for name in ("empty", "wrong.mcap", "wrong.ulg", "wrong.bag", "gone.mcap", "drive.csv"):
        assert main(["log", str(tmp_path / name), "--out", str(tmp_path / "out")]) == 2
        err = capsys.readouterr().err
        assert f"FILE = {tmp_path / name}" in err and not (tmp_path / "out").exists(), name
    assert "agvjax identify" in err  # of a CSV file


def test_log_says_what_each_topic_can_serve_as_and_draws_the_drive(tmp_path, store):
    folder, out = bag(tmp_path / "bag", store, "MCAP"), tmp_path / "out"
    text, _ = commands.run(["log", str(folder), "--out", str(out)])
    text = " ".join(text.split())
    assert "pose from /odom" in text and "backwards, 0 s" in text
    row = next(line for line in (out / "report.md").read_text().splitlines() if line.startswith("| /cmd_vel"))
    assert [cell.strip() for cell in row.split("|")][2:6] == ["Twist", "390", "20", "1"]
    assert {"drive.png", "report.html", "report.md"} <= set(commands.files_of(out))
    assert "Half a minute of each" in (out / "report.md").read_text()
    from rosbags.rosbag2 import StoragePlugin, Writer

    with Writer(tmp_path / "poor", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        command = writer.add_connection("/cmd_vel", "geometry_msgs/msg/Twist", typestore=store)
        for k in range(10):
            raw = store.serialize_cdr(twist(store, 0.5, 0.0), "geometry_msgs/msg/Twist")
            writer.write(command, START + k * MS, raw)
    text, _ = commands.run(["log", str(tmp_path / "poor"), "--out", str(tmp_path / "second")], code=1)
    assert "Not good for identification: no pose" in text


def test_stamps_that_nobody_set_are_no_stamps():
    told = START + 10 * MS * np.arange(100)
    command = Stream("/cmd_vel", "geometry_msgs/msg/Twist", told, None, dict.fromkeys(("linear.x", "angular.z"), told))
    with pytest.raises(ValueError, match="no stamps of senders, only times of arrival: /cmd_vel"):
        stamps_of([command], "header")
    assert stamps_of([command])[0] == "arrival"


def test_senders_whose_clocks_differ_are_taken_by_arrival():
    arrival = START + 10 * MS * np.arange(100)
    streams = [Stream(name, "Odometry", arrival, arrival - late, {}) for name, late in (("/a", 0), ("/b", 10**10))]
    stamps, why = stamps_of(streams)
    assert stamps == "arrival" and "stamps of /b are 10 s from their arrival" in why
    assert stamps_of(streams[1:])[0] == "header"  # one clock, whatever it says


@pytest.mark.parametrize(
    ("header", "why"),
    [
        (lambda arrival: arrival + 395 * MS, "395 ms later than their arrival, by another clock"),
        (lambda arrival: np.r_[arrival[:60], arrival[60:] - 30_000 * MS], "go back by 30 s, 0.6 s after its first"),
    ],
)
def test_stamps_that_no_clock_can_have_set_are_not_used_and_said(header, why):
    arrival = START + 10 * MS * np.arange(100)
    stamps, words = stamps_of([Stream("/odom", "Odometry", arrival, header(arrival), {})])
    assert stamps == "arrival" and why in words


def test_messages_that_lack_numbers_are_counted():
    arrival = START + 10 * MS * np.arange(100)
    x = np.where((arrival >= START + 200 * MS) & (arrival < START + 400 * MS), np.nan, 1.0)
    pose = Stream("/p", TABLE, arrival, None, {"x": x, "y": x, "heading": x, "cmd_v": np.ones(100)})
    found = {"x": Column("/p.x"), "y": Column("/p.y"), "heading": Column("/p.heading")}
    notes = table(Recording("a", (pose,), {}, ()), {}, found).notes
    assert "/p: 20 of 100 messages lack a number, 0.2 to 0.39 s" in notes


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"cmd_v": 0.0, "cmd_w": 0.0}, "nothing was commanded"),
        ({"x": 1.0, "y": 2.0, "heading": 3.0}, "the pose never changes, though 4 m were asked for"),
        ({"x": np.random.default_rng(0).normal(0, 0.01, 200), "heading": 3.0}, "the pose never changes"),
        ({"t": 20.0 * np.arange(200)}, "messages are 20 s apart, too far for a control loop"),
        ({"cmd_v": np.where(np.arange(200) < 3, 0.5, np.nan)}, "every command is known in 3 rows, fewer than 50"),
    ],
)
def test_a_drive_from_which_nothing_can_be_learned_is_not_good(changed, why):
    t = 0.02 * np.arange(200)
    sound = {"t": t, "x": t, "y": 0 * t, "heading": 0.1 * t, "cmd_v": 1 + 0 * t, "cmd_w": 0.1 + 0 * t}
    assert unfit(Rows(sound, "header", ())) == []
    (said,) = unfit(Rows(sound | {name: x + 0 * t for name, x in changed.items()}, "header", ()))
    assert said.startswith(why)


def test_a_vehicle_that_hardly_moves_stands_though_its_pose_is_noisy():
    """2 mm of noise at 50 Hz are .1 m/s from one pose to the next."""
    random, t = np.random.default_rng(0), 0.02 * np.arange(3000)
    noise = lambda: 0.002 * random.standard_normal(t.size)  # noqa: E731
    columns = {"t": t, "x": noise() + np.where(t < 30, 0.0, 0.3 * (t - 30)), "y": noise(), "heading": noise() / 2}
    seconds = {share.what: share.seconds for share in shares(Rows(columns, "header", ()))}
    assert seconds["forwards"] == pytest.approx(30, abs=1) and seconds["backwards"] < 1
    assert seconds["straight on"] == pytest.approx(30, abs=2)


def test_a_log_without_known_types_is_read_by_its_names(tmp_path):
    """Dataflash: commands hold until the next one, what is measured is taken between; units as in any file."""
    formats = {"CTRL": "Qff, TimeUS,V,W", "NAV": "Qffff, TimeUS,N,E,Yaw,Spd"}
    lines = [f"FMT, {150 + i}, 30, {name}, {form}" for i, (name, form) in enumerate(formats.items())]
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns", *lines]
    for k in range(400):  # 50 Hz, a straight line to the north at .5 m/s; commands at 10 Hz
        lines.append(f"NAV, {20000 * k}, {0.01 * k}, 0.0, 90.0, 0.5")
        lines += [f"CTRL, {20000 * k}, {0.5 + 0.01 * (k // 5 % 10)}, {0.1 * (-1) ** (k // 50)}"] * (k % 5 == 0)
    (tmp_path / "drive.log").write_text("\n".join(lines) + "\n")
    where = {"x": Column("NAV.E"), "y": Column("NAV.N"), "heading": Column("NAV.Yaw", "deg")}
    where |= {"cmd_v": Column("CTRL.V"), "cmd_w": Column("CTRL.W")}
    log = load(str(tmp_path / "drive.log"), agvjax.Base(), where)
    rows = round(log.t[-1] / 0.02) + 1
    assert log.step == pytest.approx(0.02) and len(log.t) == rows == 396  # until the last command
    np.testing.assert_allclose(log.measured["y"], 0.01 * np.arange(rows), atol=1e-6)
    np.testing.assert_allclose(log.measured["heading"], np.pi / 2, atol=1e-6)
    np.testing.assert_allclose(log.sent.values[:, 0], 0.5 + 0.01 * (np.arange(rows) // 5 % 10), atol=1e-6)
    with pytest.raises(agvjax.InputError, match=r"it has no heading.*may be named, as TOPIC\.FIELD"):
        load(str(tmp_path / "drive.log"), agvjax.Base(), {n: c for n, c in where.items() if n != "heading"})
    (tmp_path / "plain.log").write_text("t,x,y,heading,cmd_v,cmd_w\n")  # a CSV file that is called so
    assert not is_recording(str(tmp_path / "plain.log")) and is_recording(str(tmp_path / "drive.log"))


@pytest.mark.slow
@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_pictures_in_a_bag_take_no_memory(tmp_path, store, storage):
    if not Path("/proc/self/status").exists():
        pytest.skip("no Linux")
    from rosbags.rosbag2 import StoragePlugin, Writer

    t, count, size = store.types, 220, 640 * 480 * 3
    header = t["std_msgs/msg/Header"](t["builtin_interfaces/msg/Time"](1, 0), "camera")
    pixels = np.random.default_rng(0).integers(0, 255, size, dtype=np.uint8)
    image = t["sensor_msgs/msg/Image"](header, 480, 640, "rgb8", 0, 1920, pixels)
    raw = store.serialize_cdr(image, "sensor_msgs/msg/Image")
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin[storage]) as writer:
        camera = writer.add_connection("/image", "sensor_msgs/msg/Image", typestore=store)
        command = writer.add_connection("/cmd_vel", "geometry_msgs/msg/Twist", typestore=store)
        for k in range(count):
            writer.write(camera, START + 33 * MS * k, raw)
            message = store.serialize_cdr(twist(store, 0.5, 0.0), "geometry_msgs/msg/Twist")
            writer.write(command, START + 33 * MS * k, message)
    program = f"""
from pathlib import Path
from tuning.io.csv_file import Column
from tuning.io.logs import read
recording = read({str(tmp_path / "bag")!r})
print(recording.streams[0].size, recording.unread["/image"][1])
print(next(line.split()[1] for line in Path("/proc/self/status").read_text().splitlines() if "VmHWM" in line))
"""
    counts, most = commands.python(program).splitlines()
    assert counts == f"{count} {count}" and count * size > 200e6
    assert float(most) < 120e3  # kB, of which 50 000 are Python's and NumPy's
