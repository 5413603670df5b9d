"""A folder with a text table for each topic, as exporters of bags and loggers write them."""

import numpy as np
import pytest

from tuning.io.csv_file import Column, numbers
from tuning.io.csv_file import read as read_csv
from tuning.io.logs import is_recording, read
from tuning.io.logs.roles import chosen
from tuning.io.logs.rows import table

T0 = 1_650_775_094  # s since 1970


def lines(path, header, rows, mark=","):
    path.write_text("\n".join([header, *(mark.join(str(cell) for cell in row) for row in rows)]) + "\n")


def turning(t):
    """A circle of 2 m, one turn in 10 s, that began at 3 rad: the angle leaps after a quarter of a second."""
    return 3.0 + 0.2 * np.pi * t


def stamped(t):
    """Seconds and nanoseconds."""
    return [divmod(T0 * 10**9 + round(1e9 * s), 10**9) for s in t]


def drive(folder, pose, header):
    """Commands at 20 Hz and a pose at 40 Hz, in two files with seconds and nanoseconds."""
    t = 0.05 * np.arange(200)
    lines(folder / "commands.csv", ",s,ns,V,delta", [(k, *s, 1.0, 0.1) for k, s in enumerate(stamped(t))])
    t = 0.0125 + 0.025 * np.arange(400)
    rows = [(*s, *(float(x) for x in pose(k, turning(t[k])))) for k, s in enumerate(stamped(t))]
    lines(folder / "pose.csv", f"s,ns,{header}", rows)
    return folder


