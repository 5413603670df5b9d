"""A ROS 2 package (ament_python): a node that drives along a path by the exported law, with its parameters' bounds."""

from __future__ import annotations

import json
import math
import re

import numpy as np
import yaml
from jaxtyping import PyTree

import agvjax
from agvjax import leaves
from agvjax.schedule import extremes

from ..io.files import Json
from ..tune.meanings import of_gains
from . import names, ros2_parts
from . import numpy as numpy_file
from .artefact import Artefact, filled
from .ros2_node.vehicles import ON_PATHS, ON_ROUTES, VEHICLES, Accelerations

TEXTS = {
    "frame": "Frame of odometry and path; messages in another are refused",
    "use_stamps": "Whether stamps of poses that increase say how fast the path is driven",
    "stamped": "Whether cmd_vel is a geometry_msgs/TwistStamped, not a geometry_msgs/Twist",
    "base_frame": "Frame that a stamped cmd_vel names",
    "route_file": "File of the route, a route.json of `agvjax export`; empty: the one in the package",
    "steered_behind": "Whether the steered wheel is behind the fixed axle, as the law was tuned for",
}
PARTS = {"track": "track", "wheel_radius": "radius of the wheels", "L": "wheelbase", "wheelbase": "wheelbase"}
NAME = "agv_path_follower"
LEAST = 1e-12  # makes "> 0" of an array's elements: generate_parameter_library has only inclusive bounds for them
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


class Dumper(yaml.SafeDumper):
    """Lists in one line, nothing abbreviated: parsers of ROS know no aliases."""

    def ignore_aliases(self, data: PyTree) -> bool:
        """Every one."""
        return True


Dumper.add_representer(list, lambda dumper, x: dumper.represent_sequence("tag:yaml.org,2002:seq", x, flow_style=True))


def files(artefact: Artefact, name: str = NAME) -> dict[str, str]:
    """The package by relative paths: node, law, parameters with bounds, launch file, README.

    `name` is that of package and node.

    Raises:
        agvjax.InputError: the name is none of a package, or the vehicle takes no velocity.
    """
    inputs, specification = _inputs(artefact, name), parameters(artefact)
    values = {key: table["default_value"] for key, table in specification.items()}
    base = _kind(artefact).base
    origin = {key: fact for key, fact in artefact.provenance.items() if key != "gains"}
    substitutes = {
        **ros2_parts.words(artefact, name),
        "NAME": name,
        "VERSION": _version(artefact),
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
            f"{name}/parameters.yaml": _yaml({name: _nested(specification)}),
            "config/params.yaml": _yaml({"/**": {"ros__parameters": _nested(values)}}),
        }
    )


def _stable(poles: np.ndarray) -> bool:
    """No integrator steps the exported law: a sampled law's bounds are those of its period."""
    return True


def parameters(artefact: Artefact) -> dict[str, Json]:
    """Every parameter of the node by its dotted name, as generate_parameter_library states one."""
    highest = {name: float(x) for name, x in extremes(artefact.controller)[1].upper_bounds(_stable).items()}
    law = {f"controller.{name}": _gain(artefact, name, highest.get(name)) for name in artefact.provenance["gains"]}
    return _node(artefact) | law


def _inputs(artefact: Artefact, name: str) -> tuple[str, ...]:
    """The inputs of the vehicle, if a velocity can be made of them; `InputError` otherwise, or for a bad name."""
    faults, inputs = names.faults(name), tuple(artefact.provenance["inputs"])
    kind, known = type(artefact.controller.vehicle).__name__, ON_PATHS if artefact.route is None else ON_ROUTES
    if inputs not in [kind.inputs for kind in known]:
        rule = f"with inputs a velocity can be made of: {'; '.join(', '.join(kind.inputs) for kind in known)}"
        faults.append(agvjax.Fault("controller.vehicle", f"{kind} ({', '.join(inputs)})", rule))
    else:
        lacks = [part for part in VEHICLES[inputs].parts if f"vehicle.{part}" not in artefact.provenance["gains"]]
        rule = f"with the numbers {', '.join(VEHICLES[inputs].parts)}; it has no {', '.join(lacks)}"
        faults += [agvjax.Fault("controller.vehicle", kind, rule)] if lacks else []
    if faults:
        raise agvjax.InputError(faults)
    return inputs


def _gain(artefact: Artefact, name: str, highest: float | None) -> Json:
    """A leaf of the controller; period and vehicle must not change while it runs."""
    facts = artefact.provenance["gains"][name]
    value = facts["value"]
    if np.ndim(value) > 1:
        raise ValueError(f"{name} has shape {np.shape(value)}, and a parameter of ROS 2 is a number or a list of them")
    words = [of_gains(artefact.controller, [name])[name], f"unit {facts['unit'] or '1'}", facts["rule"]]
    title = f"{name} of {type(artefact.controller.inner).__name__}" if name.startswith("inner.") else name
    rule = {"bounds<>": [value, value]} if name == "period" else _validation(facts, value, highest)
    fixed = name == "period" or name.startswith("vehicle.")
    return _table(value, f"{title}: {', '.join(filter(None, words))}", rule, fixed)


