"""A ROS 2 package (ament_python): a node that drives along a path by the exported law, with its parameters' bounds."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml
from jaxtyping import PyTree

import agvjax
from agvjax import leaves
from agvjax.leaves import get

from ..io.files import Json
from . import numpy as numpy_file
from .artefact import Artefact
from .ros2_node.vehicles import VEHICLES

TEMPLATES = Path(__file__).with_name("ros2_node")
PLAIN = ("reference", "odometry", "vehicles", "parameters", "following")  # modules that are the same for every law
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
}


class Dumper(yaml.SafeDumper):
    """Lists in one line, nothing abbreviated: parsers of ROS know no aliases."""

    def ignore_aliases(self, data: PyTree) -> bool:
        """Every one."""
        return True


Dumper.add_representer(list, lambda dumper, x: dumper.represent_sequence("tag:yaml.org,2002:seq", x, flow_style=True))


class Own(NamedTuple):
    """A parameter of the node itself."""

    default: float | str | bool
    unit: str
    text: str
    validation: dict[str, list[PyTree]] = {}
    read_only: bool = False


def files(artefact: Artefact, name: str = NAME) -> dict[str, str]:
    """The package by relative paths; `name` is that of package and node.

    Raises:
        agvjax.InputError: the name is none of a package, or the vehicle takes no velocity.
    """
    inputs = _inputs(artefact, name)
    specification = parameters(artefact)
    values = {key: table["default_value"] for key, table in specification.items()}
    origin = {key: fact for key, fact in artefact.provenance.items() if key != "gains"}
    substitutes = {
        "NAME": name,
        "VERSION": _version(artefact),
        "PERIOD": f"{_value(artefact, 'period'):g}",
        "L": f"{float(artefact.controller.vehicle.lever() or 0.0):g}",
        "AXLE": "the rear axle's centre" if "steering_rate" in inputs else "the middle of the axle",
        "CONVERSION": CONVERSIONS[", ".join(inputs)],
        "PROVENANCE": "\n    ".join(json.dumps(origin, indent=2).splitlines()),
    }
    controller = next(text for file, text in numpy_file.files(artefact).items() if file.endswith(".py"))
    made = {file: _filled(template, substitutes) for file, template in _texts(name).items()}
    made |= {f"{name}/{plain}.py": (TEMPLATES / f"{plain}.py").read_text(encoding="utf-8") for plain in PLAIN}
    return made | {
        f"resource/{name}": "",
        f"{name}/__init__.py": f'"""Drives along a path by a control law: {artefact.provenance["generator"]}."""\n',
        f"{name}/controller.py": controller if isinstance(controller, str) else controller.decode(),
        f"{name}/parameters.yaml": _yaml({name: _nested(specification)}),
        "config/params.yaml": _yaml({"/**": {"ros__parameters": _nested(values)}}),
    }


def _stable(poles: np.ndarray) -> bool:
    """No integrator steps the exported law: a sampled law's bounds are those of its period."""
    return True


def parameters(artefact: Artefact) -> dict[str, Json]:
    """Every parameter of the node by its dotted name, as generate_parameter_library states one."""
    highest = {name: float(x) for name, x in artefact.controller.upper_bounds(_stable).items()}
    law = {f"controller.{name}": _gain(artefact, name, highest.get(name)) for name in artefact.provenance["gains"]}
    return {name: _own(own) for name, own in _node(artefact).items()} | law


def _texts(name: str) -> dict[str, str]:
    return {
        "package.xml": "package.xml.txt",
        "setup.py": "setup.py.txt",
        "setup.cfg": "setup.cfg.txt",
        "README.md": "README.md.txt",
        f"launch/{name}.launch.py": "launch.py.txt",
        f"{name}/node.py": "node.py.txt",
    }


def _filled(template: str, substitutes: dict[str, str]) -> str:
    text = (TEMPLATES / template).read_text(encoding="utf-8")
    for key, value in substitutes.items():
        text = text.replace(f"@{key}@", value)
    return text


def _inputs(artefact: Artefact, name: str) -> tuple[str, ...]:
    """Those of the vehicle, if a velocity can be made of them."""
    faults, inputs = [], tuple(artefact.provenance["inputs"])
    if not re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", name) or len(name) < 2:
        rule = "lower-case letters, digits and single underscores, a letter first: the name of a ROS 2 package"
        faults.append(agvjax.Fault("--name", name, rule))
    kind = type(artefact.controller.vehicle).__name__
    if inputs not in VEHICLES:
        rule = f"with inputs a velocity can be made of: {'; '.join(map(', '.join, VEHICLES))}"
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
    value = _value(artefact, name)
    fixed = name == "period" or name.startswith("vehicle.")
    holder = get(artefact.controller, name.rpartition(".")[0]) if "." in name else artefact.controller
    metadata = {f.name: f.metadata for f in dataclasses.fields(holder)} if dataclasses.is_dataclass(holder) else {}
    source = metadata.get(name.rpartition(".")[2], {}).get("source", "")
    words = [f"unit {facts['unit'] or '1'}", source, str(facts["rule"] or "")]
    told = f"{name} of {type(artefact.controller.inner).__name__}" if name.startswith("inner.") else name
    table: Json = {
        "type": "double_array" if isinstance(value, list) else "double",
        "default_value": value,
        "description": f"{told}: {', '.join(filter(None, words))}",
    }
    rule = {"bounds<>": [value, value]} if name == "period" else _validation(facts, value, highest)
    return table | ({"read_only": True} if fixed else {}) | ({"validation": rule} if rule else {})


