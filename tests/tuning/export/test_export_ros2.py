"""The exported ROS 2 package, imported against a stub of ROS and driven in closed loop with simple robots."""

import ast
import functools
import importlib
import math
import sys
import types
from types import SimpleNamespace as Space
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

import agvjax
from ros_stub import Node, Refused, Robot, install, path, pose, said, stamp, twist, twist_stamped
from tuning.config.write import gains_table
from tuning.export import artefact, ros2
from tuning.export.ros2_node import odometry, reference

LAW = agvjax.NeuroBackstepping(k1=3.0, k2=10.0, Lam=2.0, omega_n=30.0)
CAR_LAW = agvjax.NeuroBackstepping(k1=2.0, k2=8.0, Lam=1.0, omega_n=30.0)
SPEEDS = agvjax.DifferentialDrive(drive=agvjax.SpeedDrive(gain=2.0))
VEHICLES = {
    "unicycle": (LAW, agvjax.Unicycle(L=0.15), [3.0, 6.0]),
    "torques": (LAW, agvjax.DifferentialDrive(), [6.0, 6.0]),
    "wheel_speeds": (LAW, SPEEDS, [30.0, 30.0]),
    "car": (CAR_LAW, agvjax.KinematicSingleTrack(), [19.0, 0.55]),
}
TELLING = {"unicycle": "L", "torques": "inertia", "wheel_speeds": "track", "car": "lf"}


@pytest.fixture
def ros(monkeypatch):
    install(monkeypatch)


def controller(kind):
    law, vehicle, limits = VEHICLES[kind]
    windup = agvjax.BackCalculation(speed=0.8, limits=np.array(limits))
    return agvjax.Sampled(inner=law, vehicle=vehicle, period=0.02, anti_windup=windup)


def package_of(law, folder, *name):
    """The files of the package of a law, through a file of its gains."""
    (folder / "gains.toml").write_text(gains_table(law))
    return ros2.files(artefact.read(str(folder / "gains.toml")), *name)


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """Packages by the vehicle's kind, written to a folder that Python imports from."""
    packages = tmp_path_factory.mktemp("packages")

    @functools.cache
    def package(kind):
        files = package_of(controller(kind), packages, f"follows_{kind}")
        for name, text in files.items():
            file = packages / kind / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text)
        return packages / kind, files

    yield package
    for name in [name for name in sys.modules if name.startswith("follows_")]:
        del sys.modules[name]


@pytest.fixture
def start(exported, ros, monkeypatch):
    def node(kind="unicycle", **launched):
        folder, _ = exported(kind)
        monkeypatch.syspath_prepend(str(folder))
        for name in [name for name in sys.modules if name.endswith(".node") and name.startswith("follows_")]:
            del sys.modules[name]  # it was imported against the stub of another test
        monkeypatch.setattr(Node, "launched", launched)
        return importlib.import_module(f"follows_{kind}.node").FollowerNode()

    return node


def wave(scale=1.0):
    """A path of 6 m and a finer picture of it to measure distances from: y = 0.5 sin(1.5 x)."""
    return [scale * np.stack([x, 0.5 * np.sin(1.5 * x)], 1) for x in (np.linspace(0, 6, n) for n in (121, 6001))]


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=[pytest.mark.slow] * (kind != "torques")) for kind in VEHICLES]
)
def test_the_node_drives_a_robot_along_its_path_and_stops_at_the_end(start, kind):
    car = kind == "car"
    scale, L = (6.0, float(VEHICLES["car"][1].L)) if car else (1.0, 0.15)
    node, (points, fine) = start(kind, speed=2.0 if car else 0.6), wave(scale)
    robot = Robot(node, path(points), x=-L, y=0.1 * scale / 2, heading=0.5, L=L)
    robot.drive(23.5 if car else 15.5)
    assert said(node, "error") == []
    assert [text.split(",")[0] for text in said(node, "info")] == ["path begun", "path finished"]
    along = np.array(robot.points)
    off = np.array([np.linalg.norm(fine - point, axis=1).min() for point in along])
    moving = np.flatnonzero(np.abs(robot.speeds) > 0.05 * scale)
    settled = moving[moving > 200]
    assert len(settled) > 300
    assert off[settled].max() < (0.03 if car else 0.01)
    assert np.linalg.norm(robot.points[-1] - points[-1]) < 0.05
    assert np.all(np.array(robot.commands)[-20:] == 0.0)


