"""Sequential linear programming on the whole Jacobian: goals and limits, mean and worst, linear in a trust region.

Forward mode yields the slope of every metric of every scenario in every gain at the price of one gradient. So each step
may solve the tuning problem itself, linearised: the worst scenario is a maximum over all of them, not the one that
happens to lead. Where as many limits are active as there are gains to move, which is the rule here, this converges
fast; and its exact penalty ends inside the limits.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import linprog

from .objective import Objective

FIRST, LARGEST, SMALLEST = 0.25, 1.0, 1e-4  # of the trust region, in the free coordinates: logarithms of the gains
STEEPEST = 1e4  # a metric that changes by so many times its reference per unit says nothing of the neighbourhood


class State(NamedTuple):
    """Where the search stands: the best point so far with its linear model, and what the step from it promised."""

    center: np.ndarray  # (K,)
    cost: np.ndarray  # ()
    values: np.ndarray  # (M, B)
    ok: np.ndarray  # (B,)
    slopes: np.ndarray  # (K, M, B)
    radius: np.ndarray  # ()
    promised: np.ndarray  # (), by how much the next point should lower the cost

    @classmethod
    def begin(cls, size: int, metrics: int, scenarios: int) -> State:
        """Before the first look: any cost is better."""
        empty = np.zeros((metrics, scenarios))
        return cls(
            center=np.zeros(size),
            cost=np.array(np.inf),
            values=empty,
            ok=np.zeros(scenarios, bool),
            slopes=np.zeros((size, metrics, scenarios)),
            radius=np.array(FIRST),
            promised=np.array(0.0),
        )

    @property
    def converged(self) -> bool:
        """Whether no step worth taking is left."""
        return bool(self.radius < SMALLEST)


def usable(model: Any, reference: Any) -> bool:
    """Whether slopes (K, M, B) are slopes and not the sensitivity of a chattering run."""
    slopes = np.asarray(model[2]) / np.asarray(reference)[1][:, None]
    return bool(np.all(np.abs(slopes) < STEEPEST))  # False for NaN too


def step(state: State, z: Any, cost: float, model: Any, objective: Objective, reference: Any) -> tuple[Any, State]:
    """Judge the point z by its cost, keep it if it is better, and say where to look next.

    Args:
        state: of the search.
        z: (K,), the point just looked at.
        cost: there; not finite if nothing can be said of it.
        model: values (M, B), ok (B,) and slopes (K, M, B) there.
        objective: goal and limits.
        reference: (2, M), what the ratios are taken to.

    Returns:
        The next point (K,) and the state.
    """
    if np.isinf(state.cost):
        moved, radius = np.isfinite(cost), float(state.radius)
    else:
        share = (float(state.cost) - cost) / max(float(state.promised), 1e-300) if np.isfinite(cost) else -1.0
        moved = share > 0.05
        radius = float(state.radius) * (2.0 if share > 0.75 else 1.0 if share > 0.25 else 0.4)
    if moved:
        values, ok, slopes = (np.asarray(x) for x in model)
        state = State(np.asarray(z), np.array(cost), values, ok, slopes, np.array(0.0), np.array(0.0))
    radius = min(radius, LARGEST)
    if np.isinf(state.cost):
        return z, state._replace(radius=np.array(0.0))
    change, value = solve(state, objective, reference, radius)
    promised = float(state.cost) - value
    radius = radius if promised > 1e-5 * abs(float(state.cost)) else 0.0  # nothing left to gain
    return state.center + change, state._replace(radius=np.array(radius), promised=np.array(promised))


def solve(state: State, objective: Objective, reference: Any, radius: float) -> tuple[np.ndarray, float]:
    """The linearised problem within |change| <= radius: the change (K,) and the cost it promises."""
    count, metrics, scenarios = state.slopes.shape
    reference, limits = np.asarray(reference), np.array([*objective.limits.values()])
    diverged = objective.latched * reference
    values, slopes = state.values, np.where(state.ok, state.slopes, 0.0)
    mean = np.where(state.ok, values, diverged[0][:, None]).mean(1) / reference[0]
    mean_slope = slopes.mean(2) / reference[0]  # (K, M)
    worst = np.where(state.ok, values, diverged[1][:, None]) / reference[1][:, None]  # (M, B)
    worst_slope = slopes / reference[1][:, None]  # (K, M, B)
    extra = metrics - 1  # limits on a mean, and as many on a worst; each may be exceeded at a price
    eye = np.eye(metrics)[:, 1:]
    # unknowns: the change, the worst of the goal, excess of each mean, excess of each worst
    cost = np.concatenate([objective.mean * mean_slope[:, 0], [objective.worst], np.full(2 * extra, objective.penalty)])
    of_mean = np.hstack([mean_slope[:, 1:].T, np.zeros((extra, 1)), -np.eye(extra), np.zeros((extra, extra))])
    per_run = np.repeat(np.arange(metrics), scenarios)
    of_worst = np.hstack(
        [
            worst_slope.reshape(count, -1).T,
            -(per_run == 0).astype(float)[:, None],
            np.zeros((per_run.size, extra)),
            -eye[per_run],
        ]
    )
    room = np.concatenate([limits - mean[1:], np.concatenate([[0.0], limits])[per_run] - worst.ravel()])
    bounds = [(-radius, radius)] * count + [(None, None)] + [(0, None)] * (2 * extra)
    found = linprog(cost, np.vstack([of_mean, of_worst]), room, bounds=bounds, method="highs")
    if found.x is None:
        raise RuntimeError(f"the linearised tuning problem could not be solved: {found.message}")
    return found.x[:count], float(found.fun + objective.mean * mean[0])
