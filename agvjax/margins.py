"""How far a loop is from instability, as numbers that can be limited: the tightest along each run of a batch.

In NumPy: it is called with numbers, not under `jax.jit`. `agvjax margins` hands the same loops to python-control, which
takes a frequency at a time and is some hundred times slower: too slow for what is asked at every step of a tuning.
"""

from __future__ import annotations

import dataclasses

import jax
import numpy as np

from .evaluate import Batch
from .linear import GROWTH, SLOWEST, Loops, linearised, steady
from .metric_table import LONGEST, MOST, LoopMargins, Metrics
from .metrics import Criteria
from .protocols import Law
from .scenario import Scenario
from .timing import Timing

Matrices = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # A, B, C, D

FREQUENCIES = 60  # up to half the sampling frequency; between them the response is interpolated
CHUNK = 32  # instants at a time, whose matrices fit into a cache's reach


def with_margins(
    metrics: Metrics, controller: Law | Batch, batch: Scenario | Batch, *, timing: Timing, criteria: Criteria
) -> Metrics:
    """Metrics of `evaluate` with the margins of the loop besides, where the criteria ask for these.

    The loop is linearised at `criteria.instants` control instants after `criteria.late`.

    Raises:
        ValueError: the run has not so many instants.
    """
    if not criteria.loop:
        return metrics
    loops = linearised(controller, batch, timing=timing, first=float(criteria.late), count=criteria.instants)
    return dataclasses.replace(metrics, loop=margins(loops))


def margins(loops: Loops) -> LoopMargins:
    """The tightest margins of a run, or of each run of a batch, over instants and actuators.

    Instants that are not `steady` do not count; where none is, or a loop is unstable, every margin is 0 and the
    sensitivity `MOST`. Only what is faster than the vehicle turns or changes its speed counts, as in
    `agvjax margins`.

    Source: Astrom and Murray, Feedback Systems, sec. 10.3; of one actuator's loop with the others closed,
    1 + L_i = 1 / [(I - G)^-1]_ii.
    """
    if np.ndim(loops.A) == 4:
        return tightest(at_instants(loops))
    return jax.tree.map(lambda x: x[0], margins(Loops(*(np.asarray(x)[None] for x in loops))))


def at_instants(loops: Loops, which: np.ndarray | None = None) -> LoopMargins:
    """The margins of V runs at each instant (V, K), over actuators; NaN where an instant is not looked at.

    These are the `steady` ones, or those that `which` (V, K) names.
    """
    runs = Loops(*(np.asarray(x) for x in loops))
    kept = np.asarray(steady(runs)) if which is None else which
    found = {field.name: np.full(kept.shape, np.nan) for field in dataclasses.fields(LoopMargins)}
    places = np.argwhere(kept)
    for rows in np.split(places, range(CHUNK, len(places), CHUNK)) if len(places) else ():
        v, k = rows.T
        parts = [x[v, k].astype(float) for x in (runs.A, runs.B, runs.C, runs.D)]
        for name, values in _instants(np.broadcast_to(runs.period, len(kept))[v], *parts, runs.changing[v, k]).items():
            found[name][v, k] = values
    return LoopMargins(**found)


def tightest(found: LoopMargins) -> LoopMargins:
    """Of what `at_instants` has the tightest of each run (V,), as `margins` says."""
    some = ~np.isnan(found.delay_margin).all(axis=1)  # a run of which nothing can be said is taken for one without any
    least = {n: np.where(some, np.min(np.where(np.isnan(x), np.inf, x), axis=1), 0) for n, x in vars(found).items()}
    peak = np.max(np.where(np.isnan(found.sensitivity), 0, found.sensitivity), axis=1)
    return LoopMargins(**{**least, "sensitivity": np.where(some, peak, MOST)})


