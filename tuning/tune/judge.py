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
from .problem import Posed
from .rounds import Outcome
from .tuner import TOLERANCE


def judged(config: Config, controller: Any, batch: agvjax.Batch) -> agvjax.Metrics:
    """Metrics at the step of `simulate`, which is finer than that of tuning."""
    criteria = agvjax.Criteria(smooth=True, delivered=True)
    evaluate = functools.partial(agvjax.evaluate, criteria=criteria, **config.timing())
    return jax.tree.map(np.asarray, distributed.gathered(evaluate)(agvjax.check(controller), batch))


def verdict(outcome: Outcome) -> tuple[Verdict, agvjax.Batch]:
    """The gains before and after on both ensembles, what can be learned, and whether the limits are met."""
    posed, config = outcome.posed, outcome.posed.config
    seen = posed.tuner.batch
    both, unseen = _both(posed)
    parts = {"tuning": slice(None, config.ensemble.size), "validation": slice(seen.size, None)}
    metrics = {
        label: judged(config, c, both) for label, c in (("before", config.controller), ("after", outcome.controller))
    }
    before, after = (
        {part: judge(jax.tree.map(lambda x, s=s: x[s], metrics[label])) for part, s in parts.items()}
        for label in ("before", "after")
    )
    over = unmet(posed, *(jax.tree.map(lambda x: x[: seen.size], metrics[label]) for label in ("before", "after")))
    z = outcome.progress.best_z
    conflict = _conflict(posed, z) if over else []
    return Verdict(before, after, analysis.analyse(posed.tuner, z), over, conflict), unseen


def validation(config: Config) -> agvjax.Batch:
    """Scenarios that no tuning sees."""
    return sample(config.scenario, config.ensemble.draws, config.ensemble.validation_size, config.seed + 1)


def _both(posed: Posed) -> tuple[agvjax.Batch, agvjax.Batch]:
    """The tuning scenarios with the validation scenarios behind them, and these alone."""
    config, seen, unseen = posed.config, posed.tuner.batch, validation(posed.config)
    values = {n: np.concatenate([seen.values[n], unseen.values[n]]) for n in seen.names}
    return agvjax.batch(config.scenario, values), unseen


def unmet(posed: Posed, before: agvjax.Metrics, after: agvjax.Metrics) -> list[str]:
    """The limits that the tuned gains exceed by more than the tolerance, each with by how much."""
    objective = posed.tuner.objective
    given = posed.tuner.budget
    reference = objective.reference(*objective.values(before)) if given is None else given
    levels = np.asarray(objective.levels(*objective.values(after), reference))[len(objective.goals) :]
    bounds = objective.units(reference)[len(objective.goals) :]
    return [
        f"{r.name} is {level * bound:.5g}, {level - 1:.2%} above its limit {bound:.5g}"
        for r, level, bound in zip(objective.limits, levels, bounds, strict=True)
        if not level <= 1 + TOLERANCE
    ]


def _conflict(posed: Posed, z: Any) -> list[str]:
    """Which limits cannot be kept together, in words."""
    if not posed.tuner.sequential:
        return ["Whether they can be kept at all, tune.optimizer = sqp tells."]
    parts = analysis.conflict(posed.tuner, z)
    against = [r.name for r, _, price in parts if price > 1e-6]
    if not parts:
        return ["The excess could still be lowered where the search ended: more iterations may meet them."]
    if len(against) < 2:
        return []
    return [f"These limits are in conflict, lowering one raises another: {', '.join(against)}."]


class Judged(NamedTuple):
    """Mean and worst of every metric over an ensemble, of the runs that did not diverge, and how many did."""

    mean: dict[str, float]
    worst: dict[str, float]
    latched: int
    unsettled: int
    size: int
    worst_index: int  # scenario with the largest error


class Verdict(NamedTuple):
    """Everything the report tells besides the run itself."""

    before: dict[str, Judged]  # on "tuning" and "validation" scenarios
    after: dict[str, Judged]
    findings: Findings
    over: list[str]  # limits that are not met, each with by how much
    conflict: list[str]  # those that cannot be kept together


def judge(metrics: agvjax.Metrics) -> Judged:
    """Summary of an ensemble's metrics; the worst index is of a diverged run where there is one."""
    ok = np.asarray(metrics.ok)
    heading, delivered = metrics.rmse.shape[-1] == 3, metrics.limited is not None
    rows = [row for row in METRICS.values() if (heading or not row.heading) and (delivered or not row.delivered)]
    values = {row.name: np.asarray(metrics[row.name]) for row in rows}
    kept = {name: v[ok] for name, v in values.items()}
    none = not ok.any()
    return Judged(
        mean={name: np.inf if none else float(v.mean()) for name, v in kept.items()},
        worst={name: np.inf if none else float(v.max()) for name, v in kept.items()},
        latched=int((~ok).sum()),
        unsettled=int((~np.asarray(metrics.settled).all(-1) & ok).sum()),
        size=ok.size,
        worst_index=int(np.argmax(values["total_rmse"])),
    )
