"""Both sets of gains on the same vehicles, and on the worst ones that are found."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import agvjax
from agvjax.leaves import swap

from ..config.settings import Config
from ..ensemble.draws import sample
from ..ensemble.worst import Adversary
from ..tune.finer import judged
from ..tune.methods.objective import Objective
from ..tune.problem import requirements
from ..tune.tuner import BLOCK
from .decision import Limited

PART = 500  # of the random numbers: other vehicles than those that were tuned, searched and validated on
RUN = ("start.", "disturbance.phase")  # what differs from run to run, and is no part of a vehicle


class Compared(NamedTuple):
    """Metrics and costs with the current gains, then with the new ones."""

    objective: Objective
    metrics: tuple[agvjax.Metrics, agvjax.Metrics]  # of all runs
    costs: np.ndarray  # (2, n), of n vehicles, means over their runs; infinite where one diverges
    worst: np.ndarray  # (2, k), of the worst vehicles that were found, of the current gains and of the new ones
    found: list[dict[str, np.ndarray]]  # their leaves
    limits: list[Limited]


def compare(config: Config, current: agvjax.Law, new: agvjax.Law, tick: Callable[[str], object]) -> Compared:
    """Simulate the gains on vehicles that the ensemble draws, the same for both, and search for the worst of each.

    Raises:
        RuntimeError: every run diverges with the current gains.
    """
    settings, batch = config.apply, drawn(config)
    before, after = _judged(config, current, batch, tick), _judged(config, new, batch, tick)
    objective = requirements(config.tune, config.judged())
    baseline = objective.baseline_of(before)
    weights = cost_weights(objective, baseline)
    runs = np.stack([cost(weights, metrics) for metrics in (before, after)])
    costs = runs.reshape(2, settings.vehicles, -1).mean(axis=2)  # a vehicle that diverges once has no finite one
    levels = [objective.levels_of(metrics, baseline)[len(objective.goals) :] for metrics in (before, after)]
    limits = [Limited(r.name, float(a), float(b)) for r, a, b in zip(objective.limits, *levels, strict=True)]
    found, worst = _searched(config, (current, new), objective, weights, tick)
    for i in range(len(found)):  # what was drawn may be worse than what the search found
        at = int(np.argmax(runs[i]))
        if runs[i, at] > worst[i, i]:
            worst[:, i] = runs[:, at]
            found[i] = {name: np.asarray(value)[at] for name, value in batch.values.items()}
    return Compared(objective, (before, after), costs, worst, found, limits)


def vehicles_differ(config: Config) -> bool:
    """Whether the ensemble draws anything of the vehicle, and not only where its runs begin."""
    return any(not name.startswith(RUN) for name in config.ensemble.draws)


def drawn(config: Config) -> agvjax.Batch:
    """Vehicles as the ensemble draws them, each from the same starts and phases: those of a vehicle side by side."""
    asked, values = config.apply, {}
    own, run = ({n: d for n, d in config.ensemble.draws.items() if n.startswith(RUN) == kind} for kind in (False, True))
    count = asked.starts if run else 1
    if own:
        vehicles = sample(config.scenario, own, asked.vehicles, config.seed, PART).values
        values |= {name: np.repeat(np.asarray(value), count, axis=0) for name, value in vehicles.items()}
    if run:
        starts = sample(config.scenario, run, count, config.seed, PART).values
        values |= {n: np.tile(x, (asked.vehicles, *[1] * (np.ndim(x) - 1))) for n, x in starts.items()}
    return agvjax.batch(config.scenario, values)


def _searched(
    config: Config,
    laws: tuple[agvjax.Law, agvjax.Law],
    objective: Objective,
    weights: Mapping[str, float],
    tick: Callable[[str], object],
) -> tuple[list[dict[str, np.ndarray]], np.ndarray]:
    """The worst vehicle for each of the laws, and what either costs there (2, 2)."""
    adversary, found = _adversary(config, objective, weights), []
    for law in laws:
        found.append(adversary.search(agvjax.check(law))[0].scenario)
        tick("searched for the worst")
    both = agvjax.batch(config.scenario, {name: np.stack([one[name] for one in found]) for name in found[0]})
    return found, np.stack([cost(weights, judged(config, law, both)) for law in laws])


def _judged(config: Config, law: agvjax.Law, batch: agvjax.Batch, tick: Callable[[str], object]) -> agvjax.Metrics:
    metrics = judged(config, law, batch)
    tick("simulated")
    return metrics


def cost_weights(objective: Objective, baseline: np.ndarray) -> dict[str, float]:
    """By metric its weight in the cost of one vehicle: that of the goals, by what the current gains have on average.

    Args:
        objective: whose goals.
        baseline: (3, M), statistics with the current gains.
    """
    weights: dict[str, float] = {}
    for goal in objective.goals:
        unit = float(baseline[0, objective.names.index(goal.column)])
        weights[goal.metric] = weights.get(goal.metric, 0.0) + goal.value / unit
    total = sum(goal.value for goal in objective.goals)
    return {metric: weight / total for metric, weight in weights.items()}


def cost(weights: Mapping[str, float], metrics: agvjax.Metrics) -> np.ndarray:
    """The weighted sum of the goals' metrics of every vehicle, infinite where a run diverges.

    1 is what the current gains have on average.
    """
    total = sum(weight * np.asarray(metrics[name], float) for name, weight in weights.items())
    return np.where(np.asarray(metrics.ok), total, np.inf)


def _adversary(config: Config, objective: Objective, weights: Mapping[str, float]) -> Adversary:
    """The search for the vehicle of the highest cost; what it moves is the law."""
    ask, scenario = config.tune.search, agvjax.check(config.scenario)
    criteria = agvjax.Criteria.of(tuple(weights), sloped=True, like=objective.judged)

    def rollout(law: agvjax.Law, leaves: Mapping[str, Array]) -> tuple[Array, Array]:
        batch = agvjax.Batch(scenario=swap(scenario, dict(leaves)), names=tuple(leaves))
        dtype = jnp.result_type(float).type
        timing = config.timing("tune")
        metrics = agvjax.evaluate(law, batch, criteria=criteria, dtype=dtype, block=BLOCK, **timing)
        return jnp.stack([sum(weight * metrics[name] for name, weight in weights.items())]), metrics.ok

    scouts = max(config.apply.samples, ask.starts)
    settings = dataclasses.replace(ask, scouts=scouts, checks=0)  # the vehicles that were drawn are checks enough
    draws = config.ensemble.draws
    found = Adversary(rollout, ("cost",), scenario, draws, ("cost",), settings, config.seed)
    return dataclasses.replace(found, compiled=(found.climb, found.look))  # `evaluate` is compiled, once for all logs
