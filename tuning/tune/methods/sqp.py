"""Sequential quadratic programming on the whole Jacobian: goals and limits, mean and worst, in a trust region.

Forward mode yields the slope of every metric of every scenario in every gain at the price of one gradient. So each step
may solve the tuning problem itself, linearised: the worst scenario is a maximum over all of them, not the one that
happens to lead. What is curved is learned on the way, from how the slopes of the requirements that count change
(damped BFGS of their Lagrangian: Nocedal and Wright, Numerical Optimization, 2006, procedure 18.2). Limits are kept by
an exact penalty, so that the search ends inside them or shows that they cannot be kept.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from agvjax import Fault

from ...config.settings import Config
from .method import Look, Method, Model, Progress, Scenarios
from .objective import Objective
from .quadratic import Unsolved, quadratic

if TYPE_CHECKING:
    from ..tuner import Tuner

FIRST, LARGEST, SMALLEST = 0.25, 1.0, 1e-4  # of the trust region, in the free coordinates: logarithms of the gains
FLATTEST = 1e-3  # curvature to begin with
SHRINK = 0.4  # of the region after a step that did not keep its promise
LEAST = 1e-5  # share of the cost that a step must promise
STEEPEST = 1e4  # a metric that changes by so many times its reference per unit says nothing of the neighbourhood
DEAREST = 1e4  # penalty beyond which limits that are not met cannot be


class Sqp(Method):
    """The tuning problem itself at every step: goals and limits, linearised, in a trust region."""

    jacobian = True

    def begin(self, z: Array, scenarios: int) -> State:
        """Before the first look."""
        return State.begin(z.size, len(self.objective.names), scenarios, self.objective.penalty)

    def look(self, tuner: Tuner, z: Array, scenarios: Scenarios, model: Model | None) -> Look:
        """The whole Jacobian too."""
        model = tuner.push(z, scenarios) if model is None else model
        return Look(*tuner.weigh(*model), model=model)

    def step(
        self, p: Progress, look: Look, sound: bool, baseline: np.ndarray, scenarios: Scenarios
    ) -> tuple[Array, State]:
        """The solution of the problem about the best point so far."""
        levels = look.score.levels if sound else None
        z, state = step(p.optimiser, p.z, levels, look.model, self.objective, baseline)
        return jnp.asarray(z, p.z.dtype), state

    def usable(self, look: Look, baseline: np.ndarray) -> bool:
        """Whether the slopes are slopes."""
        return usable(look.model, self.objective.scale(baseline))

    def converged(self, state: State) -> bool:
        """Whether the trust region has shrunk to nothing."""
        return state.converged

    @classmethod
    def faults(cls, config: Config) -> list[Fault]:
        """Reverse mode, options, and scenarios that change."""
        tune, faults = config.tune, []
        if tune.gradient == "reverse":
            faults.append(Fault("tune.gradient", tune.gradient, "forward: sqp needs the whole Jacobian"))
        if tune.options:
            faults.append(Fault("tune.options", dict(tune.options), "empty: sqp has none"))
        if config.ensemble.fresh:
            rule = "false: sqp needs the same scenarios every iteration; an optimiser of optax does not"
            faults.append(Fault("ensemble.fresh", "true", rule))
        return faults


class State(NamedTuple):
    """Where the search stands: the best point so far with its model, and what the step from it promised."""

    center: np.ndarray  # (K,)
    goal: np.ndarray  # ()
    over: np.ndarray  # (), sum of the limits' excesses
    values: np.ndarray  # (M, B)
    ok: np.ndarray  # (B,)
    slopes: np.ndarray  # (K, M, B)
    hessian: np.ndarray  # (K, K)
    weights: np.ndarray  # (M, B), of the metrics in the Lagrangian
    radius: np.ndarray  # ()
    promised: np.ndarray  # (), by how much the next point should lower the cost
    penalty: np.ndarray  # (), of an excess; raised where the limits were not met in the end

    @classmethod
    def begin(cls, size: int, metrics: int, scenarios: int, penalty: float) -> State:
        """Before the first look: any cost is better."""
        empty = np.zeros((metrics, scenarios))
        return cls(
            center=np.zeros(size),
            goal=np.array(np.inf),
            over=np.array(0.0),
            values=empty,
            ok=np.zeros(scenarios, bool),
            slopes=np.zeros((size, metrics, scenarios)),
            hessian=FLATTEST * np.eye(size),
            weights=empty,
            radius=np.array(FIRST),
            promised=np.array(0.0),
            penalty=np.array(penalty),
        )

    @property
    def converged(self) -> bool:
        """Whether no step worth taking is left."""
        return bool(self.radius < SMALLEST)


class Solution(NamedTuple):
    """Of the problem as its model has it."""

    change: np.ndarray  # (K,)
    cost: float  # that it promises
    prices: np.ndarray  # (L,), by how much the cost falls per unit by which a limit's level is relaxed
    weights: np.ndarray  # (M, B), of the metrics in the Lagrangian


def usable(model: Any, scale: np.ndarray) -> bool:
    """Whether slopes (K, M, B) of metrics of a `scale` (M,) are slopes and not the sensitivity of a chattering run."""
    slopes = np.asarray(model[2]) / scale[:, None]
    return bool(np.all(np.abs(slopes) < STEEPEST))  # False for NaN too


def step(state: State, z: Any, levels: Any, model: Any, objective: Objective, reference: Any) -> tuple[Any, State]:
    """Judge the point z by its cost, keep it if it is better, and say where to look next.

    Args:
        state: of the search.
        z: (K,), the point just looked at.
        levels: (R,), of the requirements there; None if nothing can be said of it.
        model: values (M, B), ok (B,) and slopes (K, M, B) there.
        objective: goals and limits.
        reference: (3, M), what goals and limits are multiples of.

    Returns:
        The next point (K,) and the state.
    """
    goal, over = (np.inf, np.inf) if levels is None else _worth(np.asarray(levels), objective)
    first, radius = np.isinf(state.goal), float(state.radius)
    moved = levels is not None
    if not first:
        before, cost = (float(g + state.penalty * o) for g, o in ((state.goal, state.over), (goal, over)))
        share = (before - cost) / max(float(state.promised), 1e-300) if moved else -1.0
        moved = share > 0.05
        radius *= 2.0 if share > 0.75 else 1.0 if share > 0.25 else SHRINK
    if levels is not None:
        values, ok, slopes = np.asarray(model[0], float), np.asarray(model[1]), np.asarray(model[2], float)
        if not first:
            bend = np.tensordot(np.where(ok & state.ok, slopes - state.slopes, 0.0), state.weights, axes=2)
            state = state._replace(hessian=curved(state.hessian, np.asarray(z) - state.center, bend))
        if moved:
            state = state._replace(
                center=np.asarray(z, float),
                goal=np.array(goal),
                over=np.array(over),
                values=values,
                ok=ok,
                slopes=slopes,
            )
    if np.isinf(state.goal):
        return z, state._replace(radius=np.array(0.0))
    return _look(state, min(radius, LARGEST), objective, reference)


def _look(state: State, radius: float, objective: Objective, reference: Any) -> tuple[Any, State]:
    """Where to look next; where nothing is left to gain and limits are not met, at a higher penalty."""
    model = (state.values, state.ok, state.slopes)
    try:
        found = solve(model, objective._replace(penalty=float(state.penalty)), reference, radius, state.hessian)
    except Unsolved:
        if radius < SMALLEST:  # by slopes that tell nothing: the search ends where it stands
            return state.center, state._replace(radius=np.array(0.0))
        return _look(state, SHRINK * radius, objective, reference)
    cost = float(state.goal + state.penalty * state.over)
    promised = cost - found.cost
    if promised <= LEAST * abs(cost) or radius < SMALLEST:
        if state.over > 1e-4 and state.penalty < DEAREST:
            return _look(state._replace(penalty=np.maximum(10 * state.penalty, 1.0)), FIRST, objective, reference)
        radius = 0.0
    state = state._replace(radius=np.array(radius), promised=np.array(promised), weights=found.weights)
    return state.center + found.change, state


def promise(state: State, objective: Objective, reference: Any) -> float:
    """By which share slopes alone lower the cost within `FIRST` of the best point: nothing where it is an optimum.

    Infinite where the problem by these slopes cannot be solved.
    """
    cost = float(state.goal + state.penalty * state.over)
    model = (state.values, state.ok, state.slopes)
    if cost == 0:
        return 0.0  # as of a corridor that is never left
    try:
        found = solve(model, objective._replace(penalty=float(state.penalty)), reference, FIRST)
    except Unsolved:
        return np.inf
    return (cost - found.cost) / abs(cost)


def curved(hessian: np.ndarray, change: np.ndarray, bend: np.ndarray) -> np.ndarray:
    """The Hessian after a step by `change` over which the Lagrangian's gradient changed by `bend`; kept positive."""
    along = hessian @ change
    curvature, seen = change @ along, change @ bend
    if not curvature > 0:
        return hessian
    share = 1.0 if seen >= 0.2 * curvature else 0.8 * curvature / (curvature - seen)
    mixed = share * bend + (1 - share) * along
    return hessian - np.outer(along, along) / curvature + np.outer(mixed, mixed) / (change @ mixed)


