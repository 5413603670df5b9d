"""Another drive, predicted: a start from what was measured for a second, then nothing but the commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import numpy as np

import agvjax

from .fit import Fit, weighed
from .log import POSE, Log
from .model import compiled
from .parameters import SINUSOID, sinusoidal
from .plain import Plain, driven, led
from .segments import Segments, cut, leaps, widened
from .states import first_states

SEEN = 1.0  # s, from which the state is found at which a prediction begins
SETTLED = 6


class Prediction(NamedTuple):
    """How far from what was recorded the model leads in W windows."""

    log: str
    horizon: float  # s
    windows: int
    worst: float  # m, distance of the positions, largest within the horizon
    rms: float  # m
    t: np.ndarray  # (W, K), s since the prediction began
    errors: np.ndarray  # (W, K), m; NaN before that and where nothing was measured
    plain: Mapping[str, float] = {}  # m, rms of plain models over the same windows, by name


def windows(log: Log, horizon: float, memory: float, gap: float) -> int:
    """How many predictions a log is long enough for."""
    return len(_ahead(log, horizon, memory, gap)[0].t)


def _ahead(
    log: Log, horizon: float, memory: float, gap: float, before: float = 0.0
) -> tuple[Segments, np.ndarray, np.ndarray]:
    """W windows, how long after its beginning each row is (W, K) [s], and whether it counts (W, K).

    A window counts where a position was measured in it that is no outlier.
    """
    segments, _ = cut([log], SEEN, memory, gap, horizon, before)
    live = (segments.live > 0) & (segments.rows >= 0)
    first = np.min(segments.t, axis=1, where=live, initial=np.inf)
    since = segments.t - first[:, None] - SEEN
    places = [list(log.measured).index(name) for name in ("x", "y")]
    sound = np.isfinite(log.measured["x"] + log.measured["y"]) & ~leaps(log)[:, places].any(axis=1)
    measured = sound[np.maximum(segments.rows, 0)]
    counted = live & (since > -1e-9) & measured
    some = counted.any(axis=1)
    return Segments(*(x[some] for x in segments)), since[some], counted[some]


def _brief(segments: Segments, fit: Fit, step: float) -> Segments:
    """What is seen of each window, in the shape that the fit was compiled for."""
    width = fit.segments.t.shape[1]
    if segments.t.shape[1] > width and segments.weight[:, width:].any():  # of a higher rate than the fitted ones
        return weighed(segments, fit.sigma)
    cut_off = Segments(*(x[:, :width] if x.ndim > 1 else x for x in segments))
    return weighed(widened(cut_off, width, step), fit.sigma)


def predict(
    fit: Fit, logs: Sequence[Log], horizon: float, memory: float, gap: float, beside: Sequence[Plain] = ()
) -> list[Prediction]:
    """Logs ahead, by the fit and by plain models. A sinusoid of the disturbance is left out: its phase is unknown.

    Each must be long enough for a window: see `windows`.
    """
    names = [q.name for q in fit.parameters]
    waves = np.array([sinusoidal(name) and name.endswith(SINUSOID) for name in names])
    p, function = np.where(waves, 0.0, fit.p), compiled(fit.model)
    residuals = jax.jit(jax.vmap(fit.model.residual, in_axes=(None, 0, 0)))
    predictions = []
    for log in logs:
        segments, since, counted = _ahead(log, horizon, memory, gap, fit.model.run_up(memory))
        states, brief = first_states(fit.model, [log], segments), _brief(segments, fit, log.step)
        for _ in range(SETTLED):
            states = function(p, states, brief).states
        residual = np.asarray(residuals(p, states, segments))
        x, y = (fit.model.channels.index(name) for name in ("x", "y"))
        error = np.where(counted, np.hypot(residual[..., x], residual[..., y]), np.nan)
        worst, rms = float(np.nanmax(error)), float(np.sqrt(np.nanmean(error**2)))
        others = {model.name: _rms_of(model, fit.model.scenario.plant, log, segments, counted) for model in beside}
        plain = {name: rms for name, rms in others.items() if np.isfinite(rms)}  # of a log that shows no pose none is
        predictions.append(Prediction(log.name, horizon, len(error), worst, rms, since, error, plain))
    return predictions


def _rms_of(model: Plain, plant: agvjax.Plant, log: Log, windows: Segments, counted: np.ndarray) -> float:
    """The error of a plain model over the same windows [m]; each sees what the fit sees."""
    motion, squares = driven(model, plant, log), []
    places = [list(log.measured).index(name) for name in POSE]
    for rows, live, weight, counts in zip(windows.rows, windows.live, windows.weight, counted, strict=True):
        there = (rows >= 0) & (live > 0)
        at, seen = rows[there], (weight[there][:, places] > 0).all(axis=1)
        if seen.any():
            off = led(motion, log, at, seen) - np.column_stack([log.measured["x"], log.measured["y"]])[at]
            squares.append((off**2).sum(axis=1)[counts[there]])
    return float(np.sqrt(np.mean(np.concatenate(squares)))) if squares else np.nan