def straight(length=6.0, count=61):
    return path(np.stack([np.linspace(0.0, length, count), np.zeros(count)], 1))


def test_it_stands_still_without_a_path_and_without_fresh_odometry(start):
    node = start()
    robot = Robot(node)
    robot.drive(0.2)
    assert not np.any(robot.commands)  # no path yet
    assert node.said == []
    robot.take(straight())
    robot.drive(3.0)
    assert robot.commands[-1][0] == pytest.approx(0.4, abs=0.02)
    before = len(robot.commands)
    robot.drive(1.0, sees=False)
    blind = np.array(robot.commands[before:])
    assert np.all(blind[11:] == 0.0) and np.all(blind[:9, 0] > 0.3)  # the timeout is 0.2 s, ten periods
    assert "no odometry newer than 0.2 s" in said(node, "error")[0]
    robot.drive(20.0)
    assert "path joined again" in said(node, "info")[1]
    assert abs(robot.points[-1][0] - 6.0) < 0.05


def test_odometry_in_another_frame_or_without_a_rotation_is_none(start):
    robot = Robot(start(), straight())
    node = robot.node
    for _ in range(20):
        robot.report("map")
        robot.drive(0.02, sees=False)
    assert not np.any(robot.commands)
    assert "odometry is in frame 'map', not in 'odom'" in said(node, "error")
    place = pose(0.0, 0.0, 0.0, Node.now, "odom")
    place.pose.orientation.w = 0.0
    node.topics["odom"](Space(header=place.header, pose=Space(pose=place.pose), twist=Space(twist=twist())))
    assert "no unit quaternion" in said(node, "error")[-1]


@pytest.mark.parametrize(
    "message, reason",
    [
        (path([], frame=""), None),  # an empty path is the order to stop
        (path([(0.0, 0.0), (1.0, 0.0)], frame="map"), "in frame 'map', not in 'odom'"),
        (path([(0.0, 0.0), (math.nan, 0.0)]), "not finite"),
        (path([(0.0, 0.0)]), "no two poses"),
        (path([(1.0, 1.0)] * 5), "no two poses"),
    ],
)
def test_a_path_that_is_none_stops_the_robot_and_is_refused_with_a_reason(start, message, reason):
    robot = Robot(start(), straight())
    robot.drive(2.0)
    assert robot.commands[-1][0] > 0.2
    robot.take(message)
    robot.drive(0.1)
    assert not np.any(robot.commands[-5:])
    errors = said(robot.node, "error")
    assert errors == [] if reason is None else reason in errors[-1]


def test_the_last_thing_the_node_says_is_to_stop(start, monkeypatch):
    node, said_last = start(), []
    module = sys.modules[type(node).__module__]
    monkeypatch.setattr(module, "FollowerNode", lambda: node)
    monkeypatch.setattr(node, "destroy_node", lambda: said_last.append(node.sent[-1]), raising=False)

    def spin(node):
        robot = Robot(node, straight())
        robot.drive(2.0)
        assert robot.commands[-1][0] > 0.2
        raise KeyboardInterrupt

    for name, stub in {"init": lambda **k: None, "spin": spin, "ok": lambda: True, "shutdown": lambda: None}.items():
        monkeypatch.setattr(module.rclpy, name, stub)
    module.main()
    ((topic, message),) = said_last
    assert topic == "cmd_vel" and message.linear.x == 0.0 and message.angular.z == 0.0


def test_a_period_that_begins_late_is_counted(start):
    node = start()
    robot = Robot(node)
    robot.drive(0.1)
    assert node.late == 0
    Node.now += 0.02
    robot.drive(0.1)
    assert node.late == 1 and said(node, "warning") == ["1 periods began late"]


