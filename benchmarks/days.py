"""A robot that drifts day by day: identified from a drive of the day, tuned, and changed only if `apply` accepts it.

`python -m benchmarks days --days 400` is what is asked for; 40 are the default, and `--hours` ends earlier. A drive is
simulated by the few lines of `drive`, which know nothing of the package; what tracking truly is, is measured on the
vehicle that it was of.
"""

from __future__ import annotations

import csv
import dataclasses
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np

import agvjax
from agvjax.leaves import get
from tuning import config as configuration
from tuning.apply import apply
from tuning.apply.compare import cost, cost_weights
from tuning.apply.known import of_log
from tuning.compute import compiled
from tuning.config.settings import Config
from tuning.ensemble.draws import Between, sample
from tuning.identify.task import task
from tuning.tune.finer import judged
from tuning.tune.problem import pose, requirements
from tuning.tune.rules import faults

SETTINGS = Path(__file__).with_name("days.toml")
DAYS, EACH = 40, 20  # how many by default; every how many something is repaired, and leaps
STEP, FINE = 0.02, 10  # s, between rows of a drive; parts of one that are integrated
LENGTH, HELD = 3000, 40  # rows of a drive, and of a level of its commands
NOISE = (2e-3, 2e-3, 2e-3)  # m, m, rad
SLOTS, STARTS = 12, 32  # of delay lines, the same every day; starts on which tracking is measured
SIDES = [f"deadzone.{wheel}.{{}}_{side}" for wheel in ("left", "right") for side in ("right", "left")]
PLANT = ("plant.track", "plant.time_constant", "plant.acceleration", "plant.drift")
WANDERS = {  # by how much a day, relative (or absolute of the last two), and within which ends
    **{name.format("threshold"): (0.05, 0.02, 0.12) for name in SIDES},
    **{name.format("slope"): (0.005, 0.85, 1.05) for name in SIDES},
    "actuators.left.delay.time": (0.03, 0.04, 0.12),
    "actuators.right.delay.time": (0.03, 0.04, 0.12),
    "plant.track": (0.003, 0.45, 0.55),
    "plant.time_constant": (0.05, 0.08, 0.25),
    "plant.acceleration": (0.03, 0.7, 1.2),
}
DRIFT = 2e-3  # rad/s a day, by which the yaw rate is off anew


def first_day() -> dict[str, float]:
    """The first day."""
    zones = {name.format("threshold"): 0.06 for name in SIDES} | {name.format("slope"): 0.95 for name in SIDES}
    delays = {f"actuators.{wheel}.delay.time": 0.08 for wheel in ("left", "right")}
    plant = {"plant.track": 0.5, "plant.time_constant": 0.15, "plant.acceleration": 1.0, "plant.drift": 0.0}
    return zones | delays | plant


def drifted(truth: Mapping[str, float], day: int, random: np.random.Generator) -> dict[str, float]:
    """The next day: everything wanders; now and then something is repaired or loaded, and leaps within its ends."""
    now = dict(truth)
    for name, (by, low, high) in WANDERS.items():
        now[name] = float(np.clip(now[name] * np.exp(by * random.normal()), low, high))
    now["plant.drift"] = DRIFT * float(random.normal())
    if day % EACH == EACH - 1:
        name = str(random.choice([*WANDERS]))
        now[name] = float(random.uniform(*WANDERS[name][1:]))
    return now


