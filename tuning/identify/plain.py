"""Two plain models beside the identified one, learned from the same logs: what a fit must do better than.

Speed, sideways speed and yaw rate are linear in the commands, at once or after a first-order lag; of a vehicle that is
driven by velocities in the twist that it is sent. They know no deadzone, no delay and no friction.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

import agvjax
from agvjax.plants.base import Driven

from .log import POSE, Log
from .segments import leaps

LAGS = 0.02 * 10 ** np.linspace(0.0, 3.4, 35)  # s, that are tried, to 50 s: of torques speed is nearly the integral
REACH = 0.5  # s, from pose to pose, by which a plain model is learned
SETTLES = 1.0  # s, a lag from which on a window begins with what was measured, not with what was commanded before
AT_ONCE, LAGGING = "kinematics that obey at once", "a first-order lag"


class Plain(NamedTuple):
    """How the body moves by what is commanded, each part of its twist (along, across, turn) by itself."""

    name: str
    gains: np.ndarray  # (3, k), of the commands
    lags: np.ndarray  # (3,), s; 0: at once


class Motion(NamedTuple):
    """A log's twist by a plain model, which is along, across and turn."""

    steps: np.ndarray  # (N, 3), how far it leads from each row to the next: m, m, rad
    lags: np.ndarray  # (3,), s


def plain_models(plant: agvjax.Plant, logs: Sequence[Log]) -> list[Plain]:
    """Both, learned from the logs; none where these are too short."""
    tables = [_increments(log) for log in logs]
    targets = np.concatenate([target for _, _, target in tables])
    commands = [commanded(plant, log) for log in logs]
    models = []
    if len(targets) <= 4 * commands[0].shape[1]:
        return []
    for name, lags in ((AT_ONCE, np.zeros(1)), (LAGGING, LAGS)):
        sums = []  # by lag (pairs, k): the commands, lagged, summed up from pose to pose
        for log, u, (first, last, _) in zip(logs, commands, tables, strict=True):
            run = np.concatenate([np.zeros((1, *u.shape[1:], len(lags))), np.cumsum(_lagged(log, u, lags), axis=0)])
            sums.append(run[last] - run[first])
        table = np.concatenate(sums)
        solved = [np.linalg.lstsq(table[..., i], targets, rcond=None)[0] for i in range(len(lags))]
        left = np.array([_size(targets - table[..., i] @ gains) for i, gains in enumerate(solved)])
        best = left.argmin(axis=0)
        gains = np.stack([solved[i][:, part] for part, i in enumerate(best)])
        models.append(Plain(name, gains, lags[best]))
    return models


def twists(log: Log) -> np.ndarray:
    """Speed along [m/s], aside [m/s] and yaw rate [rad/s] over every `REACH` of a log, by its poses: (n, 3)."""
    first, last, moved = _increments(log)
    return moved / (log.t[last] - log.t[first])[:, None]


def commanded(plant: agvjax.Plant, log: Log) -> np.ndarray:
    """What plain models are linear in (N, k): the twist that is sent to what is driven by velocities, or commands."""
    if not isinstance(plant, Driven):
        return log.inputs
    still = np.array(plant.body(jnp.zeros(2)), float)
    twist = plant.body(jnp.asarray(log.inputs.T))
    return np.column_stack([np.broadcast_to(np.asarray(part, float), log.t.shape) for part in twist]) - still


def driven(plain: Plain, plant: agvjax.Plant, log: Log) -> Motion:
    """How a log's commands move the body from row to row."""
    lagged = _lagged(log, commanded(plant, log), plain.lags)
    return Motion(np.einsum("nkp,pk->np", lagged, plain.gains), plain.lags)


