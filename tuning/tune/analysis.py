"""What the tuned gains show: sensitivities of requirements to gains, active limits, identifiability."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .methods import sqp
from .methods.objective import TOLERANCE, Requirement
from .methods.quadratic import Unsolved
from .tuner import Tuner

NEAR = 2e-3  # a limit this close to its bound is active
ALIKE = 0.99  # cosine beyond which two gains do the same to every metric of every scenario


class Standing(NamedTuple):
    """Where one requirement stands at the tuned gains."""

    requirement: Requirement
    value: float  # in the metric's unit
    level: float  # of a goal relative to the start, of a limit relative to its bound
    slopes: np.ndarray  # (K,), relative change of the value per relative change of a gain
    price: float | None  # of a limit: share of the goal by which it falls if that is relaxed by 1 %; None: not known

    @property
    def limit(self) -> bool:
        """Whether it is a limit."""
        return self.price is None or not np.isnan(self.price)

    @property
    def active(self) -> bool:
        """Whether it is a limit that binds."""
        return self.limit and abs(self.level - 1) < NEAR

    @property
    def met(self) -> bool:
        """Whether it is met."""
        return not self.limit or self.level <= 1 + TOLERANCE


class Identifiability(NamedTuple):
    """How well the metrics of the ensemble tell the gains apart."""

    strength: np.ndarray  # (K,), singular values of the relative slopes, largest first, per scenario and metric
    weakest: np.ndarray  # (K,), the combination of relative changes that is felt least; of length 1
    alike: list[tuple[int, int, float]]  # pairs of gains with nearly the same effect, and its cosine


class Findings(NamedTuple):
    """All of it."""

    names: tuple[str, ...]
    standings: list[Standing]
    identifiability: Identifiability


def analyse(tuner: Tuner, z: Any, moving: np.ndarray | None = None) -> Findings:
    """What one look at the Jacobian at z says of the gains that are `moving` (K,); None: of all."""
    values, ok, slopes = (np.asarray(x) for x in tuner.push(z, tuner.scenarios()))
    chosen = _chosen(slopes, moving)
    model, scale = (values, ok, slopes[chosen]), tuner.gains.scales(z)[chosen]
    names = tuple(tuner.gains.names[k] for k in chosen)
    return Findings(names, standings(tuner, model, scale), identifiability(tuner, model, scale))


def _chosen(slopes: Any, moving: np.ndarray | None) -> np.ndarray:
    """Places of the gains that are looked at."""
    return np.arange(len(slopes)) if moving is None else np.flatnonzero(moving)


def standings(tuner: Tuner, model: tuple[np.ndarray, ...], scale: np.ndarray) -> list[Standing]:
    """Of every requirement: its level, its slope in every gain, and of a limit its price.

    No price is known where the linear problem is not solved.
    """
    objective, reference = tuner.objective, tuner.baseline
    levels, relative = relative_slopes(tuner, model, scale)
    goal = float(np.dot([g.value for g in objective.goals], levels[: len(objective.goals)]))
    limits = levels[len(objective.goals) :]  # one that is not met has no price: the goal does not pay for it
    try:
        solution = sqp.solve(model, objective._replace(penalty=sqp.DEAREST), reference, radius=0.01)
        paid = np.where(limits <= 1 + NEAR, 0.01 * solution.prices / goal, 0.0).tolist()
    except Unsolved:
        paid = [None] * len(limits)
    prices = [np.nan] * len(objective.goals) + paid
    units = objective.units(reference)
    return [
        Standing(r, float(r.told(level, unit)), float(level), slope, price)
        for r, level, unit, slope, price in zip(objective.requirements, levels, units, relative, prices, strict=True)
    ]


def relative_slopes(tuner: Tuner, model: tuple[Any, ...], scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Levels of the requirements (R,) and their relative change per relative change of each gain (R, K).

    A level of zero has no relative change: there it is the absolute one.
    """
    values, ok, slopes = model
    level = jax.jit(lambda v: (tuner.objective.levels(v, jnp.asarray(ok), tuner.baseline),) * 2)
    weights, levels = (np.asarray(x) for x in jax.jit(jax.jacrev(level, has_aux=True))(jnp.asarray(values)))
    parts = levels - tuner.objective.turned  # of a limit from below minus its statistic, by its unit
    return levels, np.einsum("rmb,kmb->rk", weights, slopes) * scale / np.where(parts == 0, 1.0, parts)[:, None]


def identifiability(tuner: Tuner, model: tuple[np.ndarray, ...], scale: np.ndarray) -> Identifiability:
    """From the slopes of every metric that matters in every scenario, each relative to its own reference."""
    _, ok, slopes = model
    real = ok & (tuner.objective.shares(ok.size) > 0)
    table = slopes[:, :, real] / tuner.objective.scale(tuner.baseline)[None, :, None] * scale[:, None, None]
    matrix = table.reshape(len(scale), -1).T
    _, found, rows = np.linalg.svd(matrix / np.sqrt(len(matrix)))
    strength = np.pad(found, (0, len(scale) - len(found)))
    length = np.linalg.norm(matrix, axis=0)
    cosine = matrix.T @ matrix / np.maximum(np.outer(length, length), 1e-300)
    pairs = [(i, j, float(cosine[i, j])) for i in range(len(scale)) for j in range(i) if abs(cosine[i, j]) > ALIKE]
    return Identifiability(strength, rows[-1] * np.sign(rows[-1][np.argmax(np.abs(rows[-1]))]), pairs)


def conflict(tuner: Tuner, z: Any, moving: np.ndarray | None = None) -> list[tuple[Requirement, float, float]]:
    """Limits that the gains that are `moving` (K,), or all, cannot keep together.

    Each with its level and its share in what holds the excess up. Where no change of the gains lowers the sum of
    excesses, the slopes of these limits cancel: what lowers one raises another. Elsewhere, and where the linear problem
    is not solved, there is nothing to show and the list is empty.
    """
    values, ok, slopes = tuner.push(z, tuner.scenarios())
    model = (values, ok, np.asarray(slopes)[_chosen(slopes, moving)])
    objective = tuner.objective._replace(goals=tuple(g._replace(value=0.0) for g in tuner.objective.goals), penalty=1.0)
    levels = np.asarray(tuner.weigh(values, ok, slopes)[0].levels)[len(objective.goals) :]
    try:
        solution = sqp.solve(model, objective, tuner.baseline, radius=0.01)
    except Unsolved:
        return []  # by slopes that tell nothing
    if solution.cost < 0.999 * np.maximum(levels - 1, 0).sum():
        return []  # it could still be lowered: no conflict is shown
    prices = solution.prices
    return [
        (r, float(level), float(price))
        for r, level, price in zip(objective.limits, levels, prices, strict=True)
        if price > 1e-6 or level > 1 + TOLERANCE
    ]