def _worth(levels: np.ndarray, objective: Objective) -> tuple[float, float]:
    """Goal and sum of excesses."""
    goals = len(objective.goals)
    goal = np.dot([g.value for g in objective.goals], levels[:goals])
    return float(goal), float(np.maximum(levels[goals:] - 1, 0).sum())


# long: one matrix, block by block
def solve(
    model: Any, objective: Objective, reference: Any, radius: float, hessian: np.ndarray | None = None
) -> Solution:
    """The problem with linear metrics and the curvature of `hessian` within |change| <= radius.

    Every requirement's level is bounded by an unknown of its own: a mean is linear; a worst lies above every scenario;
    a mean of the worst tail is c + sum of shares of what lies above c, by the tail, for the best c (Rockafellar and
    Uryasev, Optimization of conditional value-at-risk, 2000).
    """
    values, ok, slopes = (np.asarray(x, float) for x in model)
    ok = ok.astype(bool)
    count, _, scenarios = slopes.shape
    diverged = objective.latched * objective.scale(reference)
    values, slopes = np.where(ok, values, diverged[:, None]), np.where(ok, slopes, 0.0)
    units, turned, shares = objective.units(reference), objective.turned, objective.shares(scenarios)
    goals, limits = len(objective.goals), len(objective.limits)
    tails = [i for i, r in enumerate(objective.requirements) if r.statistic == "cvar"]
    # unknowns: the change; a level per goal; an excess per limit; per tail its c and what lies above
    offset = {i: count + goals + limits + k * (1 + scenarios) for k, i in enumerate(tails)}
    width = count + goals + limits + len(tails) * (1 + scenarios)
    rows, rooms = [], []  # rows @ unknowns <= rooms
    parts: list[tuple[int, int, np.ndarray]] = []  # of each block: requirement, first row, how rows weigh scenarios
    for i, (requirement, (_, m)) in enumerate(zip(objective.requirements, objective.places, strict=True)):
        level, slope, weighs = values[m] / units[i] + turned[i], slopes[:, m].T / units[i], np.eye(scenarios)
        if requirement.statistic == "mean":
            level, slope, weighs = np.array([shares @ level]), (shares @ slope)[None], shares[None]
        bounded = block = np.zeros((len(level), width))
        block[:, :count] = slope
        parts.append((i, sum(map(len, rows)), weighs))
        rows.append(block)
        rooms.append(-level)
        if i in offset:
            c, above = offset[i], slice(offset[i] + 1, offset[i] + 1 + scenarios)
            block[:, c], block[:, above] = -1.0, -np.eye(scenarios)
            bounded = np.zeros((1, width))
            bounded[0, c], bounded[0, above] = 1.0, shares / objective.tail
            rows.append(bounded)
            rooms.append(np.zeros(1))
        bounded[:, count + i] = -1.0  # a goal's level, or a limit's excess
        rooms[-1] = rooms[-1] + (i >= goals)
    cost = np.zeros(width)
    cost[count : count + goals] = [g.value for g in objective.goals]
    cost[count + goals : count + goals + limits] = objective.penalty
    box = np.eye(width)[:count]
    positive = [*range(count + goals, count + goals + limits)]
    positive += [k for at in offset.values() for k in range(at + 1, at + 1 + scenarios)]
    matrix = np.vstack([*rows, box, -box, -np.eye(width)[positive]])
    room = np.concatenate([*rooms, np.full(2 * count, radius), np.zeros(len(positive))])
    curvature = np.zeros((width, width))
    curvature[:count, :count] = 0.0 if hessian is None else hessian
    x, duals, value = quadratic(curvature, cost, matrix, room)
    weights = np.zeros_like(values)
    prices = np.zeros(len(objective.requirements))
    for i, row, weighs in parts:
        share = duals[row : row + len(weighs)]
        prices[i] += share.sum()
        weights[objective.places[i][1]] += share @ weighs / units[i]
    return Solution(x[:count], value, prices[goals:], weights)
