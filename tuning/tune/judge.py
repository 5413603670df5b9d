"""Are the gains any good? Judged at the finer step, on scenarios seen and unseen."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import agvjax
from agvjax.metric_table import METRICS
from agvjax.metric_units import units_in

from . import analysis, caveats
from .analysis import Findings
from .finer import baseline_of, before_and_after, judged, seen_and_unseen, tightened
from .methods.objective import Objective
from .problem import TuningProblem
from .rounds import Outcome


class Summary(NamedTuple):
    """Mean and worst of every metric over an ensemble, of the runs that did not diverge, and how many did."""

    mean: dict[str, float]
    worst: dict[str, float]
    latched: int
    unsettled: int
    size: int
    worst_index: int  # the scenario that is worst in the first goal


class TuneVerdict(NamedTuple):
    """What tuned gains are worth, on scenarios seen and unseen."""

    before: dict[str, Summary]  # on "tuning" and "validation" scenarios
    after: dict[str, Summary]
    findings: Findings
    over: list[str]  # limits that are not met, each with by how much
    conflict: list[str]  # those that cannot be kept together
    useless: list[str]  # what else makes the gains no good, each a sentence
    cautions: list[str]  # what should be known before they are used
    doubts: list[str]  # those of them that the verdict names, in a few words
    start: agvjax.Metrics  # of the scenarios tuned on, with the starting gains
    start_at_worst: dict[str, float]  # by metric, with the starting gains, in the worst scenario that was found
    worst: agvjax.Scenario  # the validation scenario with the largest error of the tuned gains

    @property
    def failure(self) -> str:
        """Why the gains are not what was asked for, in a sentence; empty where they are."""
        limits = ["limits not met: " + "; ".join(self.over) + ".", *self.conflict] if self.over else []
        return " ".join(limits + (["; ".join(self.useless) + "."] if self.useless else []))

    @property
    def lines(self) -> list[str]:
        """The verdict: a sentence, then what was left to be desired, a line each."""
        limits = "limits are not met" if self.over else "all limits are met on the tuning scenarios"
        if self.failure:
            first = f"Not tuned: {limits}" + ("; these gains should not be used" if self.useless else "")
        elif self.doubts:
            first = f"Tuned, but {', '.join(self.doubts)}; {limits}; before using these gains, note"
        else:
            first = f"Tuned: {limits}"
            first += "; before using these gains, note" if self.cautions else ""
        rest = [*self.over, *self.conflict, *self.useless, *self.cautions]
        return [first + (":" if rest else "."), *rest]


def judge(outcome: Outcome) -> TuneVerdict:
    """The gains before and after on both ensembles, what can be learned, and whether the limits are met."""
    problem, config = outcome.problem, outcome.problem.config
    seen = problem.tuner.batch
    _, unseen = seen_and_unseen(problem)
    parts = {"tuning": slice(None, config.ensemble.size), "validation": slice(seen.size, None)}
    metrics = outcome.metrics or before_and_after(problem, outcome.controller)
    before, after = (
        {part: summary(jax.tree.map(lambda x, s=s: x[s], m), problem.tuner.objective) for part, s in parts.items()}
        for m in metrics
    )
    tuned_on, new = (
        [jax.tree.map(lambda x, s=s: x[s], m) for m in metrics] for s in (slice(None, seen.size), parts["validation"])
    )
    baseline, objective, z = baseline_of(problem, tuned_on[0]), problem.tuner.objective, outcome.progress.best_z
    moving = outcome.run.moving
    searched = tightened(problem, outcome.run.factors_found).tuner
    findings, units = analysis.analyse(searched, z, moving), units_in(config.scenario)
    over = caveats.excesses(objective, tuned_on[1], baseline, units)
    conflict = _conflict(outcome, findings) if over else []
    criteria, budget = config.criteria, problem.tuner.budget
    long = config.simulate.horizon > criteria.late
    seen_of = caveats.unseen(objective, new[0], new[1], budget, criteria.band, long, units)
    stuck = caveats.unfinished(new[0], new[1], config.scenario.path, config.simulate.horizon)
    useless, cautions, doubts = (a + b for a, b in zip(seen_of, stuck, strict=True))
    there = _start_at_worst(outcome)
    cautions += caveats.worst_case(objective, outcome.found, baseline, there, units)
    cautions += caveats.at_bounds(problem.tuner.gains, outcome.controller)
    if np.array_equal(z, problem.tuner.gains.coordinates(config.controller)):
        cautions.append("nothing better than the starting gains was found: they are unchanged")
    cautions += [*_unit(outcome), *([outcome.stopped] if outcome.stopped else [])]
    worst = unseen[after["validation"].worst_index]
    return TuneVerdict(before, after, findings, over, conflict, useless, cautions, doubts, tuned_on[0], there, worst)


def _unit(outcome: Outcome) -> list[str]:
    """What goals and limits are multiples of, where every run diverges with the starting gains."""
    run, (config, tuner, *_) = outcome.run, outcome.problem
    if run.screened is None or np.array_equal(run.screened.unit, tuner.gains.coordinates(config.controller)):
        return []
    values = tuner.gains.values(jnp.asarray(run.screened.unit), config.controller)
    gains = ", ".join(f"{name} = {x:.3g}" for name, x in zip(tuner.gains.names, values, strict=True))
    return [f"every run diverges with the starting gains: goals and limits are relative to {gains}"]


def _start_at_worst(outcome: Outcome) -> dict[str, float]:
    """By metric its value with the starting gains in the worst scenario that was found of it."""
    if not outcome.found:
        return {}
    config, compiled = outcome.problem.config, outcome.problem.judgement
    size = len(outcome.found) if compiled is None else seen_and_unseen(outcome.problem)[0].size
    each = np.arange(size) % len(outcome.found)  # over and over, as many as what is compiled takes
    leaves = {name: np.stack([one.scenario[name] for one in outcome.found])[each] for name in outcome.found[0].scenario}
    metrics = judged(config, config.controller, agvjax.batch(config.scenario, leaves), compiled)
    return {one.metric: float(metrics[one.metric][i]) for i, one in enumerate(outcome.found)}


def unmet(problem: TuningProblem, before: agvjax.Metrics, after: agvjax.Metrics) -> list[str]:
    """The limits that the tuned gains exceed by more than the tolerance, each with by how much."""
    units = units_in(problem.config.scenario)
    return caveats.excesses(problem.tuner.objective, after, baseline_of(problem, before), units)


def _conflict(outcome: Outcome, findings: Findings) -> list[str]:
    """Which limits cannot be kept together, or what else keeps them from being met, in words."""
    problem = outcome.problem
    if all(standing.met for standing in findings.standings):
        steps = f"tune.dt = {problem.config.tune.dt:g} s, but not at simulate.dt = {problem.config.simulate.dt:g} s"
        return [f"They are met at {steps}, at which gains are evaluated: use a smaller tune.dt, or tighter limits."]
    if not problem.tuner.method.jacobian:
        return ["tune.optimizer = sqp can tell whether they are feasible."]
    parts = analysis.conflict(problem.tuner, outcome.progress.best_z, outcome.run.moving)
    against = [r.name for r, _, price in parts if price > 1e-6]
    if not parts:
        return ["The search ended while the violation could still be reduced: more iterations may help."]
    if len(against) < 2:
        return []
    return [f"These limits conflict, lowering one raises another: {', '.join(against)}."]


@jax.jit
def _in_turn(metrics: agvjax.Metrics) -> list[Array]:
    """Every metric that there are values of, as one program."""
    return [metrics[name] for name in metrics.names()]


def summary(metrics: agvjax.Metrics, objective: Objective) -> Summary:
    """Summary of an ensemble's metrics; the worst run is that of the first goal, or a diverged one if there is any."""
    goal = objective.goals[0].metric
    ok = np.asarray(metrics.ok)
    values = {name: np.asarray(x) for name, x in zip(metrics.names(), _in_turn(metrics), strict=True)}
    kept = {name: v[ok] for name, v in values.items()}
    none = not ok.any()
    return Summary(
        mean={name: np.inf if none else float(v.mean()) for name, v in kept.items()},
        worst={n: np.inf if none else float(v.min() if METRICS[n].large else v.max()) for n, v in kept.items()},
        latched=int((~ok).sum()),
        unsettled=int((~caveats.settled(metrics) & ok).sum()),
        size=ok.size,
        worst_index=int(np.argmax(np.where(ok, -values[goal] if METRICS[goal].large else values[goal], np.inf))),
    )
