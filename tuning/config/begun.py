"""A problem to begin with: the text of a short TOML file for a vehicle of which a few numbers are known."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from collections.abc import Mapping

import numpy as np

import agvjax

from . import mapped
from .columns import unsaid
from .fields import USUAL
from .load import PRESETS
from .recipes import RECIPES, track_of

SHARP = math.radians(20)  # between two lines of a path: a larger angle is a corner, no curve that was sampled
COARSE = 0.01  # s, the largest step
EASY = 0.8  # of what the vehicle can do, that its path asks of it: feedback needs the rest
SIDEWAYS = 0.5  # of its acceleration: a wheel must change its speed where an arc begins
LAPS, REST = 1.3, 5.0  # times its time on the path, and s more: laws are slower in turns than the path asks
SPREAD = {  # how far numbers are drawn about the given ones, times; as those of the presets base and forklift
    "threshold": (0.6, 0.6),
    "slope": (0.1, 0.1),
    "delay": (0.5, 0.5),
    "lag": (0.45, 0.65),
    "acceleration": (0.3, 0.2),
}
TURNS, ROUND = 0.5, 1.5  # s, within which a yaw rate that is asked for can be reached; times the most of its path
START, TURNED, DRIFT = 0.2, 0.3, 0.02  # m across, rad and rad/s, either way
RECTANGLE = [[5.0, 0.0], [10.0, 0.0], [10.0, 5.0], [0.0, 5.0], [0.0, 0.0]]  # m, the built-in path


@dataclasses.dataclass(frozen=True, kw_only=True)
class Points:
    """The path of a file.

    Attributes:
        file: its name.
        closed: whether its last point is its first.
        cornered: whether it is of straight lines with corners.
        speeds: whether it has speeds, or times.
    """

    file: str
    closed: bool
    cornered: bool
    speeds: bool


def points(file: str) -> Points:
    """What a file of a path is.

    Raises:
        agvjax.InputError: it cannot be read; says what it must be.
    """
    try:
        rows, speed, _ = track_of({"file": file}, False, ("speed",), unsaid)
    except agvjax.InputError as error:
        raise agvjax.InputError([fault._replace(key="--path", value=file) for fault in error.faults]) from error
    ways = np.diff(rows, axis=0)
    ways = ways[np.hypot(*ways.T) > 0]
    turns = np.diff(np.unwrap(np.arctan2(ways[:, 1], ways[:, 0])))
    return Points(
        file=file,
        closed=len(rows) > 3 and bool(np.array_equal(rows[0], rows[-1])),
        cornered=bool(np.any(np.abs(turns) > SHARP)),
        speeds=speed is not None,
    )


# long: the file from its first line to its last
def problem(kind: str, numbers: Mapping[str, float], law: str, path: Points | None, within: float | None = None) -> str:
    """The text of a file that `agvjax tune --config` takes.

    Args:
        kind: of vehicle: differential, twist, ackermann, forklift.
        numbers: rate, delay, deadzone and so on, all that the kind has; see `tuning.cli.questions`.
        law: a name of `controller.inner`.
        path: None takes a built-in one.
        within: a limit on the distance to the path [m].

    Raises:
        agvjax.InputError: no route can be laid so.
    """
    period = 1 / numbers["rate"]
    actuators = ("left", "right") if kind == "differential" else ("speed", "steering_angle")
    actuators = ("speed", "yaw_rate") if kind == "twist" else actuators
    route = _route(kind, numbers, path)
    laid = RECIPES[agvjax.Route].make(route, unsaid)
    assert isinstance(laid, agvjax.Route)
    position, heading = _start(laid)
    lines = [
        f"# {kind}. Tune it: agvjax tune --config THIS_FILE. What a key means: agvjax explain KEY",
        "",
        f"scenario.plant = {_toml(_plant(kind, numbers))}",
        'scenario.disturbance = "none"',
        "# straight lines, corners rounded; accelerations [m/s^2] leave the law a reserve"
        if "tolerance" in route or "radius" in route
        else "# a smooth curve through the points",
        f"scenario.path = {_toml(route)}",
        f"scenario.start = {_toml({'position': position, 'heading': heading})}",
        "# commands below these values move nothing;"
        f" of what is above them {_slope(kind):g} arrives, as assumed (slope_right, slope_left)",
        "# delays of commands [s], with slots for the longest at this rate",
        f"scenario.deadzone = {_toml({name: _zone(name, kind, numbers) for name in actuators})}",
        f"scenario.actuators = {_toml({name: {'delay': _delay(numbers)} for name in actuators})}",
        "",
        "# the computer, one command per period [s], and the law to tune",
        f"controller = {_toml({'type': 'sampled', 'period': period, 'inner': _inner(law, kind, numbers, laid)})}",
        "",
        "# a run [s] covers the whole path and a little more",
        *_runs(laid, period, numbers),
        "",
        "# the uncertainty: every vehicle of the ensemble is drawn like this",
        *_draws(kind, numbers, actuators, heading),
    ]
    if within is not None:
        limit = {"worst": within, "absolute": True}
        lines += [
            "",
            "# largest distance of any vehicle to its path [m]",
            f"tune.limits.cross_track_peak_late = {_toml(limit)}",
        ]
    return "\n".join(lines) + "\n"


def _plant(kind: str, numbers: Mapping[str, float]) -> dict[str, object]:
    """The table of a vehicle."""
    rates = {"time_constant": numbers["lag"], "acceleration": numbers["acceleration"]}
    if kind == "differential":
        return {"type": "base", "track": numbers["track"], **rates}
    if kind == "twist":
        both = [numbers["acceleration"], numbers["turn_acceleration"]]
        return {"type": "twist_base", "time_constants": [numbers["lag"]] * 2, "accelerations": both}
    behind = {"behind": True, "largest_angle": 1.2, "steering_rate": 1.2} if kind == "forklift" else {}
    return {"type": "ackermann", **behind, "wheelbase": numbers["wheelbase"], **rates}


def _route(kind: str, numbers: Mapping[str, float], path: Points | None) -> dict[str, object]:
    """The table of a path; without a file a rectangle of 10 x 5 m, which an axle that is steered goes round wider."""
    limit = numbers["acceleration"]
    speed = {"speed": numbers["speed"]} if path is None or not path.speeds else {}
    limits = {"acceleration": EASY * limit, "deceleration": EASY * limit, "lateral_acceleration": SIDEWAYS * limit}
    rest = {**speed, "limits": limits}
    if path is None:
        radius = 1.0 if kind in ("differential", "twist") else max(1.0, 1.5 * numbers["wheelbase"])
        size = max(1.0, radius / 2)  # of a truck: so that its corners have room
        corners = [[size * x, size * y] for x, y in RECTANGLE]
        return {"type": "route", "points": corners, "radius": radius, "closed": True, **rest}
    corner = {"tolerance": numbers["corner"]} if path.cornered else {}
    return {"type": "route", "file": path.file, "closed": path.closed, **corner, **rest}


def _start(route: agvjax.Route) -> tuple[list[float], float]:
    """Where [m] the path begins on its map, and the heading [rad] along it."""
    start = mapped.begun(route)
    position = np.asarray(start.position) + route.origin
    return [round(float(x), 6) + 0.0 for x in position], round(float(start.heading), 6) + 0.0


def _slope(kind: str) -> float:
    """That of the deadzones of a vehicle, of which nobody was asked."""
    plants = {"differential": agvjax.Base(), "twist": agvjax.TwistBase()}
    zones = plants.get(kind, agvjax.Ackermann()).deadzones().values()
    return float(next(zone.slope_right for zone in zones if isinstance(zone, agvjax.Deadzone)))


def assumed(kind: str, numbers: Mapping[str, float]) -> list[str]:
    """What `problem` takes for granted besides the numbers, each a line."""
    wide = numbers["uncertainty"]
    less, more = ([f"{100 * x * wide:g}" for x in SPREAD[name]] for name in ("threshold", "delay"))
    return [
        f"above its deadzone a motor delivers {_slope(kind):g} of what is left (slope_right, slope_left)",
        f"the path asks for {EASY:g} of the acceleration along it, and in turns for {SIDEWAYS:g} of it sideways",
        f"the ensemble varies thresholds by {less[0]} %, delays by {more[0]} %, either way, and starts up to"
        f" {START * wide:g} m beside the path, turned by up to {TURNED * wide:g} rad",
    ]


def _zone(actuator: str, kind: str, numbers: Mapping[str, float]) -> dict[str, float]:
    name = {"yaw_rate": "turn_deadzone", "steering_angle": "steering_deadzone"}.get(actuator, "deadzone")
    return {"threshold_right": numbers[name], "threshold_left": numbers[name]}


def _delay(numbers: Mapping[str, float]) -> dict[str, float]:
    longest = numbers["delay"] * (1 + SPREAD["delay"][1] * numbers["uncertainty"])
    return {"time": numbers["delay"], "slots": max(2, 1 + math.ceil(longest * numbers["rate"] - 1e-9))}


def _inner(law: str, kind: str, numbers: Mapping[str, float], route: agvjax.Route) -> dict[str, object]:
    """The law; no slower than its deadzone lets it move, no faster than its path, and turning no faster than it can.

    With gains tuned for 64 of them, the worst of 256 others swayed by half a metre where 1.5 rad/s could be asked
    for, which its wheels reach within a second only; where 1 rad/s could, it stayed within some 11 mm.
    """
    speed = numbers["speed"]
    slow = min(max(2 * numbers["deadzone"], 0.1 * speed), speed)
    table = {"type": law, "min_approach_linear_velocity": slow}
    if kind in ("differential", "twist"):
        quick = (
            2 * numbers["acceleration"] / numbers["track"] if kind == "differential" else numbers["turn_acceleration"]
        )
        table["max_angular_velocity"] = round(max(TURNS * quick, ROUND * _turning(route)), 2)
    if law == "regulated_pure_pursuit":
        table |= {"desired_linear_vel": speed, "use_velocity_scaled_lookahead_dist": True}
    return table


def _turning(route: agvjax.Route) -> float:
    """The largest yaw rate [rad/s] of a path, where its pieces begin."""
    _, x, xx, *_ = table = np.asarray(route.table)
    y, yy = table[7], table[8]
    curvature = 2 * np.abs(x * yy - y * xx) / np.hypot(x, y) ** 3
    return float(np.max(curvature * np.sqrt(np.asarray(route.squares)[0])))


def _runs(route: agvjax.Route, period: float, numbers: Mapping[str, float]) -> list[str]:
    """Steps and length of runs."""
    dt = period / math.ceil(period / COARSE - 1e-9)
    lap = route.lap()
    long = LAPS * (route.end() if lap is None else lap) + REST
    late = round(max(float(USUAL.late), 2 / numbers["speed"]), 1)
    horizon = max(math.ceil(max(long, 2 * late) / period), 1) * period
    return [
        f"simulate = {_toml({'horizon': horizon, 'dt': dt})}",
        f"tune.dt = {_number(dt)}",
        *([f"criteria.late = {_number(late)}"] if late != USUAL.late else []),
    ]


def _draws(kind: str, numbers: Mapping[str, float], actuators: tuple[str, str], heading: float) -> list[str]:
    """What is drawn: a line for the deadzones of each actuator, the delays, the vehicle and the start."""
    wide = numbers["uncertainty"]

    def times(name: str) -> dict[str, list[float]]:
        less, more = SPREAD[name]
        return {"times": [round(1 - less * wide, 6), round(1 + more * wide, 6)]}

    names = ("threshold_right", "threshold_left", "slope_right", "slope_left")
    zone = {name: times(name.partition("_")[0]) for name in names}
    motors = {"time_constant": times("lag"), "acceleration": times("acceleration")}
    if kind == "twist":
        motors = {"time_constants": times("lag"), "accelerations": times("acceleration")}
    drift = {"drift": {"between": [-DRIFT * wide, DRIFT * wide]}}
    across = [START * wide * abs(round(side, 3)) for side in (math.sin(heading), math.cos(heading))]
    start = {
        "position": {"plus": [[-far, far] for far in across]},
        "heading": {"plus": [-TURNED * wide, TURNED * wide]},
    }
    delays = {name: {"delay": {"time": times("delay")}} for name in actuators} if numbers["delay"] else {}
    tables = {f"deadzone.{name}": zone for name in actuators}
    tables |= {"actuators": delays} if delays else {}
    tables |= {"plant": {**motors, **drift}, "start": start}
    return [f"ensemble.draws.{name} = {_toml(table)}" for name, table in tables.items()]


def by_clock(kind: str, numbers: Mapping[str, float]) -> str:
    """The text of a preset whose law goes by the clock, with another rate and delay."""
    rate, delay = numbers["rate"], numbers["delay"]
    slots = max(3, 1 + math.ceil(delay * rate - 1e-9))
    text = (PRESETS / f"{kind}.toml").read_text(encoding="utf-8")
    text = re.sub(r"delay = \{ time = [\d.]+ \}", f"delay = {{ time = {_number(delay)}, slots = {slots} }}", text)
    return re.sub(r"period = [\d.]+", f"period = {_number(1 / rate)}", text)


def _toml(value: object) -> str:
    """A value on one line."""
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{name} = {_toml(part)}' for name, part in value.items())} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return str(value).lower() if isinstance(value, bool | int) else _number(float(str(value)))


def _number(value: float) -> str:
    """A number as a person would write it where that is it."""
    short = f"{value:.10g}"
    return short if "." in short or "e" in short else f"{short}.0"