def test_a_path_out_of_reach_is_not_begun_and_a_lost_one_given_up(start):
    robot = Robot(start(), straight(), y=3.0)
    robot.drive(0.1)
    assert not np.any(robot.commands)
    assert "comes no nearer than 3.00 m" in said(robot.node, "error")[0]
    robot.state[:] = 0.0
    robot.take(straight())
    robot.drive(10.0, free=False)  # held: the reference runs away from it
    assert "max_error is 1" in said(robot.node, "error")[1]
    assert not np.any(robot.commands[-5:])
    assert robot.speeds.max() <= 0.3 + 1e-12  # no further from the measured 0 than the lead


def test_a_path_that_replaces_another_is_joined_at_the_pace_that_is_driven(start):
    robot = Robot(start(), straight())
    robot.drive(4.0)
    for _ in range(6):
        ahead = robot.points[-1][0] + np.linspace(0.0, 4.0, 41)
        robot.take(path(np.stack([ahead, np.zeros(41)], 1)))
        robot.drive(0.5)
    speeds = robot.speeds[-150:]
    assert speeds.min() > 0.37 and speeds.max() < 0.43


def pruned(points, times, place):
    """What lies ahead of the pose that is nearest to the vehicle."""
    first = min(int(np.argmin(np.linalg.norm(points - place, axis=1))), len(points) - 1)
    return points[first:], None if times is None else times[first:]


LINE = np.stack([np.linspace(0.0, 6.0, 61), np.zeros(61)], 1)
QUARTERS = 0.25 * np.arange(61)  # s, 0.4 m/s along the line
SENT_AGAIN = {  # of points and the time of a message: what is sent then
    "the same": lambda points, place: (points, None),
    "without what lies behind": lambda points, place: pruned(points, None, place),
    "stamped by now": lambda points, place: (points, Node.now + QUARTERS),
    "stamped, without what lies behind": lambda points, place: pruned(points, QUARTERS, place),
    "from now on, without what lies behind": lambda points, place: pruned(points, Node.now + QUARTERS, place),
    "a loop that stamps": lambda points, place: (points, Node.now + 2e-5 * np.arange(61)),
}


@pytest.mark.parametrize("sent", SENT_AGAIN)
@pytest.mark.parametrize("every", [1, 2, 10])  # periods: 50, 25, 5 Hz
def test_the_same_path_sent_again_changes_nothing(start, monkeypatch, sent, every):
    drives = []
    for again in (False, True):
        monkeypatch.setattr(Node, "now", 100.0)
        robot = Robot(start(), x=-0.15)
        for k in range(900):
            if k == 0 or (again and k % every == 0):
                points, times = SENT_AGAIN[sent](LINE, robot.state[:2])
                robot.take(path(points, times))
            robot.drive(0.02)
        infos = [text.split(",")[0] for text in said(robot.node, "info")]
        assert infos == ["path begun", "path finished"] and said(robot.node, "error") == []
        drives.append((np.array(robot.commands), robot.state))
    np.testing.assert_array_equal(*(commands for commands, _ in drives))
    assert abs(drives[0][1][0] + 0.15 - 6.0) < 0.02  # 6 m, of the point ahead of the axle


@pytest.mark.parametrize("every", [1, 3, 10])
@pytest.mark.parametrize("window", ["ahead", "from the vehicle"])
def test_a_window_of_a_path_that_moves_with_the_vehicle_is_driven_as_the_whole(start, every, window):
    """A local planner: 2 m of the path, their first pose on the path or where the vehicle is."""
    robot, (points, fine) = Robot(start(), x=-0.15), wave()
    points = points[::2]
    for k in range(950):
        if k % every == 0 and (k == 0 or robot.node.follower.reference is not None):
            ahead = pruned(points, None, robot.points[-1] if robot.points else points[0])[0][:20]
            robot.take(
                path(ahead if window == "ahead" else np.concatenate([robot.points[-1:] or ahead[:1], ahead[1:]]))
            )
        robot.drive(0.02)
    length = np.linalg.norm(np.diff(fine, axis=0), axis=1).sum()
    assert said(robot.node, "error") == [] and np.linalg.norm(robot.points[-1] - points[-1]) < 0.03
    moved = np.flatnonzero(robot.speeds > 0.0)[-1] * 0.02
    # ramps of parabolas of 0.3 m/s^2 to 0.4 m/s take 2 s, each a half of the way that 0.4 m/s would take it
    assert moved == pytest.approx(length / 0.4 + 2.0, abs=0.6)


