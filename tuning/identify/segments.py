"""A log cut into short stretches, each of which begins in a state of its own (multiple shooting).

However long a log is and however uncertain the vehicle, a prediction then never has to hold for longer than a stretch.
What the actuators remember at its beginning comes from the commands before it, during which the vehicle stands still in
the model. Nothing reaches across a gap in the log.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .log import Log, white_noise

STILL = 1e-12  # of a value: rounding, not motion
BEND = 3.0  # rows' usual motion, that a spike sticks out by at least
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


def cut(
    logs: Sequence[Log], length: float, memory: float, gap: float, ahead: float = 0.0, before: float = 0.0
) -> tuple[Segments, Counts]:
    """Stretches of `length` s, each with the rows of `memory` s before it.

    Args:
        logs: the drives.
        length: of a stretch [s].
        memory: how long actuators remember a command [s].
        gap: a step between rows this many times the usual one is a gap.
        ahead: s that follow each stretch without weight, to be predicted.
        before: s before each stretch whose rows are taken, if longer than `memory`, as far as there are any.
    """
    parts = [_cut(log, length, memory, gap, ahead, max(memory, before)) for log in logs]
    widest = max(part.t.shape[1] for part, _ in parts)
    if not sum(len(part.t) for part, _ in parts):
        return parts[0]
    filled = [widened(part, widest, log.step) for (part, _), log in zip(parts, logs, strict=True)]
    which = np.repeat(np.arange(len(logs)), [len(part.t) for part in filled])
    both = Segments(*(np.concatenate(x) for x in zip(*filled, strict=True)))._replace(log=which)
    return both, Counts(*np.sum([counts for _, counts in parts], axis=0).tolist())


def widened(segments: Segments, width: int, step: float) -> Segments:
    """The same stretches, filled up to a number of rows."""
    more, fill = (0, width - segments.t.shape[1]), {"rows": -1, "h": step}
    filled = {
        name: np.pad(value, [(0, 0), more, (0, 0)][: value.ndim], constant_values=fill.get(name, 0))
        for name, value in segments._asdict().items()
        if name != "log"
    }
    return segments._replace(**filled)


def with_inputs(segments: Segments, logs: Sequence[Log]) -> Segments:
    """The same stretches with the inputs that their rows have in these logs."""
    at = zip(segments.rows, segments.log, strict=True)
    inputs = [np.where((rows >= 0)[:, None], logs[which].inputs[np.maximum(rows, 0)], 0.0) for rows, which in at]
    return segments._replace(inputs=np.stack(inputs))


def thinned(segments: Segments, most: int) -> Segments:
    """At most so many of the stretches, evenly spread."""
    picked = np.unique(np.linspace(0, len(segments.t) - 1, min(most, len(segments.t))).round().astype(int))
    return Segments(*(x[picked] for x in segments))


# long: one pass over the log
def _cut(log: Log, length: float, memory: float, gap: float, ahead: float, run_up: float) -> tuple[Segments, Counts]:
    """The stretches of one log."""
    values = np.column_stack([*log.measured.values()])
    known, spikes = np.isfinite(values), leaps(log)
    good = known & ~spikes
    broken = np.flatnonzero(np.diff(log.t) > gap * log.step)
    ends = [0, *(broken + 1).tolist(), log.t.size]
    places, warm, left = [], 0, 0
    for begin, end in itertools.pairwise(ends):
        t = log.t[begin:end]
        start = begin + int(np.searchsorted(t, t[0] + memory))
        warm += min(start, end) - begin
        while start < end and log.t[end - 1] >= log.t[start] + length + ahead - 0.5 * log.step:
            now = log.t[start]
            ahead_of = [now - run_up, now + length - 1e-9, now + length + ahead - 1e-9]
            before, stop, last = (begin + np.searchsorted(t, ahead_of)).tolist()
            places.append((before, start, stop, last))
            start = stop
        left += max(end - start, 0)
    widest = max((last - before for before, _, _, last in places), default=0)
    S = len(places)
    rows, live, weight = np.full((S, widest), -1), np.zeros((S, widest)), np.zeros((S, widest, values.shape[1]))
    for i, (before, start, stop, last) in enumerate(places):
        rows[i, : last - before] = np.arange(before, last)
        live[i, start - before :] = 1.0
        weight[i, start - before : stop - before] = good[start:stop]
    at, there, steps = np.maximum(rows, 0), rows >= 0, np.r_[np.diff(log.t), log.step]
    t, h = np.where(there, log.t[at], 0.0), np.where(there, steps[at], log.step)
    inputs, seen = np.where(there[..., None], log.inputs[at], 0.0), np.where(good, values, 0.0)[at]
    blank, outliers = int((~known).sum()), int((spikes & known).sum())
    counts = Counts(log.t.size, S, broken.size, warm, left, blank, outliers)
    return Segments(t, h, inputs, live, seen, weight, rows, np.zeros(S, int)), counts


def leaps(log: Log) -> np.ndarray:
    """Measurements that leap away from the line through their neighbours (N, C)."""
    spikes = np.zeros((log.t.size, len(log.measured)), bool)
    for channel, value in enumerate(log.measured.values()):
        fine = np.flatnonzero(np.isfinite(value))
        if fine.size > WINDOW:
            padded = np.pad(value[fine], WINDOW // 2, "reflect", reflect_type="odd")
            windows = np.lib.stride_tricks.sliding_window_view(padded, WINDOW)
            i, j = np.triu_indices(WINDOW, 1)
            slope = np.median((windows[:, j] - windows[:, i]) / (j - i), axis=1)  # Theil and Sen's line
            line = np.median(windows - slope[:, None] * (np.arange(WINDOW) - WINDOW // 2), axis=1)
            off = np.abs(value[fine] - line)  # where a channel stands exactly still it says nothing of its noise
            moving = off[off > STILL * np.abs(value[fine])]
            usual = 1.4826 * np.median(moving) if moving.size else np.inf
            pace = np.quantile(np.abs(np.diff(value[fine])), 0.9)  # a bend of a channel without noise is no spike
            spikes[fine[off > max(SPIKE * usual, BEND * pace)], channel] = True
    return spikes


def noise(logs: Sequence[Log]) -> np.ndarray:
    """A first guess of every channel's noise (C,), from what neither its value nor its slope explains."""
    guesses = np.array([white_noise([log.measured[name] for log in logs]) for name in logs[0].measured])
    return np.where(np.isfinite(guesses), np.maximum(guesses, 1e-6), 1.0)
