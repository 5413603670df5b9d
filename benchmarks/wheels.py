"""`python -m benchmarks wheels`: the same days of MuJoCo's robot, whose motor drivers have a deadzone and a delay.

What it truly does is measured by driving it with a law; tuned on the truth are gains that are searched for there.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize

import agvjax
from agvjax.leaves import get
from agvjax.paths.heading import reference

from . import days
from .days import HELD, LENGTH, NOISE, PARTS, Robot, dead

GAIN, RATE = 1.2, 12.0  # Nm per rad/s and per rad of a wheel, of the motor drivers
TICK, LATE = 0.001, 5.0  # s, of the physics, and from when on errors count
CHATTER = 16.0  # m/s and rad/s, the limit on how much the command may vary, as in days.toml
BEGINS = ((1.0, 0.08, 0.05),)  # x, y, heading of the starts that are measured
LOOKS = 20  # drives of the search on the truth


class Wheels:
    """The robot, sent wheel speeds [m/s] as a base of this package takes them."""

    def __init__(self, truth: Mapping[str, float]) -> None:
        from tuning.studies.vehicles.robot import Robot as Body  # late: MuJoCo is of an extra

        self.body, self.truth, self.behind = Body(), truth, np.zeros(2)
        self.body.L, self.track = 0.0, self.body.track
        self.sent = [np.zeros(2)]

    def hold(self, asked: np.ndarray, seconds: float) -> None:
        """Send speeds (2,) of the wheels for a while."""
        for _ in range(round(seconds / TICK)):
            self.sent.append(asked)
            wanted = np.empty(2)
            for i, wheel in enumerate(("left", "right")):
                late = round(self.truth[f"actuators.{wheel}.delay.time"] / TICK)
                zone = [self.truth[f"deadzone.{wheel}.{part}"] for part in PARTS]
                wanted[i] = dead(self.sent[max(len(self.sent) - 1 - late, 0)][i], *zone)
            turning = np.array([self.body.data.joint(wheel).qvel[0] for wheel in ("left", "right")])
            lacks = wanted / self.body.wheel_radius - turning
            self.behind = np.clip(self.behind + RATE * lacks * TICK, -3.0, 3.0)
            self.body.step(*np.clip(GAIN * lacks + self.behind, -4.0, 4.0))

    def seen(self) -> agvjax.Measurement:
        """Where it is."""
        place, velocity, heading, w = self.body.pose()
        return agvjax.Measurement(
            position=jnp.asarray(place), velocity=jnp.asarray(velocity), heading=jnp.asarray(heading),
            yaw_rate=jnp.asarray(w),
        )  # fmt: skip


@jax.jit
def _instant(law: Any, scenario: agvjax.Scenario, before: Any, now: agvjax.Measurement, t: Any) -> Any:
    return law.jump((), before, now, _along(scenario, t), jnp.asarray(law.period))


def _along(scenario: agvjax.Scenario, t: Any) -> agvjax.Reference:
    """The reference, with the route that a law follows."""
    return dataclasses.replace(reference(scenario.path, scenario.heading, t), route=scenario.path)


class MujocoRobot(Robot):
    """The robot of MuJoCo; its truth has no motors' numbers, these are of its physics."""

    name = "MuJoCo"
    settings = (
        "tune.limits.pace.worst=inf",
        "tune.limits.total_chatter.worst=inf",
    )  # of few or of many

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        points = np.linspace(0, float(self.config.scenario.path.instants[-1]), 4000)
        self.line = np.asarray(jax.vmap(self.config.scenario.path)(jnp.asarray(points)))
        self.unit = 1.0
        self.unit = self.tracking(self.config.controller, self.begun())

    def recorded(self, truth: Mapping[str, float], random: np.random.Generator) -> np.ndarray:
        """Rows t, x, y, heading, v, w at 50 Hz."""
        levels = random.uniform([-0.5, -1.2], [0.7, 1.2], (LENGTH // HELD + 1, 2))
        levels[::3] *= 0.25
        sent, robot = np.repeat(levels, HELD, axis=0)[:LENGTH], Wheels(truth)
        table = np.empty((LENGTH, 6))
        for i, (v, w) in enumerate(sent):
            now = robot.body.pose()
            table[i] = (i * 0.02, *now[0], now[2], v, w)
            robot.hold(np.array([v - 0.25 * w, v + 0.25 * w]), 0.02)
        table[:, 1:4] += random.normal(0, NOISE, (LENGTH, 3))
        return table

    def driven(self, law: Any, truth: Mapping[str, float]) -> tuple[float, float]:
        """Late rms distance [m] from the route, and how much the command varied, over the starts."""
        errors, chatter, scenario = [], [], self.config.scenario
        period, count = float(law.period), round(self.config.simulate.horizon / float(law.period))
        for x, y, heading in BEGINS:
            robot, twists = Wheels(truth), []
            robot.body.reset((x, y), (0.0, 0.0), heading, L=1e-9)
            before = law.hold(robot.seen(), _along(scenario, jnp.zeros(())))
            for k in range(count):
                before = _instant(law, scenario, before, robot.seen(), jnp.asarray(k * period))
                asked = np.array([float(before.command.inputs[wheel]) for wheel in ("left", "right")])
                twists.append([asked.mean(), (asked[1] - asked[0]) / 0.5])  # for the track that the law believes in
                robot.hold(asked, period)
                if k * period >= LATE:
                    errors.append(np.min(np.hypot(*(self.line - robot.body.pose()[0]).T)))
            chatter.append(np.abs(np.diff(twists, axis=0)).sum())
        return float(np.sqrt(np.mean(np.square(errors)))), float(np.mean(chatter))

    def tracking(self, law: agvjax.Law, truth: Mapping[str, float]) -> float:
        """The distance, 1 where the first gains are on the first day."""
        return self.driven(law, truth)[0] / self.unit

    def best(self, law: agvjax.Law, truth: Mapping[str, float]) -> agvjax.Law:
        """Gains searched for on the truth itself, from those of a law, by Nelder and Mead over their logarithms."""
        names = self.config.tune.gains
        start = np.log([float(get(law, name)) for name in names])

        def at(z: np.ndarray) -> agvjax.Law:
            return agvjax.check(agvjax.replace(law, dict(zip(names, np.exp(z).tolist(), strict=True))))

        def goal(z: np.ndarray) -> float:
            error, chatter = self.driven(at(z), truth)
            return error / self.unit + 10 * max(chatter / CHATTER - 1, 0.0)

        simplex = np.vstack([start, start + 0.15 * np.eye(len(start))])
        return at(minimize(goal, start, method="Nelder-Mead", options={"maxfev": LOOKS, "initial_simplex": simplex}).x)


def measure(count: int = 10, hours: float = np.inf) -> list[dict[str, Any]]:
    """A row, as of `days`."""
    return days.measure(count, hours, kind=MujocoRobot)
