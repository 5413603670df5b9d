"""From a configuration to a tuning problem: ensemble, gains with their bounds, requirements; checked on the way."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import numpy as np
from scipy.stats import qmc

import agvjax
from agvjax.check import Fault, InputError
from agvjax.leaves import rule_of

from ..config import check
from ..config.settings import Config, Tune
from ..ensemble.draws import sample
from ..ensemble.worst import Adversary, batch_of
from .gains import Free, default_bounds, stability_bounds, tie
from .objective import STATISTICS, Objective, Requirement
from .rules import faults
from .tuner import Tuner


class Posed(NamedTuple):
    """A tuning problem, ready to be solved."""

    config: Config
    tuner: Tuner  # on the ensemble, with empty places for what the search adds
    adversary: Adversary
    stability: dict[str, float]  # what the gains must exceed by the law's own conditions

    def to(self, budget: Any) -> Posed:
        """The problem with goals and limits in multiples of a reference that is given."""
        return self._replace(tuner=dataclasses.replace(self.tuner, budget=budget))


def pose(config: Config) -> Posed:
    """The tuning problem of a configuration.

    Raises:
        agvjax.InputError: a gain does not begin inside its bounds, a scenario that breaks a rule was drawn, or the
            optimiser cannot be driven by a cost and its gradient.
    """
    config = check(config, faults)
    settings, draws, timing = config.tune, config.ensemble.draws, config.timing("tune")
    conditions = stability_bounds(config.controller, config.scenario, draws)
    stability = {name: settings.stability_margin * bound for name, bound in conditions.items()}
    free = _free(config, stability, timing)
    batch = sample(config.scenario, draws, config.ensemble.size, config.seed)
    found = free.faults(config.controller) + _drawn(batch)
    if found:
        raise InputError(found)
    objective = requirements(settings)
    metrics = searched(objective)
    slots = settings.search.rounds * len(metrics)  # a round may add one for each
    tuner = Tuner(
        controller=config.controller,
        batch=batch_of(batch, {}, slots),
        free=free,
        objective=objective._replace(weights=np.r_[np.ones(batch.size), np.zeros(slots)] if slots else None),
        timing=timing,
        fresh=_stream(config) if config.ensemble.fresh else None,
        **{name: getattr(settings, name) for name in _SHARED},
    )
    search = settings.search
    adversary = Adversary(
        rollout=tuner.values,
        names=objective.names,
        scenario=config.scenario,
        draws=draws,
        metrics=metrics,
        seed=config.seed,
        **{name: getattr(search, name) for name in ("scouts", "starts", "iterations", "checks")},
    )
    if not tuner.sequential:
        try:
            jax.eval_shape(tuner.try_update, free.coordinates(config.controller))
        except Exception as error:  # optax and its optimisers raise whatever they meet
            rule = f"an optimiser of optax that needs no more than a cost, its gradient and these options ({error})"
            raise InputError([Fault("tune.optimizer", settings.optimizer, rule)]) from error
    return Posed(config, tuner, adversary, stability)


_SHARED = ("iterations", "optimizer", "learning_rate", "options", "clip", "patience", "gradient")


def requirements(settings: Tune) -> Objective:
    """Goals and limits as the tuner has them."""
    goals = [
        Requirement(metric, s, getattr(w, s))
        for metric, w in settings.goals.items()
        for s in STATISTICS
        if getattr(w, s)
    ]
    limits = [
        Requirement(metric, s, getattr(limit, s), limit.absolute)
        for s in STATISTICS
        for metric, limit in settings.limits.items()
        if np.isfinite(getattr(limit, s))
    ]
    return Objective(tuple(goals), tuple(limits), settings.penalty, tail=settings.tail)


def searched(objective: Objective) -> tuple[str, ...]:
    """The metrics whose worst case matters: those with a goal or limit on it, or else those of the goals."""
    worst = [r.metric for r in objective.requirements if r.statistic == "worst"]
    return tuple(dict.fromkeys(worst or [r.metric for r in objective.goals]))


def starts(posed: Posed) -> list[Any]:
    """Where the searches start, in free coordinates: at the configured gains, then Sobol points about them."""
    config, free = posed.config, posed.tuner.free
    middle = free.coordinates(config.controller)
    more = config.tune.starts - 1
    if not more:
        return [middle]
    points = qmc.Sobol(len(free.names), scramble=False).random_base2(int(np.ceil(np.log2(more + 1))))[1 : more + 1]
    points = (points + np.random.default_rng(config.seed).random(len(free.names))) % 1
    shift = np.log(config.tune.spread) * (2 * points - 1)
    return [middle, *(middle + jax.numpy.asarray(row, middle.dtype) for row in shift)]


def _free(config: Config, stability: Mapping[str, float], timing: agvjax.Timing) -> Free:
    settings, law = config.tune, config.controller
    names = (*settings.gains, *settings.tied)
    slowest = max(settings.dt, 1 / settings.sample_rate) if settings.sample_rate else settings.dt
    bounds = default_bounds(law, names, stability, slowest, timing.integrator)
    for name, (low, high) in settings.bounds.items():
        if rule_of(law, name) is not None:  # a gain without a rule may go wherever the user says
            low, high = max(low, bounds[name][0]), min(high, bounds[name][1])
        bounds[name] = (low, high)
    tied = tie(law, settings.tied, bounds, {name: bounds[name] for name in settings.tied})
    lower, upper = (np.array([bounds[name][side] for name in settings.gains]) for side in (0, 1))
    return Free(settings.gains, lower, upper, tied)


def _drawn(batch: agvjax.Batch) -> list[Fault]:
    """Draws that broke the rule of their leaf."""
    bad = []
    for name, values in batch.values.items():
        rule, array = rule_of(batch.scenario, name), np.asarray(values)
        if rule is None:
            continue
        broken = ~np.asarray(rule.holds(array))
        if broken.any():
            text = f"drawn so that every value is {rule.text}: {int(broken.sum())} of {broken.size} are not"
            bad.append(Fault(f"ensemble.draws.{name}", float(array[broken][0]), text))
    return bad


def _stream(config: Config) -> Any:
    """Scenarios of iteration i, drawn anew."""

    def fresh(iteration: int) -> dict[str, Any]:
        drawn = sample(config.scenario, config.ensemble.draws, config.ensemble.size, config.seed, 1_000 + iteration)
        return {name: np.asarray(value) for name, value in drawn.values.items()}

    return fresh


def with_added(posed: Posed, added: Mapping[str, Any]) -> Posed:
    """The problem with scenarios that the search found in the places kept for them; what is compiled is kept too."""
    config, tuner = posed.config, posed.tuner
    own = sample(config.scenario, config.ensemble.draws, config.ensemble.size, config.seed)
    batch = batch_of(own, added, tuner.batch.size - own.size)
    tuner = dataclasses.replace(tuner, batch=batch, prepared=tuner.push if tuner.forward else None)
    return posed._replace(tuner=tuner)
