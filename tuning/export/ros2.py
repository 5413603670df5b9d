"""A ROS 2 package (ament_python): a node that drives along a path by the exported law, with its parameters' bounds."""

from __future__ import annotations

import json
import math

import agvjax
from agvjax import leaves

from ..io.files import Json
from . import numpy as numpy_file
from . import parameters, ros2_parts
from .artefact import Artefact, filled, version
from .ros2_node.vehicles import ON_PATHS, ON_ROUTES

TEXTS = {
    "frame": "Frame of odometry and path; messages in another are refused",
    "use_stamps": "Whether stamps of poses that increase say how fast the path is driven",
    "stamped": "Whether cmd_vel is a geometry_msgs/TwistStamped, not a geometry_msgs/Twist",
    "base_frame": "Frame that a stamped cmd_vel names",
    "route_file": "File of the route, a route.json of `agvjax export`; empty: the one in the package",
    "steered_behind": "Whether the steered wheel is behind the fixed axle, as the law was tuned for",
}
NAME = "agv_path_follower"
INTEGRATED = """The law asks for {}, a robot takes velocities:
`cmd_vel` is the integral of what the law asks for, begun at the measured velocity and never further from it than
`max_speed_lead` and `max_yaw_rate_lead`, so that it does not run away from a robot that is held. The robot's own speed
loop is best several times faster than the law."""
CONVERSIONS = {
    "acceleration, yaw_acceleration": INTEGRATED.format("accelerations"),
    "torque_left, torque_right": INTEGRATED.format(
        "torques of the wheels, which mass and inertia in `controller.vehicle` make accelerations"
    ),
    "wheel_speed_left, wheel_speed_right": """The law asks for speeds of the wheels; `cmd_vel` is the velocity they
amount to by `wheel_radius` and `track` of `controller.vehicle`. They are those that a speed loop with
`controller.vehicle.drive.gain` needs: if that of your robot is another, tune again.""",
    "acceleration, steering_rate": """The law asks for an acceleration and a steering rate. A Twist carries neither:
`linear.x` is the integrated speed of the rear axle and `angular.z` the yaw rate v tan(delta) / L of the integrated
steering angle; no Ackermann message is published, and what converts the Twist back must know the same wheelbase.
Odometry does not tell the steering angle: the law is given the commanded one, at the start the one that rolls without
slip.""",
    "speed, yaw_rate": "The law asks for the velocity that `cmd_vel` carries.",
    "left, right": """The law asks for the speeds of the wheels' rims; `cmd_vel` is the velocity they amount to by
`track` of `controller.vehicle`. A velocity beyond the limits of the node is reduced so that the curve stays.""",
    "speed, steering_angle": """The law asks for a speed and a steering angle; `cmd_vel` is the velocity they amount
to by `wheelbase` of `controller.vehicle`, a yaw rate v tan(angle) / wheelbase, the other way where `steered_behind`. No
Ackermann message is published.""",
}


BASE = """
The base turns `cmd_vel` into its own actuators by numbers of its own: {}. By default they are those of
`controller.vehicle`, by which the law's commands become a velocity. Set them to what the base is configured with where
that is another: a skid-steered base whose identified track is wider than the one in its driver turns too little
otherwise, by their ratio. The limits of the node are of the vehicle's own motion, what `cmd_vel` says may be more.
"""


def files(artefact: Artefact, name: str = NAME) -> dict[str, str]:
    """The package by relative paths: node, law, parameters with bounds, launch file, README.

    `name` is that of package and node.

    Raises:
        agvjax.InputError: the name is none of a package, or the vehicle takes no velocity.
    """
    known = ON_PATHS if artefact.route is None else ON_ROUTES
    inputs, specification = parameters.inputs(artefact, name, known), tables(artefact)
    values = {key: table["default_value"] for key, table in specification.items()}
    base = parameters.vehicle_kind(artefact).base
    origin = {key: fact for key, fact in artefact.provenance.items() if key != "gains"}
    substitutes = {
        **ros2_parts.words(artefact, name),
        "NAME": name,
        "VERSION": version(artefact),
        "PERIOD": f"{float(artefact.controller.period):g}",
        "BASE": BASE.format(", ".join(f"`{key}`" for key in base)) if base else "",
        "CONVERSION": CONVERSIONS[", ".join(inputs)],
        "PROVENANCE": "\n    ".join(json.dumps(origin, indent=2).splitlines()),
    }
    templates = {"launch.py": f"launch/{name}.launch.py", "node.py": f"{name}/node.py"}  # those that move
    templates = {file: file for file in ("package.xml", "setup.py", "setup.cfg", "README.md")} | templates
    texts = {path: filled(ros2_parts.TEMPLATES / f"{file}.txt", substitutes) for file, path in templates.items()}
    return (
        texts
        | ros2_parts.files(artefact, name)
        | {
            f"resource/{name}": "",
            f"{name}/__init__.py": f'"""Drives along a path by a control law: {artefact.provenance["generator"]}."""\n',
            f"{name}/controller.py": numpy_file.module(artefact, ros2_parts.DATA),
            f"{name}/parameters.yaml": parameters.dumped({name: parameters.nested(specification)}),
            "config/params.yaml": parameters.dumped({"/**": {"ros__parameters": parameters.nested(values)}}),
        }
    )