def test_other_timings_of_one_path_are_driven_from_where_the_vehicle_is(start):
    robot = Robot(start(), x=-0.15)
    for k in range(1200):
        if k % 5 == 0 and (k == 0 or robot.node.follower.reference is not None):
            robot.take(path(LINE, QUARTERS * (1.0 if k % 10 else 0.4 / 0.3)))  # 0.4 m/s and 0.3 m/s in turn
        robot.drive(0.02)
    assert said(robot.node, "error") == [] and abs(robot.points[-1][0] - 6.0) < 0.02
    inner = robot.speeds[150:500]
    assert inner.min() > 0.28 and inner.max() < 0.42
    assert np.abs(np.diff(robot.speeds)).max() < 0.02


def test_a_path_that_is_over_is_not_begun_by_being_sent_again(start):
    robot = Robot(start(), straight(1.0, 11), x=-0.15)
    node = robot.node
    robot.drive(8.0)
    assert "path finished" in said(node, "info")[-1]
    for _ in range(20):
        robot.take(straight(1.0, 11))
        robot.drive(0.02)
    assert np.all(robot.speeds[-20:] == 0.0) and len(said(node, "info")) == 2
    (warning,) = [text for text in said(node, "warning") if "sent again" in text]
    assert "an empty one" in warning
    robot.state[:] = 0.0
    robot.take(path([], frame=""))
    robot.take(straight(1.0, 11))
    robot.drive(2.0)
    assert robot.speeds[-1] > 0.2 and "path begun" in said(node, "info")[-1]


def test_a_path_that_was_lost_is_not_begun_by_being_sent_again(start):
    robot = Robot(start(), straight())
    robot.drive(2.0)
    robot.state[1] = 2.0  # carried away
    for _ in range(50):
        robot.take(straight())
        robot.drive(0.02)
    assert np.all(robot.speeds[-49:] == 0.0)
    assert ["max_error is 1" in text for text in said(robot.node, "error")] == [True]
    robot.state[1] = 0.0
    robot.take(straight())
    robot.drive(1.0)
    assert np.all(robot.speeds[-50:] == 0.0)
    robot.take(path([], frame=""))
    robot.take(straight())
    robot.drive(2.0)
    assert robot.speeds[-1] > 0.2


@pytest.mark.parametrize(
    "times, word",
    [
        (2e-5 * np.arange(61), "more than max_speed"),
        (np.append(QUARTERS[:-1], QUARTERS[-2] + 0.01), "more than max_speed"),  # one segment alone, 10 m/s
        (np.zeros(61), "all equal"),
        (np.full(61, 1.7e9), "all equal"),
        (-QUARTERS, "do not increase"),
        (np.where(np.arange(61) == 30, 0.0, QUARTERS), "do not increase"),
        (np.append(0.0, 1.7e9 + QUARTERS[:-1]), "not been set"),
    ],
)
def test_stamps_that_are_no_timing_are_not_driven_and_a_warning_says_so_once(start, times, word):
    robot = Robot(start(), x=-0.15)
    for _ in range(2):  # again, by a path that is another
        robot.take(path(LINE, 1.0e3 + times if times.min() < 0 else times))
        robot.drive(4.0)
        robot.take(path([], frame=""))
        robot.state[:] = [-0.15, 0.0, 0.0, 0.0, 0.0]
        robot.drive(0.1)
    assert robot.speeds[150:200].mean() == pytest.approx(0.4, abs=0.02) and robot.speeds.max() < 0.43
    (warning,) = said(robot.node, "warning")
    assert word in warning and "speed = 0.4" in warning and "use_stamps" in warning


