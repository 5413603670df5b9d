"""The exported package of a law that follows a route, driven in closed loop against the stub of ROS."""

import importlib
import json
import sys
from types import SimpleNamespace as Space
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

import agvjax
from ros_stub import Node, Robot, install, said
from tuning.config.write import gains_table
from tuning.export import artefact, ros2
from tuning.export.ros2_node import vehicles

# The node is that of test_export_ros2.py, and the law drives such routes in test_export_route.py.
pytestmark = pytest.mark.slow

END = (3.6, -2.5)
CONFIG = """
[scenario]
plant = "base"
disturbance = "none"
[scenario.path]
type = "route"
points = [[0.0, 0.0, 0.6], [1.0, 0.0, 0.6], [2.0, 0.0, 0.6], [3.0, 0.15, 0.6], [4.0, 0.8, 0.6], [5.0, 2.0, -0.4],
    [4.3, 1.0, -0.4], [3.9, 0.3, -0.4], [3.7, -0.5, -0.4], [3.6, -1.5, -0.4], [3.6, -2.5, -0.4]]
limits = { acceleration = 0.4, deceleration = 0.3 }
"""
LAW = agvjax.Sampled(inner=agvjax.PathPID(ahead=0.1), vehicle=agvjax.Base(track=0.5), period=0.05)


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    folder = tmp_path_factory.mktemp("package")
    (folder / "config.toml").write_text(CONFIG)
    (folder / "gains.toml").write_text(gains_table(LAW))
    files = ros2.files(artefact.read(str(folder / "gains.toml")), "drives_base")
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    yield folder, files
    for name in [name for name in sys.modules if name.startswith("drives_base")]:
        del sys.modules[name]


@pytest.fixture
def start(package, monkeypatch):
    install(monkeypatch)

    def robot(x=0.0, y=0.1, heading=0.2, **launched):
        monkeypatch.syspath_prepend(str(package[0]))
        sys.modules.pop("drives_base.node", None)  # it was imported against the stub of another test
        monkeypatch.setattr(Node, "launched", launched)
        node = importlib.import_module("drives_base.node").FollowerNode()
        return Robot(node, x=x, y=y, heading=heading, L=0.0)

    return robot


def order(robot, drive):
    """What the service answers."""
    return robot.node.services["~/drive"](Space(data=drive), Space(success=None, message=None))


def test_it_moves_only_once_told_to_drives_both_legs_and_stands_at_the_end(start):
    robot = start()
    robot.drive(1.0)
    assert not np.any(robot.commands) and robot.node.said == []
    assert order(robot, True).success and order(robot, True).message == "it drives already"
    robot.drive(40.0)
    assert said(robot.node, "error") == []
    assert [text.split(",")[0] for text in said(robot.node, "info")][0].startswith("route begun at 0.0")
    assert "route finished" in said(robot.node, "info")[1] and "0 of" in said(robot.node, "info")[1]
    assert np.linalg.norm(robot.points[-1] - np.array(END)) < 0.04
    assert robot.speeds.max() > 0.4 and robot.speeds.min() < -0.3  # forwards, then backwards
    assert np.all(np.array(robot.commands)[-20:] == 0.0)


def test_it_stands_without_fresh_odometry_and_goes_on_where_it_was(start):
    """On the second leg, of which a search of the whole route would know nothing."""
    robot = start()
    order(robot, True)
    while not robot.commands or robot.commands[-1][0] > -0.3:
        robot.drive(0.05)
    before = len(robot.commands)
    robot.drive(1.0, sees=False)
    assert np.all(np.array(robot.commands)[before + 6 :] == 0.0)  # the timeout is 0.2 s, four periods
    assert "no odometry newer than 0.2 s" in said(robot.node, "error")[0]
    robot.drive(30.0)
    assert np.linalg.norm(robot.points[-1] - np.array(END)) < 0.04
    assert len([text for text in said(robot.node, "info") if "begun" in text]) == 1


def test_an_order_to_stop_is_one_and_the_next_begins_anew(start):
    robot = start()
    order(robot, True)
    robot.drive(3.0)
    assert robot.commands[-1][0] > 0.3
    assert order(robot, False).success
    robot.drive(0.5)
    assert np.all(np.array(robot.commands)[-10:] == 0.0)
    order(robot, True)
    robot.drive(1.0)
    assert robot.commands[-1][0] > 0.2
    begun = [text for text in said(robot.node, "info") if "begun" in text]
    assert len(begun) == 2 and float(begun[1].split()[3]) == pytest.approx(robot.points[69][0], abs=0.05)


