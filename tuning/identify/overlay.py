"""A log and what the model makes of it, side by side, for viewers of recordings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..io.curves import Track
from .fit import Fit
from .log import POSE, Log


def overlay(logs: Sequence[Log], fit: Fit) -> dict[str, Track]:
    """Of every log the track `measured` and the track `model`; of several, `log1/measured` and so on.

    The model begins every stretch anew, in the state that fits it best. Beside the measured pose stands what was sent,
    beside the model's how far off it was [m, rad], NaN where nothing was measured or it was left out as an outlier.
    """
    tracks = {}
    for i, both in enumerate(compared(logs, fit)):
        prefix = f"log{i + 1}/" if len(logs) > 1 else ""
        tracks |= {f"{prefix}{which}": track for which, track in zip(("measured", "model"), both, strict=True)}
    return tracks


def compared(logs: Sequence[Log], fit: Fit) -> list[tuple[Track, Track]]:
    """Of every log what was measured and what the model makes of it."""
    return [(_measured(log), _predicted(log, fit, i)) for i, log in enumerate(logs)]


def _measured(log: Log) -> Track:
    pose = np.column_stack([log.measured[name] for name in POSE])
    known = np.isfinite(pose).all(axis=1)
    sent = {f"sent/{name}": x[known] for name, x in zip(log.sent.names, log.sent.values.T, strict=True)}
    return Track(log.t[known], pose[known], sent, {})


def _predicted(log: Log, fit: Fit, which: int) -> Track:
    segments, places = fit.segments, [fit.model.channels.index(name) for name in POSE]
    there = (segments.live > 0) & (segments.rows >= 0) & (segments.log == which)[:, None]
    rows = segments.rows[there]
    off = fit.sums.residual[there][:, places]
    pose = segments.seen[there][:, places] - off
    off = np.where(segments.weight[there][:, places] > 0, off, np.nan)
    order = np.argsort(rows, kind="stable")
    errors = {"error/position": np.hypot(off[:, 0], off[:, 1])[order], "error/heading": off[order, 2]}
    return Track(log.t[rows[order]], pose[order], errors, {"error/position": "m", "error/heading": "rad"})
