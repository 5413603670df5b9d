"""Gains judged at the step of `simulate`, on the scenarios tuned on and on others; and limits that fail only there.

Where a limit is met at the step of tuning and not at the finer one, its bound is tightened by as much as it is exceeded
and a little more, and the search goes on. The coarser step errs by nearly the same at neighbouring gains.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax
import numpy as np
from jax.typing import ArrayLike

import agvjax
from agvjax.margins import with_margins
from agvjax.metric_table import METRICS

from ..compute import processes as distributed
from ..config.settings import Config
from ..ensemble.draws import sample
from .methods.objective import FEASIBLE, TOLERANCE
from .problem import TuningProblem

TURNS = 3  # times that bounds are tightened, at most


def judged(
    config: Config, controller: agvjax.Law, batch: agvjax.Batch, compiled: Callable[..., agvjax.Metrics] | None = None
) -> agvjax.Metrics:
    """Metrics at the step of `simulate`, which is finer than that of tuning; by what was `compiled` before, if it was.

    That is for `judgement` of a batch of this size.
    """
    timing, criteria, law = config.timing(), _criteria(config), agvjax.check(controller)
    if compiled is None:
        evaluate = distributed.gathered(lambda *given: _evaluated(config, *given))
        metrics = evaluate(law, batch, criteria, timing.dt)
    else:
        metrics = compiled(*jax.tree.leaves((law, batch, criteria, timing.dt)))
    return jax.tree.map(np.asarray, with_margins(metrics, law, batch, timing=timing, criteria=criteria))


def judgement(
    config: Config, controller: agvjax.Law, batch: agvjax.Batch
) -> tuple[Callable[..., agvjax.Metrics], list[ArrayLike]]:
    """What `judged` computes, as a function of plain arrays, and these."""
    example = (agvjax.check(controller), batch, _criteria(config), config.timing().dt)
    parts, structure = jax.tree.flatten(example)
    return lambda *parts: _evaluated(config, *jax.tree.unflatten(structure, parts)), parts


def _criteria(config: Config) -> agvjax.Criteria:
    loop = any(METRICS[name].loop for name in config.tune.limits)
    return config.judged(smooth=True, delivered=True, loop=loop)


def _evaluated(
    config: Config, law: agvjax.Law, batch: agvjax.Batch, criteria: agvjax.Criteria, dt: ArrayLike
) -> agvjax.Metrics:
    return agvjax.evaluate(law, batch, criteria=criteria, **{**config.timing(), "dt": dt})


def validation(config: Config) -> agvjax.Batch:
    """Scenarios that no tuning sees."""
    return sample(config.scenario, config.ensemble.draws, config.ensemble.validation_size, config.seed + 1)


def seen_and_unseen(problem: TuningProblem) -> tuple[agvjax.Batch, agvjax.Batch]:
    """The tuning scenarios with the validation scenarios behind them, and these alone."""
    config, seen, unseen = problem.config, problem.tuner.batch, validation(problem.config)
    values = {n: np.concatenate([seen.values[n], unseen.values[n]]) for n in seen.names}
    return agvjax.batch(config.scenario, values), unseen


def before_and_after(problem: TuningProblem, controller: agvjax.Law) -> tuple[agvjax.Metrics, agvjax.Metrics]:
    """Metrics of `seen_and_unseen` with the starting gains and with a controller."""
    return judged_with(problem, problem.config.controller), judged_with(problem, controller)


def judged_with(problem: TuningProblem, controller: agvjax.Law) -> agvjax.Metrics:
    """Metrics of `seen_and_unseen` with a controller."""
    return judged(problem.config, controller, seen_and_unseen(problem)[0], problem.judgement)


def baseline_of(problem: TuningProblem, before: agvjax.Metrics) -> np.ndarray:
    """The statistics (3, M) that limits are multiples of: of the starting gains, or the budget that was set."""
    objective, budget = problem.tuner.objective, problem.tuner.budget
    return objective.baseline_of(before) if budget is None else budget


def levels(problem: TuningProblem, metrics: tuple[agvjax.Metrics, agvjax.Metrics]) -> np.ndarray:
    """Of the limits (L,) at the finer step on the scenarios tuned on, as of `Objective.levels`: 1 at the bound.

    None (0,) where every run of the start diverges, of which limits are multiples.
    """
    objective, seen = problem.tuner.objective, slice(None, problem.tuner.batch.size)
    before, after = (jax.tree.map(lambda x: x[seen], m) for m in metrics)
    if not objective.limits or not np.asarray(before.ok).any():
        return np.zeros(0)
    return np.asarray(objective.levels_of(after, baseline_of(problem, before))[len(objective.goals) :])


def tighter(
    problem: TuningProblem, metrics: tuple[agvjax.Metrics, agvjax.Metrics], factors: np.ndarray | None
) -> np.ndarray | None:
    """What bounds are to be multiplied by (L,) so that limits hold at the finer step; None where they do.

    Args:
        problem: with the bounds that were asked for.
        metrics: as of `before_and_after`, with gains that meet the limits at the step of tuning.
        factors: what bounds were multiplied by in the search for them; None for 1.
    """
    over, objective = levels(problem, metrics), problem.tuner.objective
    if not np.any(over > 1 + TOLERANCE):
        return None
    old = np.ones(over.size) if factors is None else factors
    below = np.array([r.least for r in objective.limits])
    factors = np.where(below, old * (over + FEASIBLE), old * (1 - FEASIBLE) / over)
    return np.where(over > 1 + TOLERANCE, factors, old)


def tightened(problem: TuningProblem, factors: np.ndarray | None) -> TuningProblem:
    """The problem with the bounds of its limits multiplied by `factors` (L,); what is compiled is kept."""
    if factors is None:
        return problem
    tuner = problem.tuner
    limits = [r._replace(value=r.value * float(f)) for r, f in zip(tuner.objective.limits, factors, strict=True)]
    objective = tuner.objective._replace(limits=tuple(limits))
    compiled = tuner.pushed if tuner.forward else None
    tuner = dataclasses.replace(tuner, objective=objective, budget=tuner.baseline, compiled=compiled)
    return problem._replace(tuner=tuner)