def test_a_route_out_of_reach_is_not_begun(start):
    robot = start(y=1.6)
    order(robot, True)
    robot.drive(0.5)
    assert not np.any(robot.commands)
    assert "route given up: 1.6" in said(robot.node, "error")[0] and "max_error is 1" in said(robot.node, "error")[0]


def test_limits_of_the_node_slow_it_on_the_same_curve(start):
    paths = []
    for most in (0.9, 0.25):
        robot = start(max_speed=most)
        order(robot, True)
        robot.drive(30.0)
        along = np.array(robot.points)
        assert robot.speeds.max() <= most
        paths.append(along[along[:, 0] < 3.9][:200])
    fine = paths[0]
    off = [np.linalg.norm(fine - point, axis=1).min() for point in paths[1][100:] if point[0] < fine[:, 0].max()]
    assert max(off) < 0.03


def test_a_file_that_is_no_route_keeps_the_node_from_starting(start, tmp_path):
    (tmp_path / "no.json").write_text("{}")
    for file in (tmp_path / "no.json", tmp_path / "none.json"):
        with pytest.raises(ValueError, match=r"route_file = .*json: must be a route\.json"):
            start(route_file=str(file))


def test_another_route_is_driven_from_a_file(start, package, tmp_path):
    data = json.loads(package[1]["drives_base/route.json"])
    data["coefficients"][6] = [y + 2.0 for y in data["coefficients"][6]]  # the same one, 2 m to the left
    (tmp_path / "route.json").write_text(json.dumps(data))
    robot = start(y=2.1, route_file=str(tmp_path / "route.json"))
    order(robot, True)
    robot.drive(40.0)
    assert np.linalg.norm(robot.points[-1] - np.array([END[0], END[1] + 2.0])) < 0.04


def test_the_package_has_the_route_and_what_it_needs(package):
    files = package[1]
    needs = [part.text for part in ElementTree.fromstring(files["package.xml"]).iter("exec_depend")]
    assert "std_srvs" in needs and '"route.json"' in files["setup.py"]
    assert all(
        "@" not in text.replace("maintainer@example.com", "") for name, text in files.items() if name[-3:] != ".py"
    )
    values = yaml.safe_load(files["config/params.yaml"])["/**"]["ros__parameters"]
    assert values["max_speed"] == pytest.approx(0.9, rel=1e-3) and values["max_reverse_speed"] == pytest.approx(
        0.6, rel=1e-3
    )
    assert values["max_yaw_rate"] == 1.5 and values["controller"]["vehicle"]["track"] == 0.5
    assert "drives_base/following.py" not in files and "std_srvs/srv/SetBool" in files["README.md"]


@pytest.mark.parametrize(("behind", "side"), [(False, 1.0), (True, -1.0)])
def test_a_steering_angle_is_the_yaw_rate_of_a_vehicle_that_rolls(behind, side):
    kind = vehicles.SteeringAngles({"wheelbase": 1.2, "behind": behind})
    speed, yaw_rate = kind.wanted({"speed": 0.6, "steering_angle": 0.3}, 0.05)
    assert speed == 0.6 and yaw_rate == pytest.approx(side * 0.6 * np.tan(0.3) / 1.2)
    assert kind.command(0.6, 0.1, {"base_wheelbase": 1.5}) == (0.6, pytest.approx(0.1 * 1.2 / 1.5))
    rims = vehicles.RimSpeeds({"track": 0.5})
    assert rims.wanted({"left": 0.5, "right": 0.7}, 0.05) == (pytest.approx(0.6), pytest.approx(0.4))


def test_a_vehicle_that_is_driven_by_accelerations_has_no_node_along_a_route():
    law = agvjax.Sampled(inner=agvjax.PathPID(), vehicle=agvjax.Unicycle())
    told = {"inputs": {name: "" for name in law.vehicle.actuators}, "gains": {}}
    line = agvjax.Route.through([[0, 0], [1, 0], [2, 0]], 0.5)
    with pytest.raises(agvjax.InputError, match="speed, yaw_rate; left, right; speed, steering_angle"):
        ros2.files(artefact.Artefact(law, told, line), "goes")
