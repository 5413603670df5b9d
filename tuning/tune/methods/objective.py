"""What to minimise and what not to exceed, over an ensemble: requirements, and what a set of gains is worth by them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

import agvjax
from agvjax.metric_table import METRICS

STATISTICS = ("mean", "worst", "cvar")
TOLERANCE = 1e-3  # a limit counts as met up to a tenth of a percent
FEASIBLE = 5e-4  # while tuning up to half of it: the coarser step of tuning may be wrong by the other half


class Requirement(NamedTuple):
    """One statistic of one metric: to be minimised with `value` as its weight, or to stay below `value`."""

    metric: str
    statistic: str  # one of STATISTICS
    value: float
    absolute: bool = False  # of a limit: in the metric's own unit and not in multiples of the baseline
    least: bool = False  # of a limit: to stay above `value`; the worst is the smallest then

    @property
    def name(self) -> str:
        """As tables and messages call it."""
        return f"{self.statistic} {self.metric}"

    @property
    def sign(self) -> float:
        """Of the metric where the objective sums it up: what must not fall is turned over, so that large is bad."""
        return -1.0 if self.least else 1.0

    @property
    def column(self) -> str:
        """The metric, as the objective has it."""
        return f"-{self.metric}" if self.least else self.metric

    def told(self, level: float, unit: float) -> float:
        """The statistic in the metric's unit, of a level and what levels are divided by."""
        return (2 - level) * unit if self.least else level * unit


def within(limits: Mapping[str, float], absolute: bool = False) -> tuple[Requirement, ...]:
    """Limits on both the mean and the worst of the named metrics."""
    return tuple(Requirement(name, s, value, absolute) for s in ("mean", "worst") for name, value in limits.items())


class Score(NamedTuple):
    """What one set of gains is worth on an ensemble."""

    cost: Float[Array, ""]  # goal + penalty
    goal: Float[Array, ""]
    excess: Float[Array, ""]  # largest share by which a limit is exceeded; 0 or less: all are met
    latched: Float[Array, ""]  # runs of the ensemble that diverged, without those that were added
    levels: Float[Array, " R"]  # of the requirements, see `Objective.levels`


