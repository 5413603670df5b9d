"""From a configuration to a tuning problem: ensemble, gains with their bounds, requirements; checked on the way."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array

import agvjax
from agvjax.check import Fault, InputError
from agvjax.leaves import rule_of

from ..config import check
from ..config.settings import Config, Tune
from ..ensemble.draws import sample
from ..ensemble.sobol import sobol
from ..ensemble.worst import Adversary, batch_of
from .gains import Gains, own
from .methods.objective import STATISTICS, Objective, Requirement
from .rules import faults
from .screen import Screen
from .tuner import Tuner


class TuningProblem(NamedTuple):
    """A tuning problem, ready to be solved."""

    config: Config
    tuner: Tuner  # on the ensemble, with empty places for what the search for the worst adds
    adversary: Adversary
    screen: Screen | None = None  # what looks at many gain sets before the search
    first: tuple[str, ...] = ()  # gains that are tuned before the others may move; (): all at once
    judgement: Callable[..., agvjax.Metrics] | None = None  # of `finer.judged`, compiled before

    @property
    def moving(self) -> np.ndarray:
        """Which gains (K,) move in the first searches."""
        return np.array([not self.first or name in self.first for name in self.tuner.gains.names])


def pose(config: Config) -> TuningProblem:
    """The tuning problem of a configuration, completed and checked; nothing is run.

    Raises:
        agvjax.InputError: a value breaks a rule, a name names nothing, a gain does not begin inside its bounds, or a
            scenario that breaks a rule was drawn.
    """
    config = check(config, faults)
    settings, ensemble = config.tune, config.ensemble
    gains = Gains.of(config)
    batch = sample(config.scenario, ensemble.draws, ensemble.size, config.seed)
    if wrong := gains.faults(config.controller) + _drawn(batch):
        raise InputError(wrong)
    objective = requirements(settings, config.judged())
    metrics = searched(objective)
    slots = settings.search.rounds * len(metrics)  # a round may add one for each
    tuner = Tuner(
        controller=config.controller,
        batch=batch_of(batch, {}, slots),
        gains=gains,
        objective=objective._replace(weights=np.r_[np.ones(batch.size), np.zeros(slots)] if slots else None),
        settings=settings,
        timing=config.timing("tune"),
        fresh=functools.partial(_fresh, config) if ensemble.fresh else None,
    )
    adversary = Adversary(
        rollout=tuner.values,
        names=objective.of_runs().names,
        scenario=config.scenario,
        draws=ensemble.draws,
        metrics=metrics,
        settings=settings.search,
        seed=config.seed,
    )
    mine = own(config) if isinstance(settings.gains, str) else None
    screen = Screen(tuner, ensemble.size, config.seed, moved=mine) if settings.screen else None
    first = mine if mine is not None and tuner.method.jacobian else ()
    return TuningProblem(config, tuner, adversary, screen, first)


def requirements(settings: Tune, judged: agvjax.Criteria) -> Objective:
    """Goals and limits as the tuner has them, and how runs are judged."""
    weights = [(metric, s, getattr(w, s)) for metric, w in settings.goals.items() for s in STATISTICS]
    goals = [Requirement(*weight) for weight in weights if weight[2]]
    limits = [
        Requirement(metric, s, getattr(limit, s), limit.absolute, limit.least)
        for s in STATISTICS
        for metric, limit in settings.limits.items()
        if np.isfinite(getattr(limit, s))
    ]
    return Objective(tuple(goals), tuple(limits), settings.penalty, tail=settings.tail, judged=judged)


def searched(objective: Objective) -> tuple[str, ...]:
    """The metrics whose worst case matters: those with a goal or limit on it, or else those of the goals.

    Limits from below, and those on the linearised loop, are not among them: they are kept on the ensemble alone.
    """
    worst = [r.metric for r in objective.of_runs().requirements if r.statistic == "worst" and not r.least]
    return tuple(dict.fromkeys(worst or [r.metric for r in objective.goals]))


def starts(problem: TuningProblem) -> list[Array]:
    """Where the searches start without a screening: at the configured gains, then Sobol points about them."""
    config, gains = problem.config, problem.tuner.gains
    middle = gains.coordinates(config.controller)
    more = config.tune.starts - 1
    if not more:
        return [middle]
    shift = np.log(config.tune.spread) * (2 * sobol(more, len(gains.names), config.seed) - 1)
    return [middle, *(middle + jax.numpy.asarray(row, middle.dtype) for row in shift)]


def _drawn(batch: agvjax.Batch) -> list[Fault]:
    """Draws that broke the rule of their leaf."""
    refused = []
    for name, values in batch.values.items():
        rule, array = rule_of(batch.scenario, name), np.asarray(values)
        if rule is not None and (broken := ~np.asarray(rule.holds(array))).any():
            text = f"drawn so that every value is {rule.text}: {int(broken.sum())} of {broken.size} are not"
            refused.append(Fault(f"ensemble.draws.{name}", float(array[broken][0]), text))
    return refused


def _fresh(config: Config, iteration: int) -> dict[str, np.ndarray]:
    """Scenarios of an iteration, drawn anew."""
    batch = sample(config.scenario, config.ensemble.draws, config.ensemble.size, config.seed, 1_000 + iteration)
    return {name: np.asarray(value) for name, value in batch.values.items()}


def with_added(problem: TuningProblem, added: Mapping[str, np.ndarray]) -> TuningProblem:
    """The problem with scenarios that the search found in the places kept for them; what is compiled is kept too."""
    config, tuner = problem.config, problem.tuner
    own = sample(config.scenario, config.ensemble.draws, config.ensemble.size, config.seed)
    batch = batch_of(own, added, tuner.batch.size - own.size)
    tuner = dataclasses.replace(tuner, batch=batch, compiled=tuner.pushed if tuner.forward else None)
    return problem._replace(tuner=tuner)


def in_units_of(problem: TuningProblem, z: np.ndarray) -> TuningProblem:
    """The problem with goals and limits as multiples of what the gains at z achieve, if those are not the start's."""
    tuner = problem.tuner
    middle = np.asarray(tuner.gains.coordinates(tuner.controller))
    if tuner.budget is not None or np.array_equal(z, middle):
        return problem
    budget = tuner.objective.baseline(*tuner.judged(jax.numpy.asarray(z, middle.dtype)))
    compiled = tuner.pushed if tuner.forward else None
    return problem._replace(tuner=dataclasses.replace(tuner, budget=budget, compiled=compiled))