def test_stamps_are_not_looked_at_where_they_are_not_used(start):
    robot = Robot(start(use_stamps=False), path(LINE, 2 * QUARTERS), x=-0.15)
    robot.drive(4.0)
    assert robot.speeds[150:].mean() == pytest.approx(0.4, abs=0.02) and said(robot.node, "warning") == []


def test_cmd_vel_may_be_stamped(start):
    node = start(stamped=True, base_frame="base_footprint")
    robot = Robot(node, straight())
    robot.drive(3.0)
    assert node.published is twist_stamped
    topic, message = node.sent[-1]
    assert message.header.frame_id == "base_footprint" and message.twist.linear.x > 0.3
    assert message.header.stamp == stamp(Node.now - 0.02)
    assert start().published is twist  # the default, which README says robots need that do not take the other


@pytest.mark.parametrize(
    "kind, base, wanted",
    [  # by hand: a base of half the track makes half the difference of the wheels of a yaw rate, so it is told twice
        ("wheel_speeds", {"base_track": 0.5}, (1.0, 2.0)),
        ("torques", {"base_track": 0.5}, (1.0, 2.0)),
        ("wheel_speeds", {"base_wheel_radius": 2.0}, (2.0, 2.0)),  # turns wheels half as fast as it should
        ("car", {"base_wheelbase": 0.5}, (1.0, 2.0)),
    ],
)
def test_a_base_with_other_numbers_is_told_what_it_makes_the_same_of(start, kind, base, wanted):
    """Parameters are shares of the vehicle's own, the wanted velocity shares of what is told without them."""
    own = start(kind).follower.values
    launched = {name: share * own[name] for name, share in base.items()}
    told = [start(kind, **more).follower for more in ({}, launched)]
    (v, w), (v_base, w_base) = (f.vehicle.command(0.3, 0.2, f.values) for f in told)
    assert (v, w) == (0.3, 0.2)  # by default the vehicle's own
    assert (v_base / v, w_base / w) == pytest.approx(wanted)


def test_a_skid_steered_base_turns_as_the_law_asked(start):
    """The wheels slip: turning takes 1.75 times the difference that the base's own track makes of a yaw rate."""
    bends = []
    for share in (1.0, 1 / 1.75):
        Node.now = 100.0
        own = start("wheel_speeds").follower.values["base_track"]
        robot = Robot(start("wheel_speeds", base_track=share * own, speed=0.3), path(wave()[0]), x=-0.15, heading=0.6)
        rate = robot.rate
        robot.rate = lambda state, command, rate=rate: rate(state, command * np.array([1.0, 1 / 1.75]))
        robot.drive(12.0)
        off = [np.linalg.norm(wave()[1] - point, axis=1).min() for point in robot.points[200:]]
        bends.append(max(off))
    assert bends[1] < 0.01 < bends[0]


def test_speeds_stay_within_the_limits_of_the_node(start):
    node = start(max_speed=0.3, max_yaw_rate=0.5, max_reverse_speed=0.0)
    robot = Robot(node, path(wave()[0]), x=0.1, y=0.4, heading=1.3)
    robot.drive(20.0)
    v, w = np.array(robot.commands).T
    assert v.max() == 0.3 and v.min() == 0.0 and np.abs(w).max() == 0.5
    assert node.follower.clipped > 0 or "limited" in said(node, "info")[-1]


def test_stamps_that_increase_say_how_fast_each_part_is_driven(start):
    node, x = start(), np.linspace(0.0, 4.0, 41)
    times = 50.0 + np.where(x < 2.0, x / 0.5, 4.0 + (x - 2.0) / 0.2)
    robot = Robot(node, path(np.stack([x, 0 * x], 1), times), x=-0.15)
    robot.drive(25.0)
    places, speeds = np.array(robot.points)[:, 0], robot.speeds
    assert speeds[(places > 1.2) & (places < 1.6)].mean() == pytest.approx(0.5, abs=0.02)
    assert speeds[(places > 2.5) & (places < 3.5)].mean() == pytest.approx(0.2, abs=0.02)