def _validation(facts: Json, value: PyTree, highest: float | None) -> dict[str, list[PyTree]]:
    """The rule beside a leaf, and what a period can hold, unless the tuned value is beyond that already."""
    low, high = (None if end is None or not math.isfinite(end) else float(end) for end in (facts["low"], facts["high"]))
    rule = str(facts["rule"] or "")
    open_low, open_high = ">=" not in rule, "<=" not in rule
    if isinstance(value, list):
        rules = {"fixed_size<>": [len(value)]}
        ends = [None if low is None else low + LEAST * open_low, None if high is None else high - LEAST * open_high]
        if None not in ends:
            return rules | {"element_bounds<>": ends}
        return rules | {
            f"{side}_element_bounds<>": [end]
            for side, end in zip(("lower", "upper"), ends, strict=True)
            if end is not None
        }
    if highest is not None and value <= highest and (high is None or highest < high):
        high, open_high = highest, False
    if low is not None and high is not None and not (open_low or open_high):
        return {"bounds<>": [low, high]}
    ends = {"gt<>" if open_low else "gt_eq<>": low, "lt<>" if open_high else "lt_eq<>": high}
    return {rule: [end] for rule, end in ends.items() if end is not None}


def _own(own: Own) -> Json:
    kind = {float: "double", str: "string", bool: "bool"}[type(own.default)]
    table = {
        "type": kind,
        "default_value": own.default,
        "description": own.text + (f" [{own.unit}]" if own.unit else ""),
    }
    return (
        table
        | ({"read_only": True} if own.read_only else {})
        | ({"validation": own.validation} if own.validation else {})
    )


def _node(artefact: Artefact) -> dict[str, Own]:
    """Parameters of the node; the defaults are modest for a vehicle of this size, and know nothing of the robot."""
    period, vehicle = _value(artefact, "period"), leaves(artefact.controller.vehicle)
    car = "steering_rate" in artefact.provenance["inputs"]
    slow = float(vehicle["slowest"]) if car else 0.2  # m/s, on which the other speeds are measured
    most = (
        2 * slow * math.tan(float(vehicle["limits.steering_angle"])) / float(artefact.controller.vehicle.lever() or 0.0)
        if car
        else 1.5
    )
    above, least = {"gt<>": [0.0]}, {"gt_eq<>": [0.0]}
    return {
        "frame": Own(
            "odom", "", "Frame of odometry and path; messages in another are refused", {"not_empty<>": []}, True
        ),
        "use_stamps": Own(True, "", "Whether stamps of poses that increase say how fast the path is driven"),
        "speed": Own(2 * slow, "m/s", "Speed along a path without stamps", above),
        "acceleration": Own(
            slow if car else 0.3, "m/s^2", "Peak acceleration of the ramps from rest and to rest", above
        ),
        "spacing": Own(slow / 2, "m", "Poses nearer than this to the one before are left out", least),
        "max_speed": Own(6 * slow, "m/s", "Largest speed commanded", above),
        "max_reverse_speed": Own(slow / 2, "m/s", "Largest speed backwards commanded, 0 for none", least),
        "max_yaw_rate": Own(round(most, 2), "rad/s", "Largest yaw rate commanded, and planned along bends", above),
        "max_speed_lead": Own(1.5 * slow, "m/s", "How far a commanded speed may be from the measured one", above),
        "max_yaw_rate_lead": Own(1.0, "rad/s", "How far a commanded yaw rate may be from the measured one", above),
        "max_error": Own(5 * slow, "m", "Distance from the reference at which the path is given up", above),
        "goal_tolerance": Own(slow / 10, "m", "Distance from the end at which the path is finished", above),
        "settling_time": Own(2.0, "s", "Time after the end of the path at which it is finished anyway", least),
        "timeout": Own(
            max(0.2, 3 * period), "s", "Age of the newest odometry from which on the vehicle is stopped", above
        ),
    }


def _value(artefact: Artefact, name: str) -> PyTree:
    value = artefact.provenance["gains"][name]["value"]
    return [float(part) for part in value] if isinstance(value, (list, tuple)) else float(value)


def _version(artefact: Artefact) -> str:
    """That of the generator, as package.xml takes it: three numbers."""
    found = re.search(r"\d+\.\d+\.\d+", str(artefact.provenance["generator"]))
    return found[0] if found else "0.1.0"


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