class Objective(NamedTuple):
    """Minimise the goals, each times its weight, and keep the limits, over an ensemble.

    Goals are ratios to a `baseline`: the same statistic of the same metric with the starting gains, or of another law.
    Limits are multiples of that baseline, or absolute. A limit from below, with the bound b on a metric v, has the
    level 2 - v / b: 1 at its bound, as any other, and more beyond it. A run that diverged counts `latched` times the
    `scale` of each metric and sends no gradient.
    """

    goals: tuple[Requirement, ...] = (Requirement("total_rmse", "mean", 1.0), Requirement("total_rmse", "worst", 0.3))
    limits: tuple[Requirement, ...] = within({"effort": 1.0, "peak_position": 1.0, "peak_heading": 1.0})
    penalty: float = 3.0
    latched: float = 10.0
    tail: float = 0.1  # share of the ensemble, the worst, whose mean is the "cvar"
    judged: agvjax.Criteria = agvjax.Criteria()  # when an error has settled, and from when on it is late
    weights: Any = None  # (B,), the scenarios' shares in "mean" and "cvar"; None: equal

    @property
    def requirements(self) -> tuple[Requirement, ...]:
        """Goals, then limits."""
        return self.goals + self.limits

    @property
    def names(self) -> tuple[str, ...]:
        """The metrics that matter, those of the loop last; one that must not fall is turned over: "-" and its name."""
        return tuple(dict.fromkeys(r.column for r in sorted(self.requirements, key=lambda r: METRICS[r.metric].loop)))

    @property
    def metrics(self) -> tuple[str, ...]:
        """The same, by their names alone."""
        return tuple(dict.fromkeys(r.metric for r in self.requirements))

    @property
    def loop(self) -> bool:
        """Whether there are limits on the linearised loop."""
        return any(METRICS[r.metric].loop for r in self.limits)

    def of_runs(self) -> Objective:
        """Without the limits on the linearised loop."""
        return self._replace(limits=tuple(r for r in self.limits if not METRICS[r.metric].loop))

    @property
    def criteria(self) -> agvjax.Criteria:
        """How runs must be judged for these metrics to have slopes."""
        return agvjax.Criteria.of(self.metrics, sloped=True, like=self.judged)

    @property
    def places(self) -> list[tuple[int, int]]:
        """Of every requirement: row of its statistic and column of its metric in a baseline."""
        return [(STATISTICS.index(r.statistic), self.names.index(r.column)) for r in self.requirements]

    def values(self, metrics: agvjax.Metrics) -> tuple[Float[Array, "M B"], Bool[Array, " B"]]:
        """The metrics that matter of every scenario, as `names` has them, and which runs are worth having."""
        of = {r.column: r for r in self.requirements}
        return jnp.stack([of[name].sign * metrics[of[name].metric] for name in self.names]), metrics.ok

    def baseline_of(self, metrics: agvjax.Metrics) -> np.ndarray:
        """The `baseline` (3, M) that runs are, as one program: each operation by itself is one to load."""
        return self.baseline(*jax.jit(self.values)(metrics))

    def levels_of(self, metrics: agvjax.Metrics, baseline: np.ndarray) -> np.ndarray:
        """The `levels` (R,) that runs reach, as one program."""
        return np.asarray(jax.jit(lambda seen: self.levels(*self.values(seen), baseline))(metrics))

    def shares(self, scenarios: int) -> np.ndarray:
        """Shares of the scenarios in means, of sum 1."""
        weights = np.ones(scenarios) if self.weights is None else np.asarray(self.weights, float)
        return weights / weights.sum()

    def statistics(self, values: Float[Array, "M B"]) -> Float[Array, "3 M"]:
        """Mean, worst and mean of the worst `tail` of every metric."""
        shares = jnp.asarray(self.shares(values.shape[1]), values.dtype)
        each = jnp.broadcast_to(shares, values.shape)
        falling, parts = jax.lax.sort((-values, each), dimension=1, num_keys=1)
        ranked = -falling
        taken = jnp.clip(self.tail - (jnp.cumsum(parts, axis=1) - parts), 0, parts) / self.tail
        return jnp.stack([values @ shares, jnp.max(values, axis=1), jnp.sum(taken * ranked, axis=1)])

    def baseline(self, values: Float[Array, "M B"], ok: Bool[Array, " B"]) -> np.ndarray:
        """The statistics (3, M) of the runs that did not diverge.

        Raises:
            RuntimeError: every run diverges, or one of them is 0 and can be no unit of a goal or of a limit.
        """
        kept = np.asarray(ok)
        if not kept.any():
            raise RuntimeError(
                f"every one of the {kept.size} runs diverges with the starting gains: there is nothing to tune from"
            )
        sound = self._replace(weights=self.shares(kept.size)[kept])
        found = np.asarray(jax.jit(sound.statistics)(np.asarray(values)[:, kept]))
        for requirement, place in zip(self.requirements, self.places, strict=True):
            value = requirement.sign * found[place]
            if not requirement.absolute and not value > 0:
                raise RuntimeError(
                    f"{requirement.name} is {value:g} with the starting gains, and nothing is a"
                    " multiple of that: choose another goal, or an absolute limit"
                )
        return found

    def units(self, baseline: Any) -> np.ndarray:
        """What each requirement's statistic is divided by: a goal's baseline, a limit's bound."""
        table = np.asarray(baseline)
        bounds = [
            r.value if r.absolute else r.value * r.sign * table[p]
            for r, p in zip(self.requirements, self.places, strict=True)
        ]
        return np.array([*(table[p] for p in self.places[: len(self.goals)]), *bounds[len(self.goals) :]])

    def scale(self, baseline: Any) -> np.ndarray:
        """Of every metric (M,) the size that counts: the worst of the baseline or, if larger, a limit's bound."""
        size = np.abs(np.array(np.asarray(baseline)[1], float))
        limits = slice(len(self.goals), None)
        for (_, metric), bound in zip(self.places[limits], self.units(baseline)[limits], strict=True):
            size[metric] = max(size[metric], bound)
        return size

    @property
    def turned(self) -> np.ndarray:
        """What is added to a turned statistic by its unit to be a level (R,): 2 of a limit from below, or 0."""
        return np.array([2.0 if r.least else 0.0 for r in self.requirements])

    def levels(self, values: Float[Array, "M B"], ok: Bool[Array, " B"], baseline: Any) -> Float[Array, " R"]:
        """Every requirement's statistic by its unit: of a goal 1 at the start, of a limit 1 at its bound.

        Raises:
            ValueError: these are not the metrics of `names`, by their number.
        """
        if len(values) != len(self.names):  # JAX would take another row for one that is not there
            raise ValueError(f"values of {len(self.names)} metrics are needed, {self.names}; got {len(values)}")
        diverged = jnp.asarray(self.latched * self.scale(baseline), values.dtype)
        found = self.statistics(jnp.where(ok, values, diverged[:, None]))
        rows, columns = (list(x) for x in zip(*self.places, strict=True))
        shares = found[jnp.array(rows), jnp.array(columns)] / jnp.asarray(self.units(baseline), values.dtype)
        return shares + jnp.asarray(self.turned, values.dtype)

    def score(self, values: Float[Array, "M B"], ok: Bool[Array, " B"], baseline: Any) -> Score:
        """Cost and what it is made of."""
        levels = self.levels(values, ok, baseline)
        goal = jnp.dot(jnp.asarray([g.value for g in self.goals], levels.dtype), levels[: len(self.goals)])
        over = levels[len(self.goals) :] - 1
        cost = goal + self.penalty * jnp.sum(jnp.maximum(over, 0))
        counted = jnp.asarray(self.shares(ok.size) > 0)  # places that only the worst sees hold copies
        return Score(cost, goal, jnp.max(over, initial=-1.0), jnp.sum(~ok & counted), levels)

    def ranks(self, score: Score) -> tuple[np.ndarray, np.ndarray]:
        """By what gains are compared, in this order: the sum of excesses beyond `FEASIBLE`, and the goal."""
        over = np.asarray(score.levels)[..., len(self.goals) :] - 1
        return np.maximum(over - FEASIBLE, 0).sum(axis=-1), np.asarray(score.goal)