def test_a_parameter_out_of_bounds_is_refused_with_a_reason_and_changes_nothing(start):
    node = start()
    assert "gt(0.0)" in node.set_parameter("controller.inner.k1", -1.0)
    assert "lt_eq(100.0)" in node.set_parameter("controller.inner.k1", 101.0)  # 2 / period
    assert "finite" in node.set_parameter("max_speed", math.nan)
    assert "fixed_size(2)" in node.set_parameter("controller.anti_windup.limits", [1.0])
    assert "lower_element_bounds" in node.set_parameter("controller.anti_windup.limits", [1.0, 0.0])
    assert "read-only" in node.set_parameter("controller.period", 0.01)
    assert "read-only" in node.set_parameter("controller.vehicle.L", 0.2)
    node.on_timer()
    assert node.follower.values["controller.inner.k1"] == 3.0
    assert node.follower.values["controller.anti_windup.limits"] == [3.0, 6.0]


def test_a_gain_is_taken_while_it_drives_and_the_state_of_the_law_stays(start):
    robot = Robot(start(), straight(), x=-0.15)
    node = robot.node
    robot.drive(4.0)
    assert node.set_parameter("controller.inner.k1", 4.0) == ""
    robot.drive(0.1)
    assert node.follower.values["controller.inner.k1"] == 4.0
    assert np.abs(np.diff(robot.speeds[-20:])).max() < 0.01  # no bump
    robot.drive(20.0)
    assert said(node, "error") == [] and "path finished" in said(node, "info")[-1]


def test_a_gain_that_the_law_only_starts_from_changes_nothing_while_it_drives(start, monkeypatch):
    drives = []
    for changes in (False, True):
        monkeypatch.setattr(Node, "now", 100.0)
        robot = Robot(start(), straight(), y=0.1)
        robot.drive(1.0)
        if changes:
            assert robot.node.set_parameter("controller.inner.varphi_start", 90.0) == ""
        robot.drive(1.0)
        drives.append(np.array(robot.commands))
    np.testing.assert_array_equal(*drives)


@pytest.mark.parametrize("name, value", [("controller.inner.k2", 0.0), ("controller.period", 0.01), ("timeout", -1.0)])
def test_a_bad_parameter_at_launch_keeps_the_node_from_starting(start, name, value):
    with pytest.raises(Refused, match=name):
        start(**{name: value})


TYPES = {"double": float, "double_array": list, "string": str, "bool": bool}
RULES = {
    "bounds<>": lambda x, low, high: low <= x <= high,
    "gt<>": lambda x, low: x > low,
    "gt_eq<>": lambda x, low: x >= low,
    "lt<>": lambda x, high: x < high,
    "lt_eq<>": lambda x, high: x <= high,
    "fixed_size<>": lambda x, size: len(x) == size,
    "lower_element_bounds<>": lambda x, low: min(x) >= low,
    "not_empty<>": lambda x: len(x) > 0,
}


def flat(tree, prefix=""):
    """The parameters of a file by their dotted names."""
    for name, part in tree.items():
        if isinstance(part, dict) and not isinstance(part.get("type"), str):
            yield from flat(part, f"{prefix}{name}.")
        else:
            yield prefix + name, part


@pytest.mark.parametrize("kind", VEHICLES)
def test_the_parameters_files_are_yaml_whose_defaults_lie_in_their_bounds(exported, kind):
    _, made = exported(kind)
    bounds, values = made[f"follows_{kind}/parameters.yaml"], made["config/params.yaml"]
    assert not [token for token in yaml.scan(bounds + values) if isinstance(token, yaml.AliasToken)]
    tables = dict(flat(yaml.safe_load(bounds)[f"follows_{kind}"]))
    assert dict(flat(yaml.safe_load(values)["/**"]["ros__parameters"])) == {
        name: table["default_value"] for name, table in tables.items()
    }
    for name, table in tables.items():
        value = table["default_value"]
        assert type(value) is TYPES[table["type"]] and table["description"], name
        for rule, limits in table.get("validation", {}).items():
            assert RULES[rule](value, *limits), name
    tuned = {f"controller.{name}": value for name, value in agvjax.leaves(controller(kind)).items()}
    assert set(tuned) == {name for name in tables if name.startswith("controller.")}
    for name, value in tuned.items():
        assert np.array_equal(tables[name]["default_value"], value), name
    k1 = tables["controller.inner.k1"]
    assert "1/s" in k1["description"] and "eq. (32)" in k1["description"]
    assert k1["validation"] == {"gt<>": [0.0], "lt_eq<>": [100.0]}  # 2 / period
    assert tables["controller.period"]["read_only"] and tables["controller.vehicle." + TELLING[kind]]["read_only"]