def _table(default: PyTree, description: str, validation: dict[str, list[PyTree]], read_only: bool) -> Json:
    """A parameter as generate_parameter_library states it."""
    kind = {float: "double", list: "double_array", str: "string", bool: "bool"}[type(default)]
    table: Json = {"type": kind, "default_value": default, "description": description}
    return table | ({"read_only": True} if read_only else {}) | ({"validation": validation} if validation else {})


def _validation(facts: Json, value: PyTree, highest: float | None) -> dict[str, list[PyTree]]:
    """The rule beside a leaf, and what a period can hold, unless the tuned value is beyond that already."""
    low, high = facts["low"], facts["high"]
    open_low, open_high = ">=" not in facts["rule"], "<=" not in facts["rule"]
    if isinstance(value, list):
        ends = {} if low is None else {"lower": low + LEAST * open_low}
        ends |= {} if high is None else {"upper": high - LEAST * open_high}
        rules = {f"{side}_element_bounds<>": [end] for side, end in ends.items()}
        return {"fixed_size<>": [len(value)]} | (rules if len(ends) < 2 else {"element_bounds<>": [*ends.values()]})
    if highest is not None and value <= highest and (high is None or highest < high):
        high, open_high = highest, False
    if low is not None and high is not None and not (open_low or open_high):
        return {"bounds<>": [low, high]}
    ends = {"gt<>" if open_low else "gt_eq<>": low, "lt<>" if open_high else "lt_eq<>": high}
    return {rule: [end] for rule, end in ends.items() if end is not None}


def _node(artefact: Artefact) -> dict[str, Json]:
    """Parameters of the node; the defaults know nothing of the robot."""
    named = {
        "frame": _table("odom", TEXTS["frame"], {"not_empty<>": []}, read_only=True),
        "stamped": _table(False, TEXTS["stamped"], {}, read_only=True),
        "base_frame": _table("base_link", TEXTS["base_frame"], {}, read_only=True),
    }
    late = max(0.2, 3 * float(artefact.controller.period))
    about = "Age of the newest odometry from which on the vehicle is stopped"
    if artefact.route is None:
        named["use_stamps"] = _table(True, TEXTS["use_stamps"], {}, read_only=False)
        rows = _on_path(artefact)
    else:
        named["route_file"] = _table("", TEXTS["route_file"], {}, read_only=True)
        if isinstance(artefact.controller.vehicle, agvjax.Ackermann):
            behind = artefact.controller.vehicle.behind
            named["steered_behind"] = _table(behind, TEXTS["steered_behind"], {}, read_only=True)
        rows = ros2_parts.limits(artefact)
    rows |= {"timeout": (late, "s", "gt", about)}
    numbers = {
        name: _table(float(f"{default:.6g}"), f"{text} [{unit}]", {f"{rule}<>": [0.0]}, read_only=False)
        for name, (default, unit, rule, text) in rows.items()
    }
    return _base(artefact) | named | numbers


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


def _base(artefact: Artefact) -> dict[str, Json]:
    """Parameters that are numbers of the robot's own base; by default the vehicle's."""
    numbers = leaves(artefact.controller.vehicle).items()
    vehicle = _kind(artefact)({part: float(x) for part, x in numbers if np.ndim(x) == 0})
    text = "The {} by which the robot's base turns cmd_vel into what it does [m]"
    rows = {key: (float(vehicle.of[part]), text.format(PARTS[part])) for key, part in vehicle.base.items()}
    return {key: _table(default, words, {"gt<>": [0.0]}, read_only=False) for key, (default, words) in rows.items()}


def _kind(artefact: Artefact) -> type[Accelerations]:
    kinds: dict[tuple[str, ...], type[Accelerations]] = {**VEHICLES}
    return kinds[tuple(artefact.provenance["inputs"])]


def _version(artefact: Artefact) -> str:
    """The version of the generator, as package.xml takes it: three numbers."""
    numbers = re.search(r"\d+\.\d+\.\d+", artefact.provenance["generator"])
    return numbers[0] if numbers else "0.1.0"


def _nested(flat: Json) -> Json:
    tree: Json = {}
    for name, value in flat.items():
        *parents, last = name.split(".")
        part = tree
        for parent in parents:
            part = part.setdefault(parent, {})
        part[last] = value
    return tree


def _yaml(tree: Json) -> str:
    return yaml.dump(tree, Dumper=Dumper, sort_keys=False, default_flow_style=False, width=120, allow_unicode=True)
