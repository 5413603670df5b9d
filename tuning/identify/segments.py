"""A log cut into short stretches, each of which begins in a state of its own (multiple shooting).

However long a log is and however uncertain the vehicle, a prediction then never has to hold for longer than a stretch.
What the actuators remember at its beginning comes from the commands before it, during which the vehicle stands still in
the model. Nothing reaches across a gap in the log.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .log import Log

STILL = 1e-6
SPIKE, WINDOW = 12.0, 9  # robust standard deviations from the line through so many rows: an outlier


class Segments(NamedTuple):
    """S stretches of up to K rows, as arrays; rows that fill a short one up weigh nothing."""

    t: np.ndarray  # (S, K), s, of each row
    h: np.ndarray  # (S, K), s, until the next row
    inputs: np.ndarray  # (S, K, m), held from row to row
    live: np.ndarray  # (S, K), 0 while only the actuators move, then 1
    seen: np.ndarray  # (S, K, C), what was measured; 0 where nothing was
    weight: np.ndarray  # (S, K, C), 1 where something was measured that counts, else 0
    rows: np.ndarray  # (S, K), the row of the log; -1 for filling
    log: np.ndarray  # (S,), which of several logs


class Counts(NamedTuple):
    """What of a log was used, and what was not."""

    rows: int
    segments: int
    gaps: int  # longer than `gap` usual steps
    warm_up: int  # rows after the beginning and after gaps, from which only commands are taken
    left_over: int  # rows at the end, and between gaps too close to each other
    blank: int  # measurements that were not there
    outliers: int  # measurements left out since they are far from what is around them or from what fits


def cut(logs: Sequence[Log], length: float, memory: float, gap: float, ahead: float = 0.0) -> tuple[Segments, Counts]:
    """Stretches of `length` s, each with the rows of `memory` s before it.

    Args:
        logs: the drives.
        length: of a stretch [s].
        memory: how long actuators remember a command [s].
        gap: a step between rows this many times the usual one is a gap.
        ahead: s that follow each stretch without weight, to be predicted.
    """
    parts = [_cut(log, length, memory, gap, ahead) for log in logs]
    widest = max(part.t.shape[1] for part, _ in parts)
    if not sum(len(part.t) for part, _ in parts):
        return parts[0]
    filled = [widened(part, widest, log.step) for (part, _), log in zip(parts, logs, strict=True)]
    which = np.repeat(np.arange(len(logs)), [len(part.t) for part in filled])
    both = Segments(*(np.concatenate(x) for x in zip(*filled, strict=True)))._replace(log=which)
    return both, Counts(*np.sum([counts for _, counts in parts], axis=0).tolist())


def widened(segments: Segments, width: int, step: float) -> Segments:
    """The same stretches, filled up to a number of rows."""
    filled = []
    for name, value in segments._asdict().items():
        more = [(0, 0), (0, width - segments.t.shape[1])] + [(0, 0)] * (value.ndim - 2)
        fill = {"rows": -1, "h": step}.get(name, 0)
        filled.append(value if name == "log" else np.pad(value, more, constant_values=fill))
    return Segments(*filled)


def thinned(segments: Segments, most: int) -> Segments:
    """At most so many of the stretches, evenly spread."""
    picked = np.unique(np.linspace(0, len(segments.t) - 1, min(most, len(segments.t))).round().astype(int))
    return Segments(*(x[picked] for x in segments))


# long: one pass over the log
def _cut(log: Log, length: float, memory: float, gap: float, ahead: float) -> tuple[Segments, Counts]:
    """Those of one log."""
    channels = tuple(log.measured)
    values = np.column_stack([log.measured[name] for name in channels])
    known, spikes = np.isfinite(values), _spikes(log)
    good = known & ~spikes
    broken = np.flatnonzero(np.diff(log.t) > gap * log.step)
    bounds = list(zip(np.r_[0, broken + 1], np.r_[broken + 1, log.t.size], strict=True))
    places, warm, left = [], 0, 0
    for begin, end in bounds:
        t, first = log.t[begin:end], int(begin)
        start = int(begin + np.searchsorted(t, t[0] + memory))
        warm += min(start, end) - first
        while start < end and log.t[end - 1] >= log.t[start] + length + ahead - 0.5 * log.step:
            stop = int(begin + np.searchsorted(t, log.t[start] + length - 1e-9))
            last = int(begin + np.searchsorted(t, log.t[start] + length + ahead - 1e-9))
            before = int(begin + np.searchsorted(t, log.t[start] - memory))
            places.append((before, start, stop, last))
            start = stop
        left += max(end - start, 0)
    widest = max((last - before for before, _, _, last in places), default=0)
    S, C = len(places), len(channels)
    rows = np.full((S, widest), -1)
    live, weight = np.zeros((S, widest)), np.zeros((S, widest, C))
    for i, (before, start, stop, last) in enumerate(places):
        rows[i, : last - before] = np.arange(before, last)
        live[i, start - before :] = 1.0
        weight[i, start - before : stop - before] = good[start:stop]
    at = np.maximum(rows, 0)
    steps = np.r_[np.diff(log.t), log.step]
    segments = Segments(
        t=np.where(rows >= 0, log.t[at], 0.0),
        h=np.where(rows >= 0, steps[at], log.step),
        inputs=np.where(rows[..., None] >= 0, log.inputs[at], 0.0),
        live=live,
        seen=np.where(known, values, 0.0)[at],
        weight=weight,
        rows=rows,
        log=np.zeros(S, int),
    )
    counts = Counts(log.t.size, S, broken.size, int(warm), int(left), int((~known).sum()), int((spikes & known).sum()))
    return segments, counts


def _spikes(log: Log) -> np.ndarray:
    """Measurements that leap away from the line through their neighbours (N, C)."""
    found = []
    for value in log.measured.values():
        fine = np.isfinite(value)
        leaps = np.zeros(value.size, bool)
        own = value[fine]
        if own.size > WINDOW:
            windows = np.lib.stride_tricks.sliding_window_view(
                np.pad(own, WINDOW // 2, "reflect", reflect_type="odd"), WINDOW
            )
            i, j = np.triu_indices(WINDOW, 1)
            slope = np.median((windows[:, j] - windows[:, i]) / (j - i), axis=1)  # Theil and Sen's line
            line = np.median(windows - slope[:, None] * (np.arange(WINDOW) - WINDOW // 2), axis=1)
            off = own - line
            size = np.abs(off)  # where a channel stands exactly still it says nothing of its noise
            usual = 1.4826 * np.median(size[size > STILL * size.max()]) if size.max() > 0 else np.inf
            leaps[np.flatnonzero(fine)[np.abs(off) > SPIKE * usual]] = True
        found.append(leaps)
    return np.column_stack(found)


def noise(logs: Sequence[Log]) -> np.ndarray:
    """A first guess of every channel's noise (C,), from what neither its value nor its slope explains."""
    guesses = []
    for name in logs[0].measured:
        own = [log.measured[name][np.isfinite(log.measured[name])] for log in logs]
        third = np.concatenate([np.abs(np.diff(value, 3)) for value in own])  # of white noise: sqrt(20) times as large
        guesses.append(max(1.4826 * float(np.median(third)) / np.sqrt(20), 1e-6) if third.size else 1.0)
    return np.array(guesses)