def test_the_package_is_one_that_ros_can_build(exported, monkeypatch):
    _, made = exported("unicycle")
    root = ElementTree.fromstring(made["package.xml"])
    assert root.get("format") == "3" and root.findtext("name") == "follows_unicycle"
    assert root.findtext("export/build_type") == "ament_python"
    given = {}
    setuptools = types.ModuleType("setuptools")
    monkeypatch.setattr(setuptools, "setup", given.update, raising=False)
    monkeypatch.setitem(sys.modules, "setuptools", setuptools)
    exec(compile(made["setup.py"], "setup.py", "exec"), {})
    listed = [file for _, files in given["data_files"] for file in files]
    assert set(listed) <= set(made) and "resource/follows_unicycle" in listed
    assert given["version"] == root.findtext("version")
    assert "script_dir=$base/lib/follows_unicycle" in made["setup.cfg"]
    for name, text in made.items():
        assert "@" not in text.replace("maintainer@example.com", "").replace("W @ ", "") or name.endswith(".py"), name
        if name.endswith(".py"):
            tree = ast.parse(text, feature_version=(3, 10))  # Ubuntu 22.04
            used = {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and not node.level}
            used |= {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
            assert not {"agvjax", "jax", "tuning"} & {module.split(".")[0] for module in used}
    assert "configuration_sha256" in made["README.md"] and "0.15 m ahead" in made["README.md"]


@pytest.mark.parametrize("name", ["Follower", "2wheels", "a", "two words", "a__b", "../up"])
def test_a_name_that_is_none_of_a_package_is_refused(name, tmp_path):
    with pytest.raises(agvjax.InputError, match="--name"):
        package_of(controller("unicycle"), tmp_path, name)


def test_a_vehicle_that_takes_no_velocity_is_refused(tmp_path):
    with pytest.raises(agvjax.InputError, match="controller.vehicle = Decoupled"):
        package_of(agvjax.Sampled(inner=LAW, vehicle=agvjax.Decoupled()), tmp_path)


def test_odometry_of_the_axle_becomes_the_motion_of_the_point_ahead():
    s = math.sqrt(0.5)
    assert odometry.yaw(0.0, 0.0, s, s) == pytest.approx(math.pi / 2)
    assert odometry.yaw(0.0, 0.0, 1.0, 0.0) == pytest.approx(math.pi)
    assert odometry.yaw(s, 0.0, 0.0, s) == pytest.approx(0.0)  # rolled over by a right angle, not turned
    seen = odometry.measured((1.0, 2.0), math.pi / 2, 0.5, 2.0, 0.15)  # ahead is +y, to the left -x
    np.testing.assert_allclose(seen["position"], [1.0, 2.15])
    np.testing.assert_allclose(seen["velocity"], [-0.3, 0.5], atol=1e-15)
    assert odometry.unwrapped(-3.1, 3.1) == pytest.approx(2 * math.pi - 3.1)
    assert odometry.unwrapped(0.1, 12.6) == pytest.approx(0.1 + 4 * math.pi)
    with pytest.raises(ValueError, match="finite"):
        odometry.measured((1.0, math.inf), 0.0, 0.5, 2.0, 0.15)


def test_the_reference_is_smooth_its_derivatives_those_of_differences():
    made = reference.Reference(wave()[0], spacing=0.1)
    made.drive(0.0, 0.0, 0.0, 0.0, 0.4, 0.3, 1.0, 1.5)
    times, h = np.linspace(0.1, made.motion.duration - 0.1, 400), 1e-4
    now, later, before = ([made.at(t + d, 0.0) for t in times] for d in (0.0, h, -h))
    tolerances = {"position": 1e-6, "velocity": 2e-4, "heading": 1e-5}
    rates = ("velocity", "acceleration", "heading_rate")
    for (name, most), rate in zip(tolerances.items(), rates, strict=True):
        slopes = [(b[name] - a[name]) / (2 * h) for a, b in zip(before, later, strict=True)]
        np.testing.assert_allclose(slopes, [x[rate] for x in now], atol=most)
    speeds = [np.linalg.norm(x["velocity"]) for x in now]
    assert max(speeds) == pytest.approx(0.4, rel=2e-3) and np.median(speeds) == pytest.approx(0.4, rel=1e-4)
    for t in (0.0, made.motion.duration, 1e6):
        np.testing.assert_allclose(made.at(t, 0.0)["velocity"], 0.0, atol=1e-12)
        np.testing.assert_allclose(made.at(t, 0.0)["acceleration"], 0.0, atol=1e-12)
    np.testing.assert_allclose(made.at(1e6, 0.0)["position"], wave()[0][-1], atol=1e-12)


def test_a_spline_through_a_circle_has_its_length_and_its_curvature():
    angles = np.linspace(0.0, 2 * np.pi, 81)
    made = reference.Reference(2.0 * np.stack([np.cos(angles), np.sin(angles)], 1))
    assert made.end == pytest.approx(4 * np.pi, rel=1e-5)
    assert made.drive(1.0, 0.4, 0.0, 0.0, 0.4, 0.3, 1.0, 0.5) == 1.0
    turning = made.at(made.motion.duration / 2, 0.0)
    assert turning["heading_rate"] == pytest.approx(0.4 / 2.0, rel=1e-3)


def test_a_path_is_driven_slower_where_its_bends_want_it():
    made = reference.Reference(wave()[0])
    crest = 0.5 * 1.5**2  # 1/m, curvature of y = 0.5 sin(1.5 x) there
    assert made.drive(0.0, 0.0, 0.0, 0.0, 0.4, 0.3, 1.0, 1.5) == 1.0
    assert made.drive(0.0, 0.0, 0.0, 0.0, 0.4, 0.3, 1.0, 0.2) == pytest.approx(0.2 / crest / 0.4, rel=0.01)
    assert made.drive(0.0, 0.0, 0.0, 0.0, 0.4, 0.3, 0.1, 1.5) == pytest.approx(0.25, rel=0.01)  # by max_speed


@pytest.mark.parametrize("end, rate", [(5.0, 0.0), (0.3, 0.0), (5.0, 0.8), (0.2, 0.5), (0.01, 0.5)])
def test_a_motion_ends_at_rest_at_its_end_within_its_rates(end, rate):
    motion = reference.Motion(0.0, end, rate, 0.4, 0.3)
    times = np.linspace(0.0, motion.duration, 20001)
    u, du, ddu = np.array([motion(t) for t in times]).T
    assert u[0] == 0.0 and u[-1] == pytest.approx(end) and du[0] == rate and du[-1] == pytest.approx(0.0, abs=1e-9)
    assert np.all(np.diff(u) >= -1e-15) and du.max() <= max(0.4, rate) + 1e-12
    assert np.abs(ddu).max() <= max(0.3, 0.75 * rate**2 / end) * 1.0001  # the braking that 0.75 v^2 / length needs
    np.testing.assert_allclose(np.gradient(u, times)[1:-1], du[1:-1], atol=1e-6 + np.abs(ddu).max() * times[1])


def test_of_a_path_that_crosses_itself_the_earlier_branch_is_joined():
    angles = np.linspace(0.0, 2 * np.pi, 101)
    eight = reference.Reference(np.stack([np.sin(2 * angles), np.sin(angles)], 1))
    assert eight.nearest(np.array([0.02, 0.0]), 0.0, 1.0) < 0.1
    assert abs(eight.nearest(np.array([0.02, 0.0]), 0.35 * eight.end, 1.0) - eight.end / 2) < 0.1
