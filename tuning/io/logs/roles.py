"""What the streams of a recording can serve as: the pose of the vehicle, its speed, what it was told."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import NamedTuple

import numpy as np

from ..headings import of_quaternions
from .recording import Recording, Stream

ROLE_NAMES = ("pose", "command", "speed", "yaw_rate", "steering")
STEERED = ("speed_cmd", "steering_angle_cmd")
Values = dict[str, np.ndarray]  # by our names, (N,), SI units


class Role(NamedTuple):
    """What a kind of message tells."""

    name: str  # of the role: a stream has it once, and a drive takes each from one stream
    tells: tuple[str, ...]  # our names
    values: Callable[[Mapping[str, np.ndarray]], Values]  # of a stream's fields
    held: bool = False  # a command, which holds until the next one


def _picked(**fields: str) -> Callable[[Mapping[str, np.ndarray]], Values]:
    return lambda given: {name: given[field] for name, field in fields.items()}


def _pose(prefix: str, translation: str = "position", rotation: str = "orientation") -> Role:
    def values(given: Mapping[str, np.ndarray]) -> Values:
        turned = np.column_stack([given[f"{prefix}{rotation}.{part}"] for part in "xyzw"])
        place = {name: given[f"{prefix}{translation}.{name}"] for name in "xy"}
        return place | {"heading": of_quaternions(turned)}

    return Role("pose", ("x", "y", "heading"), values)


def _twist(prefix: str) -> Role:
    fields = {"cmd_v": f"{prefix}linear.x", "cmd_w": f"{prefix}angular.z"}
    return Role("command", ("cmd_v", "cmd_w"), _picked(**fields), held=True)


def _moving(prefix: str) -> Role:
    fields = {"speed": f"{prefix}linear.x", "yaw_rate": f"{prefix}angular.z"}
    return Role("speed", ("speed", "yaw_rate"), _picked(**fields))


def _ackermann(prefix: str = "") -> Role:
    fields = {"speed_cmd": f"{prefix}speed", "steering_angle_cmd": f"{prefix}steering_angle"}
    return Role("command", STEERED, _picked(**fields), held=True)


def _ned(given: Mapping[str, np.ndarray]) -> Values:
    """Of PX4, north, east and down, turned clockwise from north: x to the east, y to the north, counterclockwise."""
    values = {"x": given["y"], "y": given["x"], "heading": np.pi / 2 - given["heading"]}
    return values | {"vx": given["vy"], "vy": given["vx"]}


TABLE = "table"  # a stream of columns of names of their own, our names among them
ROLES: dict[str, tuple[Role, ...]] = {
    "geometry_msgs/msg/Twist": (_twist(""),),
    "geometry_msgs/msg/TwistStamped": (_twist("twist."),),
    "geometry_msgs/msg/TwistWithCovarianceStamped": (_moving("twist.twist."),),
    "nav_msgs/msg/Odometry": (_pose("pose.pose."), _moving("twist.twist.")),
    "geometry_msgs/msg/PoseStamped": (_pose("pose."),),
    "geometry_msgs/msg/PoseWithCovarianceStamped": (_pose("pose.pose."),),
    "tf2_msgs/msg/TFMessage": (_pose("transform.", "translation", "rotation"),),
    "sensor_msgs/msg/Imu": (Role("yaw_rate", ("yaw_rate",), _picked(yaw_rate="angular_velocity.z")),),
    "ackermann_msgs/msg/AckermannDrive": (_ackermann(),),
    "ackermann_msgs/msg/AckermannDriveStamped": (_ackermann("drive."),),
    "autoware_control_msgs/msg/Control": (
        Role(
            "command",
            STEERED,
            _picked(speed_cmd="longitudinal.velocity", steering_angle_cmd="lateral.steering_tire_angle"),
            held=True,
        ),
    ),
    "autoware_vehicle_msgs/msg/VelocityReport": (
        Role("speed", ("speed", "yaw_rate"), _picked(speed="longitudinal_velocity", yaw_rate="heading_rate")),
    ),
    "autoware_vehicle_msgs/msg/SteeringReport": (
        Role("steering", ("steering_angle",), _picked(steering_angle="steering_tire_angle")),
    ),
    TABLE: (
        Role("pose", ("x", "y", "heading"), _picked(x="x", y="y", heading="heading")),
        Role("speed", ("speed", "yaw_rate"), _picked(speed="speed", yaw_rate="yaw_rate")),
        Role("command", ("cmd_v", "cmd_w"), _picked(cmd_v="cmd_v", cmd_w="cmd_w"), held=True),
        Role("command", STEERED, _picked(**dict(zip(STEERED, STEERED, strict=True))), held=True),
    ),
    "vehicle_local_position": (Role("pose", ("x", "y", "heading", "vx", "vy"), _ned),),
}


def kind_of(fields: Mapping[str, np.ndarray]) -> str:
    """The type of the messages that tell most of those whose fields are called so; empty where none is.

    Names without a dot could mean anything, and are passed over.
    """
    dotted = {name: values[:0] for name, values in fields.items() if "." in name}
    told = {kind: _told(dotted, roles) for kind, roles in ROLES.items()}
    best = max(told, key=lambda kind: told[kind])
    return best if told[best] else ""


def _told(fields: Mapping[str, np.ndarray], roles: Collection[Role]) -> int:
    """How many numbers some roles tell of fields; none where one of them lacks a field."""
    try:
        return sum(len(role.values(fields)) for role in roles)
    except KeyError:
        return 0


def roles_of(stream: Stream) -> list[Role]:
    """What a stream can serve as; nothing where a field that this takes is missing."""
    fine = []
    for role in ROLES.get(stream.kind, ()):
        try:
            role.values({name: values[:0] for name, values in stream.fields.items()})
        except KeyError:
            continue
        fine.append(role)
    return fine


def chosen(
    recording: Recording,
    asked: Mapping[str, str],
    elsewhere: Collection[str] = (),
    doubts: list[str] | None = None,
) -> dict[str, tuple[Stream, Role]]:
    """By role the stream that serves as it.

    Args:
        recording: the streams.
        asked: by role a topic, where several could serve; "" for none.
        elsewhere: our names that are told by something else: a role that tells nothing but these is not looked for.
        doubts: told of roles that several could serve as and none is named for; the most telling kind is taken then.

    Raises:
        ValueError: a topic that is not there or cannot serve so; without `doubts` several that could, none named.
    """
    can: dict[str, list[tuple[Stream, Role]]] = {}
    for stream in recording.streams:
        for role in roles_of(stream) if stream.size > 1 else ():
            if not set(role.tells) <= set(elsewhere):
                can.setdefault(role.name, []).append((stream, role))
    if wrong := [name for name in asked if name not in can and asked[name]]:
        rule = f"one of {', '.join(can)}" if can else "left out: no topic of it can serve as anything"
        raise ValueError(f"--topics {wrong[0]}: must be {rule}")
    found = {}
    for name, pairs in can.items():
        topics = [stream.topic for stream, _ in pairs]
        if name in asked:
            if asked[name] and asked[name] not in topics:
                raise ValueError(f"--topics {name}={asked[name]}: must be one of {', '.join(topics)}")
            found.update((name, pair) for pair in pairs if pair[0].topic == asked[name])
        elif len(pairs) == 1:
            found[name] = pairs[0]
        elif name in ("pose", "command"):
            found[name], words = _likeliest(name, pairs)
            if doubts is None:
                raise ValueError(words)
            doubts.append(words)
    return found


def _likeliest(name: str, pairs: list[tuple[Stream, Role]]) -> tuple[tuple[Stream, Role], str]:
    """Of streams that can serve as a role one of the kind that says most about it, and what is said of them all."""
    pairs = sorted(pairs, key=lambda pair: [*ROLES].index(pair[0].kind))
    listed = ", ".join(_described(stream) for stream, _ in pairs)
    rule = f"name one with --topics {name}={pairs[0][0].topic}"
    return pairs[0], f"{len(pairs)} topics can be the {name}: {listed}; {rule}"


def _described(stream: Stream) -> str:
    return f"{stream.topic} ({stream.kind.rpartition('/')[2]}, {stream.size} messages)"


def missing(found: Mapping[str, tuple[Stream, Role]]) -> list[str]:
    """What a fit needs and the recording lacks, a sentence each."""
    words = []
    if "pose" not in found:
        words.append("no pose: nothing says where the vehicle was and where it looked (Odometry, PoseStamped, tf)")
    if "command" not in found:
        words.append("no command: nothing says what the vehicle was told (Twist, TwistStamped, AckermannDrive)")
    return words
