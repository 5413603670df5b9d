"""As much of ROS 2 as the exported packages use, and a simple robot that does what it is told."""

import math
import sys
import types
from types import SimpleNamespace as Space

import numpy as np


class Parameter:
    """Of rclpy: a name and a value."""

    def __init__(self, name, value):
        self.name, self.value = name, value


class Refused(Exception):
    """What rclpy raises when a value given at launch is not accepted."""


class Node:
    """As much of rclpy.node.Node as the package uses, its rules for setting parameters those of rclpy 8."""

    launched: dict = {}  # parameters given at launch
    now = 100.0  # s, of every clock

    def __init__(self, name):
        self.name, self.held, self.descriptors, self.callbacks = name, {}, {}, []
        self.topics, self.sent, self.period, self.said, self.published = {}, [], None, [], None
        self.services = {}

    def add_on_set_parameters_callback(self, callback):
        self.callbacks.append(callback)

    def declare_parameter(self, name, value, descriptor):
        value, expected = self.launched.get(name, value), type(value)
        if type(value) is not expected:
            raise Refused(f"{name}: wrong type")
        self.descriptors[name] = descriptor
        if reason := self._reason([Parameter(name, value)]):
            raise Refused(reason)
        self.held[name] = value

    def _reason(self, changes):
        results = [callback(changes) for callback in self.callbacks]
        return "; ".join(r.reason for r in results if not r.successful)

    def set_parameter(self, name, value):
        """One parameter, as `ros2 param set` does; the reason why not, or nothing."""
        if self.descriptors[name].read_only:
            return f"Trying to set a read-only parameter: {name}."
        if type(value) is not type(self.held[name]):
            return "Wrong parameter type"
        reason = self._reason([Parameter(name, value)])
        if not reason:
            self.held[name] = value
        return reason

    def get_parameter(self, name):
        return Parameter(name, self.held[name])

    def create_publisher(self, kind, topic, qos):
        self.published = kind
        return Space(publish=lambda message: self.sent.append((topic, message)))

    def create_subscription(self, kind, topic, callback, qos):
        self.topics[topic] = callback

    def create_service(self, kind, name, callback):
        self.services[name] = callback

    def create_timer(self, period, callback):
        self.period = period

    def get_clock(self):
        return Space(now=lambda: Space(nanoseconds=round(Node.now * 1e9), to_msg=lambda: stamp(Node.now)))

    def get_logger(self):
        def say(level):
            return lambda text, throttle_duration_sec=0.0: self.said.append((level, text))

        return Space(**{level: say(level) for level in ("info", "warning", "error")})


def stamp(time):
    return Space(sec=int(time), nanosec=round(time % 1 * 1e9))


def twist():
    return Space(linear=Space(x=0.0), angular=Space(z=0.0))


def twist_stamped():
    return Space(header=Space(stamp=None, frame_id=""), twist=twist())


def pose(x, y, heading=0.0, time=0.0, frame=""):
    turn = Space(x=0.0, y=0.0, z=math.sin(heading / 2), w=math.cos(heading / 2))
    place = Space(position=Space(x=x, y=y, z=0.0), orientation=turn)
    return Space(header=Space(frame_id=frame, stamp=stamp(time)), pose=place)


def path(points, times=None, frame="odom"):
    times = np.zeros(len(points)) if times is None else times
    poses = [pose(x, y, time=t) for (x, y), t in zip(points, times, strict=True)]
    return Space(header=Space(frame_id=frame), poses=poses)


def install(monkeypatch):
    """The stub in place of what is not installed."""
    parts = {
        "rclpy": {"init": None, "spin": None, "ok": None, "shutdown": None},
        "rclpy.node": {"Node": Node},
        "rclpy.executors": {"ExternalShutdownException": type("ExternalShutdownException", (Exception,), {})},
        "rclpy.qos": {"QoSProfile": Space, "qos_profile_sensor_data": None},
        "rclpy.signals": {"SignalHandlerOptions": Space(NO=0)},
        "nav_msgs": {},
        "nav_msgs.msg": {"Odometry": Space, "Path": Space},
        "geometry_msgs": {},
        "geometry_msgs.msg": {"Twist": twist, "TwistStamped": twist_stamped},
        "std_srvs": {},
        "std_srvs.srv": {"SetBool": Space},
        "rcl_interfaces": {},
        "rcl_interfaces.msg": {"ParameterDescriptor": Space, "SetParametersResult": Space},
    }
    for name, content in parts.items():
        module = types.ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(Node, "launched", {})
    monkeypatch.setattr(Node, "now", 100.0)


class Robot:
    """Rolls without slip; its speed loop follows cmd_vel with a lag [s]. Odometry is of the axle."""

    def __init__(self, node, path=None, x=0.0, y=0.0, heading=0.0, lag=0.03, L=0.15):
        self.node, self.state, self.lag, self.L = node, np.array([x, y, heading, 0.0, 0.0]), lag, L
        self.points, self.commands, self.take = [], [], node.topics.get("path")
        if path is not None:
            self.take(path)

    def rate(self, state, command):
        _, _, heading, v, w = state
        return np.array([v * math.cos(heading), v * math.sin(heading), w, *((command - state[3:]) / self.lag)])

    def report(self, frame="odom"):
        x, y, heading, v, w = self.state
        moves = Space(twist=Space(linear=Space(x=v), angular=Space(z=w)))
        place = pose(x, y, heading, Node.now, frame)
        self.node.topics["odom"](Space(header=place.header, pose=Space(pose=place.pose), twist=moves))

    def drive(self, seconds, sees=True, free=True):
        """Periods of the node, each followed by what the robot does in it."""
        for _ in range(round(seconds / self.node.period)):
            if sees:
                self.report()
            self.node.on_timer()
            topic, message = self.node.sent[-1]
            assert topic == "cmd_vel"
            message = message.twist if self.node.published is twist_stamped else message
            command = np.array([message.linear.x, message.angular.z])
            for _ in range(3 * free):
                h = self.node.period / 3
                middle = self.state + h / 2 * self.rate(self.state, command)
                self.state = self.state + h * self.rate(middle, command)
            self.commands.append(command)
            self.points.append(self.state[:2] + self.L * np.array([math.cos(self.state[2]), math.sin(self.state[2])]))
            Node.now += self.node.period

    @property
    def speeds(self):
        """Of the commands, in m/s."""
        return np.array(self.commands)[:, 0]


def said(node, level):
    return [text for one, text in node.said if one == level]
