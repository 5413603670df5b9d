"""Tracks from recordings: the plan that a robot followed, as Nav2 publishes it, or the way that it drove."""

import numpy as np
import pytest

import agvjax
from tuning.config import load

START = 1_700_000_000_000_000_000  # ns
CORNERS = np.array([[0, 0], [4, 0], [4, 3], [0, 3]], float)


def messages():
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    return store, {name.rpartition("/")[2]: kind for name, kind in store.types.items()}


def posed(t, stamp, x, y):
    header = t["Header"](t["Time"](stamp // 10**9, stamp % 10**9), "map")
    return t["PoseStamped"](header, t["Pose"](t["Point"](float(x), float(y), 0.0), t["Quaternion"](0.0, 0.0, 0.0, 1.0)))


def bag(folder, plans=(), drives=()):
    """A bag of ROS 2: plans are (topic, points), drives (topic, points) at 10 Hz."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    store, t = messages()
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        known = {}
        for topic, points in plans:
            if topic not in known:
                known[topic] = writer.add_connection(topic, "nav_msgs/msg/Path", typestore=store)
            path = t["Path"](t["Header"](t["Time"](0, 0), "map"), [posed(t, START, x, y) for x, y in points])
            writer.write(known[topic], START, store.serialize_cdr(path, "nav_msgs/msg/Path"))
        for topic, points in drives:
            one = writer.add_connection(topic, "geometry_msgs/msg/PoseStamped", typestore=store)
            for k, (x, y) in enumerate(points):
                stamp = START + 100_000_000 * k
                writer.write(one, stamp, store.serialize_cdr(posed(t, stamp, x, y), "geometry_msgs/msg/PoseStamped"))
    return str(folder)


def loaded(tmp_path, file, topic=None):
    named, said = f'topic = "{topic}"\n' if topic else "", []
    (tmp_path / "c.toml").write_text(f'[scenario.path]\ntype = "route"\nfile = "{file}"\nradius = 0.5\n{named}')
    return load(["base", str(tmp_path / "c.toml")], [], note=said.append).scenario.path, said


def test_the_longest_of_the_plans_of_a_topic_is_the_track(tmp_path):
    plans = [("/plan", CORNERS), ("/plan", CORNERS[1:]), ("/plan", CORNERS[3:])]
    path, said = loaded(tmp_path, bag(tmp_path / "bag", plans, [("/amcl", CORNERS)]))
    assert isinstance(path, agvjax.Route)
    np.testing.assert_allclose(float(path.length), 4 + 3 + 4 - 2 * (1 - np.pi / 4), atol=1e-6)  # two corners of .5 m
    assert any("the longest of 3 paths of /plan" in text for text in said)


def test_of_several_topics_one_is_named(tmp_path):
    file = bag(tmp_path / "bag", [("/plan", CORNERS), ("/plan_smoothed", CORNERS[:3])], [("/amcl", CORNERS)])
    with pytest.raises(agvjax.InputError, match=r"several topics have a path: /plan, /plan_smoothed; .*path\.topic"):
        loaded(tmp_path, file)
    path, _ = loaded(tmp_path, file, topic="/plan_smoothed")
    np.testing.assert_allclose(float(path.length), 4 + 3 - (1 - np.pi / 4), atol=1e-6)
    with pytest.raises(agvjax.InputError, match=r"/other has no path and no pose; those that have: /plan, .*/amcl"):
        loaded(tmp_path, file, topic="/other")


def test_a_drive_is_a_track_with_the_speed_it_was_driven_at(tmp_path):
    along = np.column_stack([0.05 * np.arange(200), np.zeros(200)])  # 0.5 m/s
    file = bag(tmp_path / "bag", drives=[("/amcl", along)])
    (tmp_path / "c.toml").write_text(f'[scenario.path]\ntype = "waypoints"\nfile = "{file}"\nclosed = false\n')
    said = []
    path = load(["unicycle", str(tmp_path / "c.toml")], [], note=said.append).scenario.path
    points = np.asarray(path.points)
    np.testing.assert_allclose(points[:, 2], 0.5, rtol=1e-6)
    assert any("the way of /amcl" in text for text in said)


def test_a_topic_is_of_a_recording_alone(tmp_path):
    (tmp_path / "track.csv").write_text("x,y\n0,0\n1,0\n2,1\n3,3\n")
    with pytest.raises(agvjax.InputError, match=r"topic.*absent where the file is no recording"):
        loaded(tmp_path, str(tmp_path / "track.csv"), topic="/plan")
    with pytest.raises(agvjax.InputError, match="no topic of it has a path or a pose"):
        store, t = messages()
        from rosbags.rosbag2 import StoragePlugin, Writer

        with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            one = writer.add_connection("/cmd_vel", "geometry_msgs/msg/Twist", typestore=store)
            zero = t["Vector3"](0.0, 0.0, 0.0)
            writer.write(one, START, store.serialize_cdr(t["Twist"](zero, zero), "geometry_msgs/msg/Twist"))
        loaded(tmp_path, str(tmp_path / "bag"))