def drive(truth: Mapping[str, float], random: np.random.Generator) -> np.ndarray:
    """Rows t, x, y, heading, v, w: levels of a twist at 50 Hz, every third small, and what a base makes of them."""
    levels = random.uniform([-0.6, -1.2], [0.8, 1.2], (LENGTH // HELD + 1, 2))
    levels[::3] *= 0.25
    sent = np.repeat(levels, HELD, axis=0)[:LENGTH]
    wheels = np.column_stack([sent[:, 0] - 0.25 * sent[:, 1], sent[:, 0] + 0.25 * sent[:, 1]])  # a track of 0.5 m
    h, table = STEP / FINE, np.empty((LENGTH, 6))
    late = [round(truth[f"actuators.{wheel}.delay.time"] / h) for wheel in ("left", "right")]
    x = y = psi = 0.0
    turning = np.zeros(2)
    zones = [[truth[f"deadzone.{wheel}.{part}"] for part in PARTS] for wheel in ("left", "right")]
    for i in range(LENGTH):
        table[i] = (i * STEP, x, y, psi, *sent[i])
        for part in range(FINE):
            at = [(i * FINE + part - one) // FINE for one in late]
            asked = [dead(wheels[k, side] if k >= 0 else 0.0, *zones[side]) for side, k in enumerate(at)]
            rate = (np.array(asked) - turning) / truth["plant.time_constant"]
            middle = turning + h / 2 * np.clip(rate, -truth["plant.acceleration"], truth["plant.acceleration"])
            speed, spin = middle.mean(), (middle[1] - middle[0]) / truth["plant.track"] + truth["plant.drift"]
            half = psi + h / 2 * spin
            x, y, psi = x + h * speed * np.cos(half), y + h * speed * np.sin(half), psi + h * spin
            turning = turning + h * np.clip(rate, -truth["plant.acceleration"], truth["plant.acceleration"])
    table[:, 1:4] += random.normal(0, NOISE, (LENGTH, 3))
    return table


PARTS = ("slope_right", "slope_left", "threshold_right", "threshold_left")


def dead(u: float, right: float, left: float, first: float, last: float) -> float:
    """What a motor driver delivers."""
    return right * max(u - first, 0.0) - left * max(-u - last, 0.0)


class Robot:
    """One robot with its settings, and what tracking truly is: that of this package's base."""

    name, begun, recorded = "base", staticmethod(first_day), staticmethod(drive)
    settings: tuple[str, ...] = ()  # besides those of the file

    def __init__(self, folder: Path) -> None:
        self.config = _alike(configuration.load(["base", str(SETTINGS)], self.settings, faults, note=lambda text: None))
        self.folder, self.model = folder, None
        self.objective = requirements(self.config.tune, self.config.judged())
        nominal = judged(self.config, self.config.controller, self._batch(self.begun()))
        self.budget = self.objective.baseline_of(nominal)
        self.weights = cost_weights(self.objective, self.budget)

    def _batch(self, truth: Mapping[str, float]) -> agvjax.Batch:
        there = self.true(self.config, truth)
        return sample(there.scenario, there.ensemble.draws, STARTS, 0, 600)

    @staticmethod
    def true(config: Config, truth: Mapping[str, float]) -> Config:
        """The configuration with nothing uncertain but the start."""
        known = {name: Between(value, value) for name, value in truth.items()}
        starts = {name: draw for name, draw in config.ensemble.draws.items() if name.startswith("start.")}
        scenario = agvjax.replace(config.scenario, dict(truth))
        return dataclasses.replace(config, scenario=scenario, ensemble=_drawn(config, known | starts))

    def tracking(self, law: agvjax.Law, truth: Mapping[str, float]) -> float:
        """What the goal truly is, 1 where the first gains are on the first day."""
        return float(np.mean(cost(self.weights, judged(self.config, law, self._batch(truth)))))

    def best(self, law: agvjax.Law, truth: Mapping[str, float]) -> agvjax.Law:
        """Gains tuned on the truth."""
        return self.tuned(self.true(self.config, truth), law)

    def tuned(self, config: Config, law: agvjax.Law) -> agvjax.Law:
        """Gains tuned for a configuration from those of a law and from the first ones, by what is compiled once."""
        tuner = pose(dataclasses.replace(config, controller=law)).tuner
        tuner = dataclasses.replace(tuner, compiled=tuner.jacobian, budget=self.budget)
        ends = []
        for start in (law, self.config.controller):
            progress = tuner.begin(tuner.gains.coordinates(start))
            while not tuner.finished(progress):
                progress = tuner.advance(progress)
            ends.append(progress)
        return tuner.best(min(ends, key=lambda end: end.best))

    def day(self, law: agvjax.Law, truth: Mapping[str, float], random: np.random.Generator) -> dict[str, Any]:
        """A day: drive, identify, tune, ask; what that did, and what the truth would have brought."""
        file, begin = self.folder / "day.csv", time.process_time()
        with file.open("w", newline="") as stream:
            csv.writer(stream).writerows(
                [["t", "x", "y", "heading", "cmd_v", "cmd_w"], *self.recorded(truth, random).tolist()]
            )
        config = dataclasses.replace(self.config, controller=law)
        posed = task([str(file)], config)
        self.model = self.model or posed.model  # the same every day: what is compiled serves all
        known = of_log(config, posed._replace(model=self.model), lambda text: None)
        known = known._replace(config=_alike(known.config))
        new = self.tuned(known.config, law)
        identified = time.process_time()
        result = apply(known, law, new)
        best = self.best(law, truth)
        now, tried, perfect = (self.tracking(one, truth) for one in (law, new, best))
        return {
            "accepted": result.decision.accepted,
            "reasons": list(result.decision.reasons),
            "now": now,
            "new": tried,
            "tuned on the truth": perfect,
            "law": new if result.decision.accepted else law,
            "to tune [s]": identified - begin,
            "in all [s]": time.process_time() - begin,
        }


def _drawn(config: Config, draws: Mapping[str, Any]) -> Any:
    return dataclasses.replace(config.ensemble, draws=dict(draws), correlation=None)


def _alike(config: Config) -> Config:
    """Delay lines as long on every day: what is compiled serves all."""
    chains = {
        wheel: agvjax.Chain(delay=agvjax.Delay(time=get(config.scenario, f"actuators.{wheel}.delay.time"), slots=SLOTS))
        for wheel in ("left", "right")
    }
    return dataclasses.replace(config, scenario=dataclasses.replace(config.scenario, actuators=chains))


def measure(days: int = DAYS, hours: float = np.inf, seed: int = 0, kind: type[Robot] = Robot) -> list[dict[str, Any]]:
    """A row: what was accepted on so many days, or in so many hours, and what of it was good."""
    jax.config.update("jax_enable_x64", True)
    compiled.keep_compiled()
    agvjax.tune_xla()
    random, truth, rows, begin = np.random.default_rng(seed), kind.begun(), [], time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        robot = kind(Path(folder))
        first = law = once = robot.config.controller
        while len(rows) < days and time.perf_counter() - begin < 3600 * hours:
            truth = drifted(truth, len(rows), random)
            row = robot.day(law, truth, random) | {"never changed": robot.tracking(first, truth)}
            law = row.pop("law")
            once = once if rows else law
            rows.append(row | {"changed once": robot.tracking(once, truth)})
            how = "accepted" if row["accepted"] else f"refused: {'; '.join(row['reasons'])[:90]}"
            numbers = ", ".join(f"{name} {x:.3f}" for name, x in rows[-1].items() if isinstance(x, float))
            print(f"day {len(rows)}: {numbers}, {how}", flush=True)
    return [
        {"robot": kind.name} | told(rows) | {"hours": round((time.perf_counter() - begin) / 3600, 2), "asked for": days}
    ]


def told(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """What days come to: changes, those that made tracking worse, and shares of what the truth would have brought."""
    accepted = [row["new"] / row["now"] for row in rows if row["accepted"]]
    refused = [row["new"] / row["now"] for row in rows if not row["accepted"]]
    kept = np.mean([row["new"] if row["accepted"] else row["now"] for row in rows])
    goals = {name: np.mean([row[name] for row in rows]) for name in ("never changed", "changed once")}
    best = np.mean([row["tuned on the truth"] for row in rows])
    return {
        "days": len(rows),
        "accepted": len(accepted),
        "accepted, worse by more than 5 %": sum(ratio > 1.05 for ratio in accepted),
        "worst accepted": max(accepted, default=1.0),
        "refused, worse by more than 5 %": sum(ratio > 1.05 for ratio in refused),
        "worst refused": max(refused, default=1.0),
        **{f"goal, {name}": float(goal) for name, goal in goals.items()},
        "goal, by apply": float(kept),
        "goal, tuned on the truth": float(best),
        **{f"share of what the truth brings over {name}": float((g - kept) / (g - best)) for name, g in goals.items()},
    }
