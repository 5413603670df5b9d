"""Streams of different rates side by side, in rows of equal steps, as a fit reads them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from .recording import CLOCKS, GAP, Recording, Stream
from .roles import Role

SHORTEST, MOST_ROWS = 0.002, 5_000_000  # s, a row's step at least; rows


class Rows(NamedTuple):
    """A drive in N rows."""

    columns: dict[str, np.ndarray]  # by our names (N,), and "t" [s]; NaN where nothing was measured
    fields: dict[str, np.ndarray]  # the same of every number of every topic that was sent, as TOPIC.FIELD
    stamps: str  # whose times: "header" or "arrival"
    notes: tuple[str, ...]  # what was done, a sentence each


def stamps_of(found: Mapping[str, tuple[Stream, Role]], asked: str = "auto") -> tuple[str, list[str]]:
    """Whose times are used, "header" or "arrival", and why.

    The sender's, where what is measured has them and its clock is that of the recorder: a command without a stamp of
    its own is known by its arrival alone.
    """
    stamped = [stream for stream, _ in found.values() if stream.header is not None]
    bare = [stream.topic for stream, _ in found.values() if stream.header is None]
    apart = {s.topic: float(np.median(s.arrival - s.header)) * 1e-9 for s in stamped if s.header is not None}
    strange = {topic: late for topic, late in apart.items() if abs(late) > CLOCKS}
    if asked != "auto":
        return asked, []
    if not stamped:
        return "arrival", ["times are those of arrival: no message has a stamp of its sender"]
    if strange and bare:
        topic, late = next(iter(strange.items()))
        words = f"stamps of {topic} are {late:.3g} s from their arrival, another clock than that of the recorder"
        return "arrival", [f"times are those of arrival: {words}, and {', '.join(bare)} has none"]
    late = ", ".join(f"{topic} {1e3 * x:.3g} ms" for topic, x in apart.items())
    more = f"; of arrival for {', '.join(bare)}, which has none" if bare else ""
    return "header", [f"times are those of the senders (arrival later by {late}){more}"]


def table(recording: Recording, found: Mapping[str, tuple[Stream, Role]], asked: str = "auto") -> Rows:
    """The chosen streams in rows.

    Rows are as far apart as the fastest stream's messages. A command holds until the next one, but not across a gap of
    its own. What is measured is taken between its neighbours, only where these are one period of its own apart, and
    only in the row nearest to a message: a slow sensor fills few rows.

    Args:
        recording: all streams.
        found: the stream and role of each role.
        asked: "header" or "arrival"; "auto" where the streams decide.

    Raises:
        ValueError: the streams do not overlap, or are too long for rows this short.
    """
    stamps, notes = stamps_of(found, asked)
    t, begin, step = _clock([stream for stream, _ in found.values()], stamps)
    columns: dict[str, np.ndarray] = {"t": begin * 1e-9 + t}
    told = set()
    for name, (stream, role) in found.items():
        own = (stream.times(stamps) - begin) * 1e-9
        laid = _laid(own, role.values(stream.fields), t, step, role.held)
        columns |= {n: x for n, x in laid.items() if n not in columns}
        told |= {stream.topic} if role.held else set()
        if lost := _gaps(own):
            notes.append(f"{stream.topic} ({name}): {lost} gaps")
    fields = {}
    for stream in recording.streams:
        own = (stream.times(stamps) - begin) * 1e-9
        laid = _laid(own, stream.fields, t, step, stream.topic in told) if stream.size > 1 else {}
        fields |= {f"{stream.topic}.{name}": values for name, values in laid.items()}
    return Rows(columns, fields, stamps, tuple(notes))


def _clock(streams: Sequence[Stream], stamps: str) -> tuple[np.ndarray, int, float]:
    """The times of the rows [s] since the first instant that all streams know [ns], and how far apart they are [s]."""
    usual = [stream.regularity(stamps)[0] for stream in streams]
    step = max(min(period for period in usual if period > 0), SHORTEST)
    begin = max(int(stream.times(stamps).min()) for stream in streams)
    end = min(int(stream.times(stamps).max()) for stream in streams)
    count = math.floor((end - begin) * 1e-9 / step) + 1
    if count < 2:
        raise ValueError(f"{', '.join(s.topic for s in streams)} were never recorded at the same time")
    if count > MOST_ROWS:
        raise ValueError(f"{count} rows of {step:g} s, more than {MOST_ROWS}: cut it first")
    return np.arange(count) * step, begin, step


def _gaps(own: np.ndarray) -> int:
    """Where a stream falls silent for more than a few of its usual periods."""
    periods = np.diff(np.sort(own))
    return int((periods > GAP * np.median(periods)).sum()) if periods.size else 0


def _laid(
    own: np.ndarray, values: Mapping[str, np.ndarray], t: np.ndarray, step: float, held: bool
) -> dict[str, np.ndarray]:
    """Values (n,) at their own times [s] in rows at `t` (N,)."""
    order = np.argsort(own, kind="stable")
    own = own[order]
    usual = float(np.median(np.diff(own))) if len(own) > 1 else math.inf
    # the last one that was there; of commands up to half a row later, or else all of them would come half a row late
    before = np.searchsorted(own, t + (step / 2 - 1e-6 if held else 1e-9), side="right") - 1
    there = before >= 0
    first, after = np.clip(before, 0, None), np.clip(before + 1, None, len(own) - 1)
    laid = {}
    if held:
        fresh = there & (t - own[first] <= max(GAP * usual, step))
        for name, value in values.items():
            laid[name] = np.where(fresh, value[order][first], np.nan)
        return laid
    span = own[after] - own[first]
    near = there & (span > 0) & (span <= 1.5 * usual)
    closest = np.minimum(np.abs(t - own[first]), np.abs(own[after] - t))
    near &= closest <= max(step, 1e-9) / 2 + 1e-9 if usual > 1.5 * step else near
    exact = there & (np.abs(t - own[first]) <= 1e-6)
    share = np.where(span > 0, (t - own[first]) / np.where(span > 0, span, 1.0), 0.0)
    for name, value in values.items():
        value = _whole_turns(name, value[order])
        between = value[first] + share * (value[after] - value[first])
        laid[name] = np.where(exact, value[first], np.where(near, between, np.nan))
    return laid


def _whole_turns(name: str, value: np.ndarray) -> np.ndarray:
    """Headings without leaps of a whole turn, between which nothing could be taken."""
    if name != "heading":
        return value
    fine, whole = np.isfinite(value), value.copy()
    whole[fine] = np.unwrap(value[fine])
    return whole
