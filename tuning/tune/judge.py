"""Are the gains any good? Judged at the finer step, on scenarios seen and unseen."""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import jax
import numpy as np

import agvjax
from agvjax.metric_table import METRICS

from ..compute import processes as distributed
from ..config.settings import Config
from ..ensemble.draws import sample
from . import analysis
from .analysis import Findings
from .problem import TuningProblem
from .rounds import Outcome
from .tuner import TOLERANCE


class Summary(NamedTuple):
    """Mean and worst of every metric over an ensemble, of the runs that did not diverge, and how many did."""

    mean: dict[str, float]
    worst: dict[str, float]
    latched: int
    unsettled: int
    size: int
    worst_index: int  # scenario with the largest error


class TuneVerdict(NamedTuple):
    """What tuned gains are worth, on scenarios seen and unseen."""

    before: dict[str, Summary]  # on "tuning" and "validation" scenarios
    after: dict[str, Summary]
    findings: Findings
    over: list[str]  # limits that are not met, each with by how much
    conflict: list[str]  # those that cannot be kept together
    worst: agvjax.Scenario  # the validation scenario with the largest error of the tuned gains

    @property
    def failure(self) -> str:
        """Why the gains are not what was asked for, in a sentence; empty where they are."""
        return " ".join(["limits not met:", "; ".join(self.over) + ".", *self.conflict]) if self.over else ""


def judged(config: Config, controller: Any, batch: agvjax.Batch) -> agvjax.Metrics:
    """Metrics at the step of `simulate`, which is finer than that of tuning."""
    criteria = agvjax.Criteria(smooth=True, delivered=True)
    evaluate = functools.partial(agvjax.evaluate, criteria=criteria, **config.timing())
    return jax.tree.map(np.asarray, distributed.gathered(evaluate)(agvjax.check(controller), batch))


def judge(outcome: Outcome) -> TuneVerdict:
    """The gains before and after on both ensembles, what can be learned, and whether the limits are met."""
    problem, config = outcome.problem, outcome.problem.config
    seen = problem.tuner.batch
    both, unseen = seen_and_unseen(problem)
    parts = {"tuning": slice(None, config.ensemble.size), "validation": slice(seen.size, None)}
    metrics = [judged(config, law, both) for law in (config.controller, outcome.controller)]
    before, after = (
        {part: summary(jax.tree.map(lambda x, s=s: x[s], m)) for part, s in parts.items()} for m in metrics
    )
    over = unmet(problem, *(jax.tree.map(lambda x: x[: seen.size], m) for m in metrics))
    z = outcome.progress.best_z
    conflict = _conflict(problem, z) if over else []
    worst = unseen[after["validation"].worst_index]
    return TuneVerdict(before, after, analysis.analyse(problem.tuner, z), over, conflict, worst)


def validation(config: Config) -> agvjax.Batch:
    """Scenarios that no tuning sees."""
    return sample(config.scenario, config.ensemble.draws, config.ensemble.validation_size, config.seed + 1)


def seen_and_unseen(problem: TuningProblem) -> tuple[agvjax.Batch, agvjax.Batch]:
    """The tuning scenarios with the validation scenarios behind them, and these alone."""
    config, seen, unseen = problem.config, problem.tuner.batch, validation(problem.config)
    values = {n: np.concatenate([seen.values[n], unseen.values[n]]) for n in seen.names}
    return agvjax.batch(config.scenario, values), unseen


def unmet(problem: TuningProblem, before: agvjax.Metrics, after: agvjax.Metrics) -> list[str]:
    """The limits that the tuned gains exceed by more than the tolerance, each with by how much."""
    objective = problem.tuner.objective
    budget = problem.tuner.budget
    reference = objective.baseline(*objective.values(before)) if budget is None else budget
    levels = np.asarray(objective.levels(*objective.values(after), reference))[len(objective.goals) :]
    bounds = objective.units(reference)[len(objective.goals) :]
    return [
        f"{r.name} is {level * bound:.5g}, {level - 1:.2%} above its limit {bound:.5g}"
        for r, level, bound in zip(objective.limits, levels, bounds, strict=True)
        if not level <= 1 + TOLERANCE
    ]


def _conflict(problem: TuningProblem, z: Any) -> list[str]:
    """Which limits cannot be kept together, in words."""
    if not problem.tuner.method.jacobian:
        return ["Whether they can be kept at all, tune.optimizer = sqp tells."]
    parts = analysis.conflict(problem.tuner, z)
    against = [r.name for r, _, price in parts if price > 1e-6]
    if not parts:
        return ["The excess could still be lowered where the search ended: more iterations may meet them."]
    if len(against) < 2:
        return []
    return [f"These limits are in conflict, lowering one raises another: {', '.join(against)}."]


def summary(metrics: agvjax.Metrics) -> Summary:
    """Summary of an ensemble's metrics; the worst index is of a diverged run where there is one."""
    ok = np.asarray(metrics.ok)
    heading, delivered = metrics.rmse.shape[-1] == 3, metrics.limited is not None
    rows = [row for row in METRICS.values() if (heading or not row.heading) and (delivered or not row.delivered)]
    values = {row.name: np.asarray(metrics[row.name]) for row in rows}
    kept = {name: v[ok] for name, v in values.items()}
    none = not ok.any()
    return Summary(
        mean={name: np.inf if none else float(v.mean()) for name, v in kept.items()},
        worst={name: np.inf if none else float(v.max()) for name, v in kept.items()},
        latched=int((~ok).sum()),
        unsettled=int((~np.asarray(metrics.settled).all(-1) & ok).sum()),
        size=ok.size,
        worst_index=int(np.argmax(values["total_rmse"])),
    )
