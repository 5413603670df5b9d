"""What `agvjax new` asks of a vehicle: its kinds, and the numbers that matter for each, with their defaults.

Without JAX, since the options of the command are made of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from ..io.numbers import real
from .options import QUIET, Command, Option, flag, option

KINDS = {  # as a user would name them, and what each is
    "differential": "two driven wheels, each with a deadzone; you send a speed and a yaw rate",
    "twist": "any base whose motor controller takes speed and yaw rate, with a deadzone on each of the two",
    "ackermann": "a steered axle in front; you send a speed and a steering angle",
    "forklift": "the same, steered at the rear",
    "robot": "two driven wheels; you send torques",
    "car": "a car; you send an acceleration and a steering rate",
    "unicycle": "a rolling body; you send an acceleration and a yaw acceleration",
}
BY_CLOCK = ("robot", "car", "unicycle")  # their laws follow a point that moves in time
LAWS = {  # that follow a path by where the vehicle is
    "path_pid": "feedforward of curvature, feedback of deviation, heading error and integral: the most accurate",
    "regulated_pure_pursuit": "as in Nav2, with its parameter names: the smoothest",
    "stanley": "steers the front axle onto the path",
    "path_lqr": "LQR gains, scheduled over speed",
}


class Question(NamedTuple):
    """A number that may matter.

    Attributes:
        words: what is asked for.
        unit: of the number.
        default: by kind of vehicle; a kind that is not there is not asked.
        low: the smallest that may be; 0 itself may be only of what `may_vanish`.
        high: the largest.
        may_vanish: whether it may be 0.
    """

    words: str
    unit: str
    default: Mapping[str, float]
    low: float = 0.0
    high: float = 1e3
    may_vanish: bool = False

    @property
    def rule(self) -> str:
        """What the number must be."""
        return f"a number {'>=' if self.may_vanish else '>'} {self.low:g} and at most {self.high:g} {self.unit}".strip()

    def fits(self, value: float) -> bool:
        """Whether a number keeps the rule."""
        return (self.low < value or (self.may_vanish and value == self.low)) and value <= self.high


def _all(**values: float) -> dict[str, float]:
    return {kind: values.get(kind, values["usual"]) for kind in KINDS if kind not in BY_CLOCK}


QUESTIONS = {
    "rate": Question("commands per second", "Hz", {**_all(usual=20), "robot": 50, "car": 50, "unicycle": 50}),
    "delay": Question(
        "delay until a command takes effect",
        "s",
        {**_all(usual=0.08), "robot": 0.02, "car": 0.02, "unicycle": 0.02},
        high=2.0,
        may_vanish=True,
    ),
    "deadzone": Question(
        "speed below which the vehicle, or one of its wheels, does not move",
        "m/s",
        _all(usual=0.06, ackermann=0.05, forklift=0.04),
        high=2.0,
        may_vanish=True,
    ),
    "turn_deadzone": Question(
        "yaw rate below which it does not turn", "rad/s", {"twist": 0.1}, high=3.0, may_vanish=True
    ),
    "steering_deadzone": Question(
        "angle below which the steering does not move",
        "rad",
        {"ackermann": 0.0175, "forklift": 0.0125},
        high=0.5,
        may_vanish=True,
    ),
    "acceleration": Question("largest acceleration and deceleration", "m/s^2", _all(usual=1.0), high=100.0),
    "turn_acceleration": Question("largest yaw acceleration", "rad/s^2", {"twist": 3.0}),
    "lag": Question("time constant of its motors", "s", _all(usual=0.15, ackermann=0.2, forklift=0.2), high=10.0),
    "track": Question("distance between its driven wheels", "m", {"differential": 0.5}, high=10.0),
    "wheelbase": Question("distance between its axles", "m", {"ackermann": 1.2, "forklift": 1.2}, high=20.0),
    "speed": Question("speed on the path, where the limits allow it", "m/s", _all(usual=0.5), high=50.0),
    "corner": Question("how far from a corner the path may pass", "m", _all(usual=0.25), high=100.0),
    "uncertainty": Question(
        "how uncertain these numbers are; 1: as for a base that was never measured", "", _all(usual=1.0), high=1.5
    ),
}
LEFT = ("lag", "track", "wheelbase", "corner", "uncertainty", "turn_acceleration")  # not asked: the default is printed


def spelled(name: str) -> str:
    """The option of a question."""
    return f"--{name.replace('_', '-')}"


def _number(name: str, question: Question) -> Option:
    unit = f" [{question.unit}]" if question.unit else ""
    values = sorted(set(question.default.values()))
    usual = f"{values[0]:g}" if len(values) == 1 else f"{values[0]:g} to {values[-1]:g} by vehicle"
    metavar = question.unit.upper() or "TIMES"
    return option(spelled(name), type=real, metavar=metavar, help=f"{question.words}{unit} (default: {usual})")


NEW = Command(
    "write a problem for your vehicle: a short TOML file to tune with",
    (
        option(
            "--vehicle",
            choices=tuple(KINDS),
            help="; ".join(f"{name}: {words}" for name, words in KINDS.items()),
        ),
        option("--law", choices=tuple(LAWS), help="the law (default: path_pid)"),
        option(
            "--path", metavar="FILE.csv", help="columns x, y [m], and perhaps speed [m/s] (default: a built-in path)"
        ),
        flag("--closed", "the path continues from its last point to its first (default: if the two are equal)"),
        *(_number(name, question) for name, question in QUESTIONS.items()),
        option(
            "--within",
            type=real,
            metavar="M",
            help="limit: largest distance of any vehicle to its path (default: none)",
        ),
        option("--out", metavar="FILE.toml", default="robot.toml", help="a new file (default: robot.toml)"),
        QUIET,
    ),
    "--vehicle differential --rate 20 --delay 0.04 --path track.csv",
    (),
)
EXPLAIN = Command(
    "what a setting, a metric, a command or an exit code means",
    (
        option("keys", nargs="+", metavar="KEY", help="such as tune.penalty, scenario.path, cross_track, sweep, 130"),
        QUIET,
    ),
    "tune.penalty scenario.actuators.left.delay",
    (),
)
COMPLETION = Command(
    "a script that lets your shell complete commands and options",
    (option("shell", choices=("bash", "zsh", "tcsh"), help="your shell"), QUIET),
    "bash > ~/.local/share/bash-completion/completions/agvjax",
    (),
)