def _instants(period: np.ndarray, *parts: np.ndarray) -> dict[str, np.ndarray]:
    """The tightest of P instants, (P,) each, of their matrices and, last, how fast the loop itself changes."""
    *matrices, changing = parts
    slowest, fastest = np.log(np.maximum(SLOWEST, changing)), np.log(np.pi / period * (1 - 1e-6))
    omega = np.exp(slowest + (fastest - slowest) * np.linspace(0, 1, FREQUENCIES)[:, None]).T  # (P, F)
    response = _response(np.exp(1j * omega * period[:, None]), *matrices)
    stable = growth(period, *whole(*matrices)) <= GROWTH + changing
    found = _tightest(omega[:, :, None], response)
    sensitivity = np.where(stable, found.pop("sensitivity"), MOST)
    return {name: np.where(stable, x, 0) for name, x in found.items()} | {"sensitivity": sensitivity}


def _response(z: np.ndarray, A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray) -> np.ndarray:
    """L of each actuator with all others closed, (P, F, m), at z (P, F)."""
    late = z[:, :, None] ** -np.arange(B.shape[1])  # (P, F, Q + 1)
    inward, direct = (np.einsum("pfq,pq...->pf...", late, x) for x in (B, D))
    resolvent = z[:, :, None, None] * np.eye(A.shape[-1]) - A[:, None]
    opened = C[:, None] @ np.linalg.solve(resolvent, inward) + direct
    closed = np.linalg.inv(np.eye(D.shape[-1]) - opened)
    return 1 / np.diagonal(closed, axis1=2, axis2=3) - 1


def _tightest(omega: np.ndarray, response: np.ndarray) -> dict[str, np.ndarray]:
    """Margins over frequencies (P, F, 1) and actuators (P, F, m), interpolated between the frequencies."""
    size, left, right = np.log(np.abs(response)), response[:, :-1], response[:, 1:]

    def crossing(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where x changes its sign on the way to the next frequency, and how far on the way."""
        there = (x[:, :-1] > 0) != (x[:, 1:] > 0)
        return there, x[:, :-1] / np.where(there, x[:, :-1] - x[:, 1:], 1.0)

    def least(there: np.ndarray, values: np.ndarray, most: float) -> np.ndarray:
        return np.min(np.where(there, np.minimum(values, most), most), axis=(1, 2))

    with np.errstate(all="ignore"):  # of what is between frequencies without a crossing nothing is used
        there, share = crossing(size)
        at = omega[:, :-1] * (omega[:, 1:] / omega[:, :-1]) ** share
        phase = np.angle(left) + share * np.angle(right / left) + np.pi  # above -180 degrees
        upside, across = crossing(np.imag(response))
        gain = np.exp(-(size[:, :-1] + across * np.diff(size, axis=1)))
        raised = upside & (np.real(left) < 0) & (gain > 1)
        return {
            "gain_margin": least(raised, gain, MOST),
            "phase_margin": least(there, np.abs((phase + np.pi) % (2 * np.pi) - np.pi), np.pi),
            "delay_margin": least(there, phase % (2 * np.pi) / at, LONGEST),
            "sensitivity": np.minimum(np.max(1 / np.abs(1 + response), axis=(1, 2)), MOST),
        }


def whole(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray) -> Matrices:
    """State spaces of P instants, the inputs under way as states: A, B, C, D from v_0 to u, each with P in front."""
    count, late, n, m = len(A), B.shape[1] - 1, *B.shape[2:]
    size = n + m * late
    whole_A, whole_B = np.zeros((count, size, size)), np.zeros((count, size, m))
    whole_A[:, :n], whole_B[:, :n] = np.concatenate([A, *np.moveaxis(B[:, 1:], 1, 0)], axis=2), B[:, 0]
    if late:
        whole_A[:, n + m :, n:-m] = np.eye(m * (late - 1))
        whole_B[:, n : n + m] = np.eye(m)
    return whole_A, whole_B, np.concatenate([C, *np.moveaxis(D[:, 1:], 1, 0)], axis=2), D[:, 0]


def growth(period: float | np.ndarray, A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray) -> np.ndarray:
    """How fast [1/s] the fastest mode of a closed loop grows, of `whole` matrices; below 0 all fade."""
    closed = A + B @ np.linalg.solve(np.eye(D.shape[-1]) - D, C)
    return np.log(np.max(np.abs(np.linalg.eigvals(closed)), axis=-1)) / period
