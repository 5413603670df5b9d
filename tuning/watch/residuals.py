"""What a log's residuals say against a model, by slopes of its likelihood; and what they would say of simulated logs.

Residuals are those of stretches that begin in states of their own, as in `identify`: of a pose at 50 Hz the residual of
a single step is nearly all noise, and what a moved number does in it adds up along a stretch.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..identify.fit import SETTLED, Fit
from ..identify.model import CHUNK, Model, compiled
from ..identify.parameters import values, widths
from ..identify.segments import Segments

TOGETHER = 8  # simulated logs computed at once


class Slopes(NamedTuple):
    """How S stretches' residuals turn into how far numbers seem to have moved; the same for every log."""

    into: np.ndarray  # (S, K C, P), of weighed residuals, without what the states of the stretches take up
    weight: np.ndarray  # (S, K, C), roots
    information: np.ndarray  # (P, P), with what is believed without the log
    believed: np.ndarray  # (P,), of it that which is believed without the log
    own: np.ndarray  # (S, K, C), the log's residuals
    spread: np.ndarray  # (S, K, C), what its best fit leaves

    def moved(self, residuals: np.ndarray) -> np.ndarray:
        """How far the numbers seem to have moved (n, P), of the residuals of n logs (n, S, K, C)."""
        weighed = (residuals * self.weight).reshape(len(residuals), *self.into.shape[:2])
        slopes = np.einsum("nsk,skp->np", weighed, self.into, optimize=True)
        return -np.linalg.solve(self.information, slopes.T).T

    def told(self) -> np.ndarray:
        """Share (P,) of what is known of each number, all others known, that the log says."""
        return 1 - self.believed / np.diag(self.information)

    def passed(self) -> np.ndarray:
        """How far numbers seem to move (P, P) by a move of each by 1, a column for each: 1 of it where a log tells."""
        return np.linalg.solve(self.information, self.information - np.diag(self.believed))


def slopes(found: Fit) -> Slopes:
    """The slopes at the numbers that gains were tuned for, of a log and its best fit."""
    model, p = found.model, values(found.parameters)
    function, states = compiled(model), found.sums.states
    sums = found.sums
    for _ in range(2 * SETTLED):
        sums = function(p, states, found.segments)
        states = sums.states
    jacobians = _jacobians(model, p, states, found.segments)  # (S, K, C, P + n)
    root = np.sqrt(found.segments.weight)
    count, size = len(root), p.size
    weighed = (jacobians * root[..., None]).reshape(count, -1, jacobians.shape[-1])
    into = np.stack([_without(own[:, :size], own[:, size:]) for own in weighed])
    believed = widths(found.parameters) ** -2.0
    information = np.einsum("skp,skq->pq", into, into, optimize=True) + np.diag(believed)
    few = np.sqrt(count / max(count - 1, 1))  # the fit has taken one stretch's worth of each number
    return Slopes(into, root, information, believed, sums.residual, found.sums.residual * few)


def _without(columns: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Columns less what a combination of the others makes of them."""
    scale = np.linalg.norm(others, axis=0)
    basis, sizes, _ = np.linalg.svd(others / np.where(scale > 0, scale, 1.0), full_matrices=False)
    basis = basis[:, sizes > 1e-9 * max(sizes.max(initial=0.0), 1e-300)]
    return columns - basis @ (basis.T @ columns)


def _jacobians(model: Model, p: np.ndarray, states: np.ndarray, segments: Segments) -> np.ndarray:
    size = p.size

    def one(p: Array, s: Array, stretch: Segments) -> Array:
        return jax.jacfwd(lambda z: model.residual(z[:size], z[size:], stretch))(jnp.concatenate([p, s]))

    function, count, parts = jax.jit(jax.vmap(one, in_axes=(None, 0, 0))), len(states), []
    for rows, part in _parts(segments):
        parts.append(np.asarray(function(jnp.asarray(p), jnp.asarray(states)[rows], part)))
    return np.concatenate(parts)[:count]


def _parts(segments: Segments) -> Iterator[tuple[np.ndarray, Segments]]:
    """Some stretches at a time, so many that one compilation serves logs of any length; the last repeats one."""
    count = len(segments.t)
    for first in range(0, count, CHUNK):
        rows = np.minimum(np.arange(first, first + CHUNK), count - 1)
        yield rows, Segments(*(np.asarray(x)[rows] for x in segments))


def simulated(found: Fit, seen: Slopes, vehicles: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Residuals (n, S, K, C) of logs of n vehicles (n, P) that were given the same commands.

    Their noise is what the log's best fit leaves, of every stretch with a sign that is drawn: coloured as the log's is.
    """
    model, states, segments = found.model, found.sums.states, found.segments
    one = jax.vmap(model.residual, in_axes=(None, 0, 0))
    many = jax.jit(jax.vmap(one, in_axes=(0, None, None)))
    count, logs = len(states), []
    for first in range(0, len(vehicles), TOGETHER):
        rows = np.minimum(np.arange(first, first + TOGETHER), len(vehicles) - 1)
        at = jnp.asarray(vehicles[rows])
        parts = [np.asarray(many(at, jnp.asarray(states)[which], part)) for which, part in _parts(segments)]
        logs.append(np.concatenate(parts, axis=1)[:, :count])
    off = np.concatenate(logs)[: len(vehicles)]
    signs = random.choice([-1.0, 1.0], (len(vehicles), count, 1, 1))
    return seen.own[None] - off + signs * seen.spread[None]


def steps(residuals: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Rms (n, C) of the change of residuals (n, S, K, C) from one measurement to the next: one step ahead."""
    kept = weight > 0  # (S, K, C)
    found = np.empty((len(residuals), residuals.shape[-1]))
    for c in range(residuals.shape[-1]):
        squares, count = np.zeros(len(residuals)), 0
        for s in range(kept.shape[0]):
            rows = np.flatnonzero(kept[s, :, c])
            change = np.diff(residuals[:, s, rows, c], axis=1)
            squares, count = squares + (change**2).sum(axis=1), count + change.shape[1]
        found[:, c] = np.sqrt(squares / max(count, 1))
    return found
