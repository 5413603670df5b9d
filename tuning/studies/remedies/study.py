"""Which remedy is worth what: each tuned by the same tuner, on the same vehicles, within the same command budget.

Limits and goals are multiples of what the configured law needs and reaches with its starting gains and without any
remedy. All are judged on vehicles that none was tuned on, the same ones, with noise in what is measured and without.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import numpy as np

import agvjax

from ...compute.pairs import in_pairs
from ...config.settings import Config
from ...ensemble.draws import Between, sample
from ...io.kept import Kept
from ...tune.caveats import excesses
from ...tune.problem import TuningProblem, pose
from ..laws.followers import Searched, search
from .knowing import Knowing, knowing, values_of
from .limits import budgeted
from .remedies import WRONG, Known, Remedies, Remedy, deadzones, period_of, remedies, truths

PLACES = 2  # best places of the look at many gain sets to search from, besides the remedy's own gains
NOISE = agvjax.Noise(heading=2e-3, yaw_rate=4e-3)  # where a configuration has no sensor: 2 mm, 4 mm/s, 2 and 4 mrad(/s)
SEEDS = Between(0.0, 1e6)
CONDITIONS = (False, True)  # with noise


class Judged(NamedTuple):
    """A remedy before and after tuning, on vehicles that were not tuned on; metrics without noise and with."""

    remedy: Remedy
    controller: agvjax.Law  # with the best gains
    gains: tuple[str, ...]
    found: Searched
    over: list[str]  # limits that are exceeded there, each with by how much
    before: tuple[agvjax.Metrics, agvjax.Metrics]
    after: tuple[agvjax.Metrics, agvjax.Metrics]
    use: float  # of the limits there the largest share, 1 at its bound


class Study:
    """The problem of each remedy, with goals and limits in the same units."""

    def __init__(self, config: Config):
        self.config = budgeted(config)

    @property
    def tuned_with_noise(self) -> bool:
        """Whether what is measured is noisy when gains are tuned: where the configuration has a sensor."""
        return self.config.scenario.sensor is not None

    @property
    def period(self) -> float:
        """Period [s] of the computer of the adaptive inverse."""
        given = self.config.controller
        return float(given.period) if isinstance(given, agvjax.Sampled) else period_of(self.config)

    def sensor(self, noise: bool) -> agvjax.Sensor | None:
        """The configured one, or `NOISE`; without noise none, or the same with nothing."""
        own = self.config.scenario.sensor
        given = NOISE if own is None else own
        if noise:
            return given
        still = {"position": 0.0, "velocity": 0.0, "heading": 0.0, "yaw_rate": 0.0}
        return dataclasses.replace(given, **still) if isinstance(given, agvjax.Noise) else None

    @functools.cached_property
    def remedies(self) -> Remedies:
        """All that there are."""
        sensor = self.sensor(True)
        noise = float(np.max(sensor.velocity)) if isinstance(sensor, agvjax.Noise) else 0.0
        return remedies(self.config, noise)

    @functools.cached_property
    def batches(self) -> tuple[agvjax.Batch, agvjax.Batch]:
        """The vehicles that no remedy is tuned on, without noise and with."""
        sizes, made = self.config.ensemble, []
        for noise in CONDITIONS:
            scenario = dataclasses.replace(self.config.scenario, sensor=self.sensor(noise))
            draws = {n: d for n, d in sizes.draws.items() if noise or not n.startswith("sensor.")}
            if isinstance(scenario.sensor, agvjax.Noise):
                draws["sensor.seed"] = SEEDS
            made.append(sample(scenario, draws, sizes.validation_size, self.config.seed + 1))
        return made[0], made[1]

    def judge(self, law: agvjax.Law, known: dict[str, Known]) -> tuple[agvjax.Metrics, agvjax.Metrics]:
        """Metrics without noise and with, at the step of `simulate`."""
        criteria, timing = self.config.judged(smooth=True, delivered=True), self.config.timing()
        runs = []
        for batch in self.batches:
            drawn = {name: np.asarray(value) for name, value in batch.values.items()}
            laws = knowing(agvjax.check(law), values_of(known, drawn))
            runs.append(jax.tree.map(np.asarray, agvjax.evaluate(laws, batch, criteria=criteria, **timing)))
        return runs[0], runs[1]

    def posed(self, remedy: Remedy) -> TuningProblem:
        """The tuning problem of a remedy, in units of its own starting gains."""
        tune = dataclasses.replace(self.config.tune, gains=remedy.gains)
        problem = pose(dataclasses.replace(self.config, controller=remedy.law, tune=tune))
        if not remedy.known:
            return problem
        fields = {f.name: getattr(problem.tuner, f.name) for f in dataclasses.fields(problem.tuner)}
        return problem._replace(tuner=Knowing(**fields, known=remedy.known))

    @functools.cached_property
    def budget(self) -> np.ndarray:
        """(3, M): statistics of goals and limits without a remedy, with the starting gains, when tuned on."""
        tuner = self.posed(self.remedies.found["nothing"]).tuner
        return tuner.objective.baseline(*tuner.roll(tuner.gains.coordinates(tuner.controller), tuner.scenarios()))

    @functools.cached_property
    def unseen_budget(self) -> np.ndarray:
        """The same on the vehicles that none is tuned on."""
        nothing = self.remedies.found["nothing"]
        objective = self.posed(nothing).tuner.objective._replace(weights=None)
        metrics = self.judge(nothing.law, {})[self.tuned_with_noise]
        return objective.baseline_of(metrics)

    def tune(self, name: str, remedy: Remedy, kept: Kept[Searched]) -> Judged:
        """The best gains that searches find, and what they are worth."""
        problem, known = self.posed(remedy), dict(remedy.known)
        key, tuner = f"known: {sorted(known)}" if known else "", problem.tuner
        found = kept.once(name, lambda: search(problem, self.budget, PLACES, key))
        law = tuner.gains.controller(jax.numpy.asarray(found.z), tuner.controller).canonical()
        before, after = self.judge(remedy.law, known), self.judge(law, known)
        objective = problem.tuner.objective._replace(weights=None)
        metrics = after[self.tuned_with_noise]
        levels = objective.levels_of(metrics, self.unseen_budget)[len(objective.goals) :]
        over = excesses(objective, metrics, self.unseen_budget)
        return Judged(remedy, law, tuner.gains.names, found, over, before, after, float(np.max(levels)))

    def mistaken(self, identified: Judged) -> dict[str, agvjax.Metrics]:
        """The inverse tuned with each vehicle's own deadzone, then run with wrong thresholds; no noise."""
        zones = deadzones(self.config)
        return {name: self.judge(identified.controller, truths(zones, factor))[0] for name, factor in WRONG.items()}


def compare(
    study: Study, kept: Kept[Searched], done: Callable[[str], None]
) -> tuple[dict[str, Judged], dict[str, agvjax.Metrics]]:
    """Tune and judge every remedy, two at a time; `done(name)` is called as each is ready, `kept` is what was found.

    Returns:
        Every remedy, and what it costs to be mistaken after tuning.
    """
    _ = study.budget, study.unseen_budget, study.batches  # before there are threads
    done("the budget")

    def one(item: tuple[str, Remedy]) -> tuple[str, Judged]:
        found = study.tune(*item, kept)
        done(item[0])
        return item[0], found

    judged = dict(in_pairs(one, study.remedies.found.items()))
    wrong = study.mistaken(judged["identified"]) if "identified" in judged else {}
    done("wrong thresholds")
    return judged, wrong
