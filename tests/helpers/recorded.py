"""Drives as robots record them."""

import numpy as np

START = 1_700_000_000_000_000_000  # ns
JITTER = 0.012  # s


def write(folder, storage, told, measured):
    """A bag of ROS 2: Odometry at 50 Hz stamped when it was true, Twist at 20 Hz without a stamp; both come late.

    told (N, 2): speed and yaw rate for every ms; measured (N / 20, 5): x, y, heading, speed, yaw rate.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store, random = get_typestore(Stores.ROS2_HUMBLE), np.random.default_rng(2)
    t = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}
    twist = lambda v, w: t["Twist"](t["Vector3"](v, 0.0, 0.0), t["Vector3"](0.0, 0.0, w))  # noqa: E731
    sent = []
    for k, (x, y, turned, v, w) in enumerate(measured):
        stamp = START + 20_000_000 * k
        header = t["Header"](t["Time"](stamp // 10**9, stamp % 10**9), "odom")
        place = t["Pose"](t["Point"](x, y, 0.0), t["Quaternion"](0.0, 0.0, np.sin(turned / 2), np.cos(turned / 2)))
        parts = t["PoseWithCovariance"](place, np.zeros(36)), t["TwistWithCovariance"](twist(v, w), np.zeros(36))
        sent.append((stamp, "/odom", t["Odometry"](header, "base_link", *parts)))
    for i in range(0, len(told), 50):
        if not 40_000 <= i < 41_000:  # a second is lost
            sent.append((START + 1_000_000 * i, "/cmd_vel", twist(*told[i])))
    come = sorted(((at + int(random.uniform(0, JITTER * 1e9)), topic, m) for at, topic, m in sent), key=lambda x: x[0])
    with Writer(folder, version=9, storage_plugin=StoragePlugin[storage]) as writer:
        kinds = {"/odom": "nav_msgs/msg/Odometry", "/cmd_vel": "geometry_msgs/msg/Twist"}
        topics = {name: writer.add_connection(name, kind, typestore=store) for name, kind in kinds.items()}
        for at, topic, message in come:
            writer.write(topics[topic], at, store.serialize_cdr(message, topics[topic].msgtype))
