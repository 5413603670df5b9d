"""A first guess of the state in which every stretch of a log begins."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from .log import POSE, Log
from .model import Model
from .segments import Segments

FIRST = 0.3  # s, whose measurements make the guess


def first_states(model: Model, logs: Sequence[Log], segments: Segments) -> np.ndarray:
    """A guess of every stretch's state (S, n), from straight lines through the first measurements.

    What rolls goes aside at its reference point as fast as it turns: that the heading tells, which a short lever L of
    the velocity would drown in noise.
    """
    guesses, lever = [], model.scenario.plant.lever()
    for rows, live, which in zip(segments.rows, segments.live, segments.log, strict=True):
        log = logs[which]
        early = rows[(rows >= 0) & (live > 0)]
        early = early[log.t[early] < log.t[early[0]] + FIRST]
        t = log.t[early] - log.t[early[0]]
        (vx, x), (vy, y), (turn, heading) = (_line(t, log.measured[name][early]) for name in POSE)
        if lever is not None:
            c, s = np.cos(heading), np.sin(heading)
            along, across = vx * c + vy * s, float(lever) * turn
            vx, vy = along * c - across * s, along * s + across * c
        guesses.append([x, y, heading, vx, vy, turn])
    return np.asarray(jax.vmap(model.start)(jnp.asarray(guesses)))


def _line(t: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Slope of the straight line through measurements, and its value at t = 0."""
    fine = np.isfinite(value)
    value = value[fine]
    return np.polyfit(t[fine], value, 1) if fine.sum() > 2 else np.array([0.0, value[0] if value.size else 0.0])
