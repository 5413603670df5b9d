"""The closed loop as a problem of rare failures: normal numbers in, how far beyond its bounds a vehicle ends out."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import agvjax
from agvjax.evaluate import BLOCK
from agvjax.protocols import Law

from ...config.settings import Config
from ..design import Design, Leaves
from .problem import FARTHEST, NEAREST, Problem

LEAST = 4  # blocks of vehicles rolled out at once, and one for every device where there are more
CLIMB = 16  # vehicles whose tangents are rolled out together
SIDE = 1e-3  # of a normal number, either way, for the slope of a leaf in it

Judge = Callable[[Leaves], dict[str, Array]]  # leaves of B vehicles -> `ok` and metrics (B,)
Rollout = Callable[[Leaves], tuple[Array, Array]]  # leaves of B vehicles -> metrics (M, B), ok (B,)


def vehicles(plan: Design, u: np.ndarray) -> dict[str, np.ndarray]:
    """Leaves (n, ...) of the vehicles behind normal numbers u (n, D), one for each axis of the design."""
    from scipy.special import ndtr  # late: half a second that few runs need

    return plan.leaves(ndtr(np.clip(u, -FARTHEST, FARTHEST)))


def problem(  # long: two functions that share what was compiled
    config: Config,
    plan: Design,
    law: Law,
    bounds: Mapping[str, float],
    devices: int | None = None,
) -> Problem:
    """What fails of a sweep with one law.

    The level is the largest ratio of a metric to its bound, less 1; infinite for a run that diverges. It is above 0
    where `findings.failed` says that the run fails, and only there.

    Args:
        config: of the sweep.
        plan: its scenarios, all axes sampled.
        law: the controller.
        bounds: beyond which a run has failed, by metric.
        devices: of JAX, that share the work; None: all.
    """
    rollout = functools.partial(_rollout, judge(config, plan, agvjax.check(law), tuple(bounds), devices))
    looking, climbing = jax.jit(rollout), jax.jit(functools.partial(_climb, rollout))
    limits, many = np.array(list(bounds.values())), together(devices)

    def look(u: np.ndarray) -> np.ndarray:
        found = []
        for rows in _blocks(len(u), many):
            values, ok = looking(_cast(vehicles(plan, u[rows])))
            found.append(_levels(np.asarray(values), np.asarray(ok), limits))
        return np.concatenate(found)[: len(u)]

    def climb(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found, steep = [], []
        for rows in _blocks(len(u), CLIMB):
            values, ok, slopes = map(np.asarray, climbing(_cast(vehicles(plan, u[rows])), _tangents(plan, u[rows])))
            found.append(_levels(values, ok, limits))
            steep.append(_steepest(values, slopes, limits))
        return np.concatenate(found)[: len(u)], np.concatenate(steep)[: len(u)]

    return Problem(len(plan.sampled), look, climb)


def together(devices: int | None) -> int:
    """How many vehicles are rolled out at once: as many blocks for every device, at least `LEAST` in all."""
    count = jax.local_device_count() if devices is None else devices
    return BLOCK * count * -(-LEAST // count)


def _steepest(values: np.ndarray, slopes: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """Slopes (B, D) of the level: of the metric that is highest over its bound; 0 without bounds."""
    if not len(limits):
        return np.zeros((values.shape[1], len(slopes)))
    first = np.argmax(np.nan_to_num(_ratios(values, limits), nan=np.inf), axis=0)
    return np.asarray(slopes[:, first, np.arange(len(first))] / limits[first], float).T


def judge(config: Config, plan: Design, law: Law, names: Sequence[str], devices: int | None = None) -> Judge:
    """What makes `ok` and the named metrics (n,) of leaves (n, ...).

    Blocks have one size, so that results hang on no number of `devices`.
    """
    criteria = agvjax.Criteria.of(tuple(names), like=config.judged())

    def judged(leaves: Leaves) -> dict[str, Array]:
        lawful, values = plan.split(leaves)
        metrics = agvjax.evaluate(
            agvjax.batch(law, lawful) if lawful else law,
            agvjax.batch(plan.scenario, values) if values else plan.scenario,
            criteria=criteria,
            block=BLOCK,
            devices=devices,
            **config.timing("sweep"),
        )
        return {"ok": metrics.ok, **{name: metrics[name] for name in names}}

    return judged


def _rollout(judged: Judge, leaves: Leaves) -> tuple[Array, Array]:
    found = judged(leaves)
    rows = [x for name, x in found.items() if name != "ok"]
    return (jnp.stack(rows) if rows else jnp.zeros((0, *found["ok"].shape))), found["ok"]


def _climb(rollout: Rollout, leaves: Leaves, tangents: Leaves) -> tuple[Array, Array, Array]:
    """Metrics (M, B), ok (B,) and slopes (D, M, B) along every normal number."""

    def along(tangent: Leaves) -> tuple[tuple[Array, Array], Array]:
        (values, ok), (slopes, _) = jax.jvp(rollout, (leaves,), (tangent,))
        return (values, ok), slopes

    (values, ok), slopes = jax.vmap(along, out_axes=((None, None), 0))(tangents)
    return values, ok, slopes


def _ratios(values: np.ndarray, limits: np.ndarray) -> np.ndarray:
    return np.asarray(values, float) / limits[:, None]


def _levels(values: np.ndarray, ok: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """Levels (B,) of metrics (M, B): the sign decided by the comparison itself, not by a rounded ratio."""
    beyond = ~(np.asarray(values, float) <= limits[:, None])
    failed = ~ok | beyond.any(axis=0)
    height = np.max(_ratios(values, limits), axis=0, initial=0.0) - 1.0
    height = np.where(ok & ~np.isnan(height), height, np.inf)
    return np.where(failed, np.maximum(height, NEAREST), np.minimum(height, 0.0))


def _tangents(plan: Design, u: np.ndarray) -> dict[str, np.ndarray]:
    """By leaf, how vehicles change with each normal number, (D, n, ...): central differences."""
    sides = []
    for direction in np.eye(u.shape[1]):
        up, down = (vehicles(plan, np.clip(u + s * SIDE * direction, -FARTHEST, FARTHEST)) for s in (1, -1))
        sides.append({name: (up[name] - down[name]) / (2 * SIDE) for name in up})
    return _cast({name: np.stack([side[name] for side in sides]) for name in sides[0]})


def _blocks(count: int, size: int) -> list[np.ndarray]:
    """Rows of blocks of one size, so that one compilation serves any number; the last block repeats one."""
    return [np.minimum(np.arange(first, first + size), count - 1) for first in range(0, count, size)]


def _cast(leaves: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    dtype = jnp.result_type(float)
    return {name: np.asarray(x, dtype) for name, x in leaves.items()}