def led(motion: Motion, log: Log, rows: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Where a plain model has the vehicle at consecutive rows (K,) of a log, of which it sees the pose of some: (K, 2).

    It begins where its own motion fits what it sees best; where its lag is long, so does its speed.
    """
    t = log.t[rows] - log.t[rows[0]]
    pose = np.column_stack([log.measured[name] for name in POSE])[rows]
    known = seen & np.isfinite(pose).all(axis=1)
    fade = np.column_stack([_faded(t, lag) for lag in motion.lags])  # m for every m/s that it begins faster
    steps = motion.steps[rows]
    turn = np.r_[0.0, np.cumsum(steps[:-1, 2])]
    heading = _begun(turn, fade[:, 2], pose[:, 2], known, motion.lags[2])
    middle = (heading[:-1] + heading[1:]) / 2
    c, s = np.cos(middle), np.sin(middle)
    place = np.zeros((len(t), 2))
    place[1:, 0] = np.cumsum(steps[:-1, 0] * c - steps[:-1, 1] * s)
    place[1:, 1] = np.cumsum(steps[:-1, 0] * s + steps[:-1, 1] * c)
    more = np.diff(fade[:, 0])
    faster = np.concatenate([np.zeros((1, 2)), np.cumsum(np.column_stack([more * c, more * s]), axis=0)])
    off = (pose[:, :2] - place)[known]
    if motion.lags[0] < SETTLES:
        return place + off.mean(axis=0)
    way = faster[known] - faster[known].mean(axis=0)
    quicker = float((way * off).sum() / max((way**2).sum(), 1e-12))
    return place + faster * quicker + (off - quicker * faster[known]).mean(axis=0)


def _begun(moved: np.ndarray, fade: np.ndarray, measured: np.ndarray, known: np.ndarray, lag: float) -> np.ndarray:
    """A motion (K,) begun so that it fits what is known of it: shifted, and of a long lag faster or slower too."""
    off = (measured - moved)[known]
    if lag < SETTLES:
        return moved + off.mean()
    way = fade[known] - fade[known].mean()
    return moved + off.mean() + (fade - fade[known].mean()) * float(way @ off / max(way @ way, 1e-12))


def _faded(t: np.ndarray, lag: float) -> np.ndarray:
    """How far what dies away with a lag leads until t, for 1 at the start."""
    return lag * -np.expm1(-t / lag) if lag else np.zeros_like(t)


def _lagged(log: Log, u: np.ndarray, lags: np.ndarray) -> np.ndarray:
    """Commands (N, k) behind first-order lags (T,) summed up from each row to the next, exactly: (N, k, T) [s]."""
    steps = np.r_[np.diff(log.t), log.step]
    out, state = np.empty((*u.shape, len(lags))), np.zeros((u.shape[1], len(lags)))
    for n, h in enumerate(steps):
        gone = np.where(lags > 0, -np.expm1(-h / np.maximum(lags, 1e-9)), 1.0)
        ahead = u[n][:, None] - state
        out[n] = u[n][:, None] * h - ahead * gone * lags
        state = state + gone * ahead
    return out


def _increments(log: Log) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows at the ends of pieces of about `REACH`, and what was measured from one to the other: along, across, turn."""
    pose = np.column_stack([log.measured[name] for name in POSE])
    places = [list(log.measured).index(name) for name in POSE]
    fine = np.flatnonzero(np.isfinite(pose).all(axis=1) & ~leaps(log)[:, places].any(axis=1))
    if fine.size < 2:
        return fine[:0], fine[:0], np.zeros((0, 3))
    after = np.searchsorted(log.t[fine], log.t[fine] + REACH - 1e-9)
    whole = after < fine.size
    first, last = fine[whole], fine[after[whole]]
    near = log.t[last] - log.t[first] < 2 * REACH
    first, last = first[near], last[near]
    moved = pose[last] - pose[first]
    middle = (pose[last, 2] + pose[first, 2]) / 2
    c, s = np.cos(middle), np.sin(middle)
    along, across = moved[:, 0] * c + moved[:, 1] * s, moved[:, 1] * c - moved[:, 0] * s
    arc = np.sinc(moved[:, 2] / (2 * np.pi))[:, None]  # of which a straight line from end to end is shorter
    return first, last, np.column_stack([np.column_stack([along, across]) / arc, moved[:, 2]])


def _size(left: np.ndarray) -> np.ndarray:
    return np.mean(left**2, axis=0)
