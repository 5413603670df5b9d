"""What the node along a path and the node along a route differ in: files, and words of the templates."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from agvjax import Route
from agvjax.leaves import leaves

from ..io.files import Json
from . import tables
from .artefact import Artefact, filled

TEMPLATES = Path(__file__).with_name("ros2_node")
DATA = "route.json"  # beside controller.py
COMMON = ("odometry.py", "vehicles.py", "parameters.py", "driver.py")
PLAIN = {  # what is the same for every law
    "path": (*COMMON, "motion.py", "reference.py", "following.py"),
    "route": (*COMMON, "route_following.py"),
}
PATH = {
    "ORDERED": "a path",
    "MODULE": "following",
    "MESSAGES": "Odometry, Path",
    "SERVICE": "",
    "FOLLOWER": "Follower",
    "READER": "",
    "SUBSCRIBES": "`odom` and `path`",
    "CREATE": 'self.create_subscription(Path, "path", self.on_path, QoSProfile(depth=1))',
    "TOPICS": '("odom", "path", "cmd_vel")',
    "DEPENDS": "",
    "DATA": '["parameters.yaml"]',
    "REMAPPED": "path:=/plan ",
    "TOPIC": "`path`, subscribed | `nav_msgs/Path` | poses in the same frame; only their positions are used, and their"
    " stamps where these are a timing",
    "FRAMES": "Odometry or a path in another frame\nis refused, nothing is transformed: give the node a path in the"
    " frame of the odometry.",
    "LIMITS": "`max_speed`, `max_reverse_speed`, `max_yaw_rate`, `speed` and `acceleration`",
    "UNTIL": "without a path, at its end",
    "AGAIN": "the path is joined again from rest",
}
ROUTE = {
    "ORDERED": "a route",
    "MODULE": "route_following",
    "MESSAGES": "Odometry",
    "SERVICE": "\nfrom std_srvs.srv import SetBool",
    "FOLLOWER": "RouteFollower",
    "READER": ", read_route",
    "SUBSCRIBES": "`odom`, serves `~/drive`",
    "CREATE": 'self.service = self.create_service(SetBool, "~/drive", self.on_drive)',
    "TOPICS": '("odom", "cmd_vel")',
    "DEPENDS": "  <exec_depend>std_srvs</exec_depend>\n",
    "DATA": '["parameters.yaml", "route.json"]',
    "REMAPPED": "",
    "TOPIC": "`~/drive`, service | `std_srvs/SetBool` | true: drive along the route; false: stop",
    "FRAMES": "Odometry in another frame\nis refused, nothing is transformed: give the node a route in the frame of the"
    " odometry.",
    "LIMITS": "`max_speed`, `max_reverse_speed` and `max_yaw_rate`",
    "UNTIL": "until it is told to drive, at the end of the route",
    "AGAIN": "the route is driven on",
}


def words(artefact: Artefact, name: str) -> dict[str, str]:
    """What the templates are filled with, by what the law follows."""
    kind, found = ("path", PATH) if artefact.route is None else ("route", ROUTE)
    handler = {"path": "on_path", "route": "on_drive"}[kind]
    point = _point(artefact)
    return found | {
        **point,
        "HANDLER": filled(TEMPLATES / f"{handler}.py.txt", {}).rstrip(),
        "FOLLOWS": filled(TEMPLATES / f"{kind}.md.txt", {"NAME": name} | point),
    }


def _point(artefact: Artefact) -> dict[str, str]:
    """Which point of the vehicle follows, and where odometry has its own."""
    axle = "the rear axle's centre" if "steering_rate" in artefact.provenance["inputs"] else "the middle of the axle"
    if artefact.route is not None:
        axle = "the middle of the fixed axle"
    return {"L": f"{float(artefact.controller.vehicle.lever() or 0.0):g}", "AXLE": axle}


def files(artefact: Artefact, name: str) -> dict[str, str]:
    """What is the same for every law, and the data of a route."""
    kind = "path" if artefact.route is None else "route"
    plain = {f"{name}/{file}": (TEMPLATES / file).read_text(encoding="utf-8") for file in PLAIN[kind]}
    data = {} if artefact.route is None else {f"{name}/{DATA}": json.dumps(tables.data(artefact.route)) + "\n"}
    return plain | data


def limits(artefact: Artefact) -> Json:
    """Defaults of a node along a route, by name: default, unit, what must hold, text."""
    forwards, backwards = fastest(artefact.route)
    law = {name: float(x) for name, x in leaves(artefact.controller).items() if np.ndim(x) == 0}
    return {
        "max_speed": (1.5 * forwards, "m/s", "gt", "Largest speed commanded"),
        "max_reverse_speed": (1.5 * backwards, "m/s", "gt_eq", "Largest speed backwards commanded, 0 for none"),
        "max_yaw_rate": (law.get("inner.max_angular_velocity", 1.5), "rad/s", "gt", "Largest yaw rate commanded"),
        "max_error": (1.0, "m", "gt", "Distance from the route at which it is given up"),
    }


def fastest(route: Route | None) -> tuple[float, float]:
    """The largest speeds [m/s] of a route, forwards and backwards."""
    if route is None:
        return 0.0, 0.0
    begins, changes = np.asarray(route.squares)
    _, _, first, sign, _ = np.asarray(route.legs)
    leg = np.searchsorted(first, np.arange(begins.size), side="right") - 1
    speed = np.sqrt(np.maximum(begins, begins + changes))
    forwards, backwards = (np.max(speed, initial=0.0, where=sign[leg] == side) for side in (1.0, -1.0))
    return max(float(forwards), 0.1), float(backwards)