@pytest.mark.parametrize(
    "pose, header, place",
    [
        (lambda k, a: (np.sin(a / 2), np.cos(a / 2)), "q.z,q.w", Column("", quaternion=("pose.q.z", "pose.q.w"))),
        (  # a quaternion and its negative are one rotation, and a sender changes between them as it likes
            lambda k, a: ((-1) ** (k // 3) * np.sin(a / 2), (-1) ** (k // 3) * np.cos(a / 2)),
            "q.z,q.w",
            Column("", quaternion=("pose.q.z", "pose.q.w")),
        ),
        (lambda k, a: (np.arctan2(np.sin(a), np.cos(a)),), "yaw", Column("pose.yaw")),
        (lambda k, a: (np.rad2deg(a) % 360,), "yaw", Column("pose.yaw", "deg")),
    ],
)
def test_a_heading_between_two_samples_does_not_leap(tmp_path, pose, header, place):
    recording = read(str(drive(tmp_path, pose, header)))
    named = {"heading": place, "speed_cmd": Column("commands.V"), "steering_angle_cmd": Column("commands.delta")}
    rows = table(recording, chosen(recording, {}, list(named)), named, ["speed_cmd", "steering_angle_cmd"])
    t, seen = rows.columns["t"] - T0, np.isfinite(rows.columns["heading"])
    assert seen.sum() > 390
    off = rows.columns["heading"][seen] - turning(t[seen])
    np.testing.assert_allclose(
        off, 2 * np.pi * np.round(off[0] / (2 * np.pi)), atol=1e-6
    )  # times are doubles since 1970


def test_parts_of_a_quaternion_must_be_of_one_topic(tmp_path):
    recording = read(str(drive(tmp_path, lambda k, a: (0.0, 1.0), "q.z,q.w")))
    with pytest.raises(ValueError, match=r"pose\.q\.z, commands\.V must be of one topic"):
        table(recording, {}, {"heading": Column("", quaternion=("pose.q.z", "commands.V"))})
    with pytest.raises(ValueError, match=r"it has no pose\.yaw"):
        table(recording, {}, {"heading": Column("pose.yaw")})


@pytest.mark.parametrize(
    "header, cells",
    [
        ("t,x", lambda s: (s - T0,)),
        ("Time,x", lambda s: (s,)),
        ("timestamp [ms],x", lambda s: (1e3 * s,)),
        ("stamp,x", lambda s: (round(1e9 * s),)),
        ("%time,x", lambda s: (round(1e9 * s),)),
        ("sec,nanosec,x", lambda s: divmod(round(1e9 * s), 10**9)),
        ("header.stamp.secs,header.stamp.nsecs,x", lambda s: divmod(round(1e9 * s), 10**9)),
        ("header_stamp_sec,header_stamp_nanosec,x", lambda s: divmod(round(1e9 * s), 10**9)),
        ("timestamp,x", lambda s: (f"2022-04-24T04:38:{14 + s - T0:09.6f}Z",)),
        ("# Time [s]    way of the robot [m]\n", lambda s: (s,)),
    ],
)
def test_times_are_found_as_loggers_write_them(tmp_path, header, cells):
    own = T0 + 0.25 * np.arange(12)
    rows = [(*cells(float(s)), k) for k, s in enumerate(own)]
    lines(tmp_path / "odom.dat", header.rstrip("\n"), rows, "\t" if header.startswith("#") else ",")
    (stream,) = read(str(tmp_path)).streams
    np.testing.assert_allclose(np.diff(stream.arrival), 250_000_000, atol=1000)  # a double of 1.65e18 is 256 apart
    assert list(stream.fields) == (["way of the robot [m]"] if header.startswith("#") else ["x"])
    np.testing.assert_array_equal(next(iter(stream.fields.values())), np.arange(12))


def test_fields_called_as_those_of_messages_serve_as_these_do(tmp_path):
    t = 0.1 * np.arange(50)
    quaternion = "field.pose.pose.orientation"
    header = f"%time,field.header.stamp,field.pose.pose.position.x,field.pose.pose.position.y,{quaternion}.x,"
    header += f"{quaternion}.y,{quaternion}.z,{quaternion}.w,field.twist.twist.linear.x,field.twist.twist.angular.z"
    nano = [T0 * 10**9 + round(1e9 * s) for s in t]
    lines(
        tmp_path / "odom.csv",
        header,
        [(n + 5_000_000, n, s, 0, 0, 0, 0, 1, 1, 0) for n, s in zip(nano, t, strict=True)],
    )
    lines(tmp_path / "cmd_vel.csv", "Time,linear.x,angular.z,frame", [(n * 1e-9, 1, 0.5, "base") for n in nano])
    recording = read(str(tmp_path))
    found = chosen(recording, {})
    assert {name: stream.topic for name, (stream, _) in found.items()} == {
        "pose": "odom", "speed": "odom", "command": "cmd_vel",
    }  # fmt: skip
    rows = table(recording, found)
    assert rows.stamps == "header" and "later by odom 5 ms" in rows.notes[0]
    np.testing.assert_allclose(rows.columns["x"], rows.columns["t"] - T0, atol=1e-6)


def test_our_own_names_need_no_columns_named(tmp_path):
    lines(tmp_path / "poses.csv", "t,x,y,heading", [(0.1 * k, k, 0, 0) for k in range(20)])
    lines(tmp_path / "told.csv", "t,cmd_v,cmd_w", [(0.1 * k, 1, 0) for k in range(20)])
    found = chosen(read(str(tmp_path)), {})
    assert {name: stream.topic for name, (stream, _) in found.items()} == {"pose": "poses", "command": "told"}


def test_what_is_damaged_is_left_out_and_counted(tmp_path):
    rows = [(0.1 * k, k) for k in range(10)]
    lines(tmp_path / "a.csv", "t,x", [*rows, (1.0, "oops"), (1.1,)])
    lines(tmp_path / "b.csv", "t,x", rows)
    (tmp_path / "places.csv").write_text("x,y\n1,2\n")
    (tmp_path / "noise.csv").write_bytes(b"\x00\x01")
    (tmp_path / "readme.md").write_text("no table")
    recording = read(str(tmp_path))
    assert [(stream.topic, stream.size) for stream in recording.streams] == [("a", 10), ("b", 10)]
    assert recording.unread == {"places": ("table without a column of times", 1)}
    assert (
        recording.lost[0] == "a.csv: 2 damaged rows are left out" and "noise.csv is no text file" in recording.lost[1]
    )


def test_rows_without_a_time_are_left_out_and_counted(tmp_path):
    lines(tmp_path / "a.csv", "t,x", [(0.1 * k if k != 3 else "", k) for k in range(10)])
    lines(tmp_path / "b.csv", "s,ns,x", [(T0, 10**8 * k if k != 5 else "", k) for k in range(10)])
    recording = read(str(tmp_path))
    for stream, lost in zip(recording.streams, (3, 5), strict=True):
        np.testing.assert_array_equal(stream.fields["x"], [k for k in range(10) if k != lost])
        assert np.all(np.diff(stream.arrival) > 0)
    assert recording.lost == tuple(f"{name}.csv: 1 rows without a time are left out" for name in "ab")


def test_a_folder_without_tables_is_no_recording_of_them(tmp_path):
    (tmp_path / "readme.md").write_text("no table")
    assert is_recording(str(tmp_path))
    with pytest.raises(ValueError, match=r"a folder without"):
        read(str(tmp_path))


@pytest.mark.parametrize("mark", [";", "\t", " "])
@pytest.mark.parametrize("header", [True, False])
def test_decimal_commas_are_read(tmp_path, mark, header):
    file = tmp_path / "log.csv"
    file.write_text("\n".join([mark.join(("t", "x", "y"))] * header + [mark.join(row) for row in DUTCH]) + "\n")
    names = ("t", "x", "y") if header else ("1", "2", "3")
    if header or mark != " ":  # separated by blanks and without a header, commas may as well separate
        columns = read_csv(file, names, time=names[0])
        np.testing.assert_allclose([columns[name] for name in names], [[0.0, 0.5, 1.0], [1.25, -2, 3e3], [0, 1e-3, 7]])


DUTCH = [("0,0", "1,25", "0"), ("0,5", "-2,0", ",001"), ("1,0", "3,0e3", "7")]


def test_a_folder_of_which_nothing_can_be_read_says_why(tmp_path):
    (tmp_path / "a.csv").write_text("t;x\n0,5;1\n1,5;1.2\n")
    with pytest.raises(ValueError, match=r"it holds nothing; .*a\.csv: numbers must have one decimal mark"):
        read(str(tmp_path))


def test_two_decimal_marks_are_refused(tmp_path):
    (tmp_path / "log.csv").write_text("t;x\n0,5;1\n1,5;1.234\n")
    with pytest.raises(ValueError, match=r"one decimal mark: 0,5 in row 2, 1\.234 in row 3"):
        read_csv(tmp_path / "log.csv", ("t", "x"))


def test_a_comma_in_quotes_is_no_decimal_one_where_commas_separate(tmp_path):
    (tmp_path / "log.csv").write_text('t,x\n0,"1,234"\n1,"2,000"\n')  # a thousand, as office programs write it
    with pytest.raises(ValueError, match=r"row 2, column x: '1,234' must be a finite number"):
        read_csv(tmp_path / "log.csv", ("t", "x"))


def test_commas_with_blanks_behind_them_separate(tmp_path):
    (tmp_path / "log.csv").write_text("t,\tx\n0.5,\t1\n")
    columns, damaged = numbers(tmp_path / "log.csv")
    assert damaged == 0 and {name: values.tolist() for name, values in columns.items()} == {"t": [0.5], "x": [1.0]}
