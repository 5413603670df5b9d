"""What a careful colleague would say about tuned gains besides "all limits are met"."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

import agvjax
from agvjax.metric_table import METRICS
from agvjax.metric_units import PLAIN

from ..config.settings import LATE
from ..ensemble.worst import Found
from ..io.numbers import beyond, change
from .gains import Gains, value_of
from .methods.objective import TOLERANCE, Objective, Requirement

WORSE = 0.05  # by how much a metric must rise to be worth a word
AT_BOUND = 0.01  # how near a bound, as a share of it, a gain has ended there
MUCH_WORSE = 0.5  # the same of a metric that is no error
STUCK = 1.0  # s of standing while motion is commanded, from which on it is worth a word
FEW = 0.1  # share of the unseen runs that may not settle without the verdict naming it
DOUBTED = 0.01  # share of a limit by which unseen runs must exceed it for the verdict to name it
ERRORS = (*LATE, "cross_track_peak_late", "longest_settling_time", "limited")
COMMANDS = ("effort", "peak_position", "peak_heading", "total_chatter", "delivered_peak", "delivered_variation")
PEOPLE_LOOK_AT = dict.fromkeys(ERRORS, WORSE) | dict.fromkeys(COMMANDS, MUCH_WORSE)  # and by how much it must rise


class Caveats(NamedTuple):
    """What makes gains useless, and what should be known before they are used; each a sentence.

    `doubts` are those of the cautions that a verdict names at once, in a few words.
    """

    failures: list[str]
    cautions: list[str]
    doubts: list[str]


class Missed(NamedTuple):
    """A limit that runs exceed."""

    limit: Requirement
    value: float
    bound: float
    excess: float  # share of the bound

    def told(self, units: Mapping[str, str]) -> str:
        """By how much."""
        r, unit = self.limit, units[self.limit.metric]
        value = f"{r.told(self.value, self.bound):.5g} {unit}"
        return f"{r.name} is {value}, {beyond(self.ratio, 2)} its limit {self.bound:.5g}"

    @property
    def ratio(self) -> float:
        """Of the value to the bound."""
        return 1 - self.excess if self.limit.least else 1 + self.excess


def excesses(
    objective: Objective, metrics: agvjax.Metrics, baseline: np.ndarray, units: Mapping[str, str] = PLAIN
) -> list[str]:
    """The limits that runs exceed by more than the tolerance, each with by how much."""
    return [one.told(units) for one in missed(objective, metrics, baseline)]


class Risen(NamedTuple):
    """A metric that got worse."""

    metric: str
    statistic: str
    before: float
    after: float

    @property
    def share(self) -> str:
        """By how much; empty where it was 0."""
        return change(self.after / self.before) if self.before else ""


def missed(objective: Objective, metrics: agvjax.Metrics, baseline: np.ndarray) -> list[Missed]:
    """The limits that runs exceed by more than the tolerance."""
    first = len(objective.goals)
    levels = objective.levels_of(metrics, baseline)[first:]
    bounds = objective.units(baseline)[first:]
    over = [(r, x, b) for r, x, b in zip(objective.limits, levels, bounds, strict=True) if not x <= 1 + TOLERANCE]
    return [Missed(r, float(x), float(b), float(x - 1)) for r, x, b in over]


def unseen(  # long: a paragraph for each thing that may be said
    objective: Objective,
    before: agvjax.Metrics,
    after: agvjax.Metrics,
    budget: np.ndarray | None,
    band: float,
    long: bool = True,
    units: Mapping[str, str] = PLAIN,
) -> Caveats:
    """Of runs in scenarios that no tuning saw, with the starting gains and the tuned ones.

    Args:
        objective: goals and limits.
        before: metrics with the starting gains.
        after: metrics with the tuned gains, of the same scenarios.
        budget: the statistics (3, M) that limits are multiples of; None: those of the starting gains here.
        band: error [m, rad] within which a run has settled.
        long: whether the runs last long enough to settle.
        units: of the metrics.
    """
    everyone = objective._replace(weights=None)
    kept_before, kept = (np.asarray(metrics.ok) for metrics in (before, after))
    failures, cautions, doubts = [], [], []
    if not kept.all():
        counts = f"{np.sum(~kept)} of {kept.size} validation runs diverged"
        failures.append(f"{counts} ({np.sum(~kept_before)} with the starting gains)")
    restless_before, restless = (int(np.sum(~settled(metrics) & metrics.ok)) for metrics in (before, after))
    if restless:
        counts = f"{restless} of {kept.size} validation runs have not settled within {band:g} m and rad of the path"
        past = f"{restless_before} before" if kept_before.any() else "all diverged before"
        (failures if long and restless > kept.size / 2 else cautions).append(f"{counts} ({past})")
        if long and FEW * kept.size < restless <= kept.size / 2:
            doubts.append(f"{restless} of {kept.size} validation runs have not settled")
    if kept_before.any():
        baseline = everyone.baseline_of(before)
        levels = everyone.levels_of(after, baseline)[: len(objective.goals)]
        failures += _goal_worse(objective, levels)
        for goal, level in zip(objective.goals, levels, strict=True):  # one of several may hide behind the others
            if len(levels) > 1 and not level <= 1 + WORSE:
                words = f"on the validation scenarios {goal.name} is {level:.2f} times what it was"
                (cautions if level <= 1 + MUCH_WORSE else failures).append(words)
        over = missed(everyone, after, baseline if budget is None else budget)
        cautions += [f"on the validation scenarios {one.told(units)}" for one in over]
        far = [one for one in over if one.excess > DOUBTED]
        doubts += [f"{one.limit.name} is {beyond(one.ratio)} its limit on the validation scenarios" for one in far]
    risen = _risen(before, after, kept_before & kept)
    numbers = "{0.statistic} {0.metric} rose from {0.before:.3g} to {0.after:.3g} {1}{2}"
    cautions += [numbers.format(r, units[r.metric], f" ({r.share})" if r.share else "") for r in risen]
    worse = [r for r in risen if r.metric in ERRORS and r.share]
    doubts += [f"{r.statistic} {r.metric} rose {'by' if '%' in r.share else 'to'} {r.share.lstrip('+')}" for r in worse]
    return Caveats(failures, cautions, doubts)


def unfinished(before: agvjax.Metrics, after: agvjax.Metrics, path: agvjax.Path, horizon: float) -> Caveats:
    """Of runs along a route that ends, which do not reach its end.

    Args:
        before: metrics with the starting gains.
        after: metrics with the tuned gains, of the same scenarios.
        path: that they follow.
        horizon: of the runs [s].
    """
    nothing = Caveats([], [], [])
    if not isinstance(path, agvjax.Route) or path.closed or after.followed is None:
        return nothing
    short = [np.isinf(np.asarray(m["time_to_finish"])) & np.asarray(m.ok) for m in (before, after)]
    lost, size = [int(np.sum(runs)) for runs in short], np.asarray(after.ok).size
    counts = f"{lost[1]} of {size} validation runs do not reach the end of the route ({lost[0]} before)"
    if not lost[1]:
        return nothing
    doubt = f"{lost[1]} of {size} do not reach the end of the route"
    if horizon < (needed := float(path.end())):
        words = f"{counts}: it takes {needed:.4g} s, the run ends after {horizon:.4g} s (simulate.horizon)"
        return Caveats([], [words], [doubt])
    if stuck := int(np.sum(short[1] & (np.asarray(after["standstill"]) * horizon > STUCK))):
        counts += f"; {stuck} of them stand for {STUCK:g} s or more while motion is commanded: inside their deadzone,"
        counts += " above which the law's lowest speed must be, or which an inverse takes out"
    if stuck < lost[1]:
        counts += f"; {lost[1] - stuck} are on their way when the run ends after {horizon:.4g} s (simulate.horizon)"
    if lost[1] > lost[0] or lost[1] > size / 2:
        return Caveats([counts], [], [])
    return Caveats([], [counts], [doubt])


def _goal_worse(objective: Objective, levels: np.ndarray) -> list[str]:
    """That the weighted sum of the goals rose."""
    weights = np.array([goal.value for goal in objective.goals])
    ratio = float(weights @ levels / weights.sum()) if weights.sum() else 0.0
    worse = f"on the validation scenarios the goal is {ratio - 1:.1%} worse than before"
    return [] if ratio <= 1 + TOLERANCE else [worse]


def settled(metrics: agvjax.Metrics) -> np.ndarray:
    """Which runs (B,) have settled in all channels."""
    return np.asarray(np.all(np.asarray(metrics.settled), axis=-1))


def _risen(before: agvjax.Metrics, after: agvjax.Metrics, both: np.ndarray) -> list[Risen]:
    """What rose, of what people look at first, over the runs that neither set of gains loses."""
    found = []
    channels = np.shape(after.rmse)[-1]
    for name, least in PEOPLE_LOOK_AT.items() if both.any() else ():
        row = METRICS[name]
        nothing = {"heading": channels < 3, "delivered": after.limited is None, "route": after.followed is None}
        if any(nothing[kind] for kind in nothing if getattr(row, kind)):
            continue
        old, new = (np.asarray(metrics[name], float)[both] for metrics in (before, after))
        for statistic, of in (("mean", np.mean), ("worst", np.max)):
            a, b = float(of(old)), float(of(new))
            if np.isfinite(a) and b > (1 + least) * a and b - a > 1e-6:
                found.append(Risen(name, statistic, a, b))
    return found


def worst_case(
    objective: Objective,
    worst: Sequence[Found],
    baseline: np.ndarray,
    there: Mapping[str, float],
    units: Mapping[str, str] = PLAIN,
) -> list[str]:
    """What is to be said of the worst scenarios that were found: over a limit, or worse than the starting gains are.

    `there` is what the starting gains have of each metric in the worst scenario that was found of it.
    """
    bounds, lines = worst_bounds(objective, baseline), []
    place, advice = (
        "a scenario that the ensemble can draw but did not draw",
        "--set tune.search.rounds=3 tunes with it too",
    )
    for one in worst:
        bound = bounds.get(one.metric, np.inf)
        value = f"{place} has {one.metric} {one.value:.4g} {units[one.metric]}"
        if not np.isfinite(one.value):
            lines.append(f"{place} diverges ({one.metric}; {advice})")
        elif one.value > (1 + TOLERANCE) * bound:
            lines.append(f"{value}, {beyond(one.value / bound)} the limit {bound:.4g} ({advice})")
        elif one.value > (1 + WORSE) * there.get(one.metric, np.inf):
            lines.append(f"{value}, where the starting gains have {there[one.metric]:.4g} ({advice})")
    return lines


def worst_bounds(objective: Objective, baseline: np.ndarray) -> dict[str, float]:
    """By metric the bound of its worst, of the metrics that have one."""
    first = len(objective.goals)
    bounds = objective.units(baseline)[first:]
    worst = [(r, b) for r, b in zip(objective.limits, bounds, strict=True) if r.statistic == "worst" and not r.least]
    return {r.metric: float(b) for r, b in worst}


def at_bounds(gains: Gains, controller: agvjax.Law) -> list[str]:
    """Gains that ended at a bound of theirs, other than 0."""
    lines = []
    for name, *bounds in zip(gains.names, gains.lower, gains.upper, strict=True):
        for bound in bounds:
            if np.isfinite(bound) and bound and abs(value_of(controller, name) - bound) < AT_BOUND * abs(bound):
                lines.append(f"{name} ended at its bound {bound:.4g} (tune.bounds, the step, or the law's conditions)")
    return lines
