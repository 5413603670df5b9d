"""A ROS 2 package (ament_cmake) with a controller of Nav2 in C++ around the exported C, its parameters with bounds."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

import agvjax

from ..config import routes
from ..io.files import Json
from . import c, names, parameters, program, ros2, ros2_parts
from .artefact import Artefact, filled, version
from .program import Field, Program
from .ros2_node.vehicles import ON_ROUTES

TEMPLATES = Path(__file__).with_name("nav2_files")
NAME = "agv_nav2_controller"
MODEST = 0.5  # m/s^2, where the configuration limits nothing
LEAST = 0.001  # m between poses that are told apart
TEXTS = {
    "acceleration": "Acceleration of the speed over a plan",
    "deceleration": "Deceleration of it, and where it is cancelled",
    "lateral_acceleration": "Largest square of the speed times curvature of a plan",
}
PLUGIN = "FollowPath"  # as Nav2's behaviour trees call it
WANTED = {  # speed and yaw rate of the vehicle by its inputs, and the part by whose ratio its base turns otherwise
    ("speed", "yaw_rate"): ("inputs.speed", "inputs.yaw_rate", ""),
    ("left", "right"): (
        "(inputs.left + inputs.right) / 2",
        "(inputs.right - inputs.left) / gains.vehicle_track",
        "track",
    ),
    ("speed", "steering_angle"): (
        "inputs.speed",
        "{side}inputs.speed * std::tan(inputs.steering_angle) / gains.vehicle_wheelbase",
        "wheelbase",
    ),
}


def files(artefact: Artefact, name: str = NAME) -> dict[str, str]:
    """The package by relative paths: plugin, law in C, parameters with bounds, bring-up, README.

    `name` is that of the package; the plugin is `NAME_nav2::Controller`.

    Raises:
        agvjax.InputError: the name is none of a package, the vehicle takes no velocity, or the law follows no route.
    """
    inputs, law = parameters.inputs(artefact, name, ON_ROUTES), type(artefact.controller.inner).__name__
    if artefact.route is None:
        rule = "a law that follows a route by where it is: a plan of Nav2 has no times"
        raise agvjax.InputError([agvjax.Fault("controller.inner", law, rule)])
    step, specification = program.step(artefact.controller), tables(artefact)
    base = parameters.vehicle_kind(artefact).base
    origin = {key: fact for key, fact in artefact.provenance.items() if key != "gains"}
    period = float(artefact.controller.period)
    parts = {
        "NAME": name,
        "UPPER": name.upper(),
        "GENERATOR": artefact.provenance["generator"],
        "VERSION": version(artefact),
        "PERIOD": f"{period:g}",
        "FREQUENCY": f"{1 / period:g}",
        "CONVERSION": _here(ros2.CONVERSIONS[", ".join(inputs)]),
        "BASE": _here(ros2.BASE.format(", ".join(f"`{key}`" for key in base))) if base else "",
        "PROVENANCE": "\n    ".join(json.dumps(origin, indent=2).splitlines()),
        **_law(artefact, step),
    }
    moved = {"controller.hpp": f"include/{name}/controller.hpp"}
    moved |= {f: f for f in ("CMakeLists.txt", "package.xml", "plugin.xml", "README.md")}
    moved |= {f: f"src/{f}" for f in ("controller.cpp", "law.hpp", "plan.hpp", "plan.cpp", "spline.hpp", "spline.cpp")}
    texts = {path: filled(TEMPLATES / f"{file}.txt", parts) for file, path in moved.items()}
    texts |= {f"law/{path}": text for path, text in c.files(artefact, name).items()}
    return texts | {
        "src/parameters.yaml": parameters.dumped({f"{name}_parameters": parameters.nested(specification)}),
        "config/nav2.yaml": _bringup(name, period, specification),
    }


def _here(text: str) -> str:
    """What is said of the ROS 2 node, of a plugin."""
    return text.replace("of the node", "of this controller").replace("where `steered_behind`", "where it steers behind")


def tables(artefact: Artefact) -> dict[str, Json]:
    """Every parameter of the plugin by its dotted name, as generate_parameter_library states one."""
    law = parameters.of_law(artefact)
    for name in law:
        names.check_members("parameters", name.split("."))  # each part is a member of a structure
    return _plan(artefact) | parameters.of_base(artefact) | law


def _plan(artefact: Artefact) -> dict[str, Json]:
    """How a plan is laid and driven, by default as the route of the configuration."""
    forwards, backwards = ros2_parts.fastest(artefact.route)
    rows, late = ros2_parts.limits(artefact), max(0.2, 3 * float(artefact.controller.period))
    back = backwards or forwards
    rows["max_reverse_speed"] = (1.5 * back, "m/s", "gt", "Largest speed backwards commanded")
    rows |= {
        "speed": (forwards, "m/s", "gt", "Speed along a plan"),
        "reverse_speed": (back, "m/s", "gt", "Speed where a plan is driven backwards"),
        **{key: (most, "m/s^2", "gt", TEXTS[key]) for key, most in _accelerations(artefact).items()},
        "spacing": (0.1, "m", "gt", "Poses of a plan nearer than this to the one before are left out"),
        "reached": (
            _reached(artefact),
            "m",
            "gt",
            "From the end of a plan, or of a stretch driven one way, where it is done",
        ),
        "timeout": (late, "s", "gt", "Age of a pose from which on the vehicle is stopped"),
        "transform_tolerance": (0.1, "s", "gt_eq", "How long a transform into the frame of the plan is waited for"),
    }
    numbers = parameters.numbers(rows)
    numbers["spacing"]["validation"] = {"gt_eq<>": [LEAST]}
    about = "Whether headings of poses say where a plan is driven backwards"
    return {"allow_reversing": parameters.table(backwards > 0, about, {}, read_only=False)} | numbers


def _accelerations(artefact: Artefact) -> dict[str, float]:
    """Those that the route of the configuration is laid with [m/s^2], modest ones where it has none."""
    table = routes.table_of(artefact.route).get("limits") if artefact.route else None
    given = table if isinstance(table, dict) else {}
    found = {key: float(str(given.get(key, "inf"))) for key in TEXTS}
    return {key: most if np.isfinite(most) else MODEST for key, most in found.items()}


def _reached(artefact: Artefact) -> float:
    return float(artefact.route.reached) if artefact.route else 0.0


def _law(artefact: Artefact, step: Program) -> dict[str, str]:
    """What law.hpp is filled with."""
    fields, given = step.arguments["state"], [f"controller.{f.name}" for f in step.arguments["gains"]]
    (inside,) = {field.name.partition("place.")[0] for field in fields if "place." in field.name}
    kept = [field for field in fields if not field.name.startswith(f"{inside}place.")]
    speed, yaw_rate, part = WANTED[tuple(artefact.provenance["inputs"])]
    vehicle = artefact.controller.vehicle
    side = "-" if isinstance(vehicle, agvjax.Ackermann) and vehicle.behind else ""
    return {
        "GAINS": "\n".join(map(_gain, step.arguments["gains"], given)),
        "KEPT": "\n".join(
            f"  into.{f.member}{place} = from.{f.member}{place};" for f in kept for place, _ in f.elements
        ),
        "PLACE": f"{inside}place.".replace(".", "_"),
        "SPEED": speed,
        "YAW_RATE": yaw_rate.format(side=side),
        "TURNED": f"gains.vehicle_{part} / params.base_{part}" if part else "1.0",
    }


def _gain(field: Field, parameter: str) -> str:
    """A gain from its parameter; a list of numbers has as many as the law has."""
    if not field.shape:
        return f"  found.{field.member} = params.{parameter};"
    return f"  std::copy_n(params.{parameter}.begin(), {field.shape[0]}, found.{field.member});"


def _bringup(name: str, period: float, specification: dict[str, Json]) -> str:
    """The section of the controller server."""
    values = {key: table["default_value"] for key, table in specification.items()}
    server: Json = {
        "controller_frequency": float(f"{1 / period:.6g}"),
        "min_x_velocity_threshold": 0.001,
        "min_y_velocity_threshold": 0.5,
        "min_theta_velocity_threshold": 0.001,
        "failure_tolerance": 0.3,
        "progress_checker_plugins": ["progress_checker"],
        "goal_checker_plugins": ["goal_checker"],
        "controller_plugins": [PLUGIN],
        "progress_checker": {
            "plugin": "nav2_controller::SimpleProgressChecker",
            "required_movement_radius": 0.5,
            "movement_time_allowance": 10.0,
        },
        "goal_checker": {
            "plugin": "nav2_controller::SimpleGoalChecker",
            "xy_goal_tolerance": 0.1,
            "yaw_goal_tolerance": 3.15,
            "stateful": True,
        },
        PLUGIN: {"plugin": f"{name}_nav2::Controller", **parameters.nested(values)},
    }
    head = "# Of the controller server of Nav2: merge it into the parameters of your robot.\n"
    return head + parameters.dumped({"controller_server": {"ros__parameters": server}})