def tables(artefact: Artefact) -> dict[str, Json]:
    """Every parameter of the node by its dotted name, as generate_parameter_library states one."""
    return _node(artefact) | parameters.of_law(artefact)


def _node(artefact: Artefact) -> dict[str, Json]:
    """Parameters of the node; the defaults know nothing of the robot."""
    named = {
        "frame": parameters.table("odom", TEXTS["frame"], {"not_empty<>": []}, read_only=True),
        "stamped": parameters.table(False, TEXTS["stamped"], {}, read_only=True),
        "base_frame": parameters.table("base_link", TEXTS["base_frame"], {}, read_only=True),
    }
    late = max(0.2, 3 * float(artefact.controller.period))
    about = "Age of the newest odometry from which on the vehicle is stopped"
    if artefact.route is None:
        named["use_stamps"] = parameters.table(True, TEXTS["use_stamps"], {}, read_only=False)
        rows = _on_path(artefact)
    else:
        named["route_file"] = parameters.table("", TEXTS["route_file"], {}, read_only=True)
        if isinstance(artefact.controller.vehicle, agvjax.Ackermann):
            behind = artefact.controller.vehicle.behind
            named["steered_behind"] = parameters.table(behind, TEXTS["steered_behind"], {}, read_only=True)
        rows = ros2_parts.limits(artefact)
    rows |= {"timeout": (late, "s", "gt", about)}
    return parameters.of_base(artefact) | named | parameters.numbers(rows)


def _on_path(artefact: Artefact) -> Json:
    """Default, unit, what must hold and text of the numbers of a node along a path, modest for a vehicle's size."""
    law, tuned = artefact.controller, artefact.provenance["speed"]["value"]
    slow, ramp, turn = 0.2, 0.3, 1.5  # m/s, on which the other speeds are measured; m/s^2; rad/s
    if "steering_rate" in artefact.provenance["inputs"]:
        vehicle = leaves(law.vehicle)
        slow = ramp = float(vehicle["slowest"])
        turn = 2 * slow * math.tan(float(vehicle["limits.steering_angle"])) / float(law.vehicle.lever() or 0.0)
    return {
        "speed": (tuned or 2 * slow, "m/s", "gt", "Speed along a path without stamps"),
        "acceleration": (ramp, "m/s^2", "gt", "Peak acceleration of the ramps from rest and to rest"),
        "spacing": (slow / 2, "m", "gt_eq", "Poses nearer than this to the one before are left out"),
        "max_speed": (max(6 * slow, 1.5 * (tuned or 0.0)), "m/s", "gt", "Largest speed commanded"),
        "max_reverse_speed": (slow / 2, "m/s", "gt_eq", "Largest speed backwards commanded, 0 for none"),
        "max_yaw_rate": (round(turn, 2), "rad/s", "gt", "Largest yaw rate commanded, and planned along bends"),
        "max_speed_lead": (1.5 * slow, "m/s", "gt", "How far a commanded speed may be from the measured one"),
        "max_yaw_rate_lead": (1.0, "rad/s", "gt", "How far a commanded yaw rate may be from the measured one"),
        "max_error": (5 * slow, "m", "gt", "Distance from the reference at which the path is given up"),
        "goal_tolerance": (slow / 10, "m", "gt", "Distance from the end at which the path is finished"),
        "settling_time": (2.0, "s", "gt_eq", "Time after the end of the path at which it is finished anyway"),
    }
