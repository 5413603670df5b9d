"""Streams of different rates side by side, in rows of equal steps, as a fit reads them."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..csv_file import Column
from ..headings import unwrapped
from .recording import CLOCKS, Recording, Stream, longest
from .roles import Role, Values

MOVED, CHANCE = 0.02, 3.5  # steps that commands may be moved on average, and deviations of that mean
LARGE = 0.13  # steps^2, of moves in the mean square; of commands at any time 1/12
PLACES = 400  # in a step, at which rows may begin
SHORTEST, MOST_ROWS = 0.002, 5_000_000  # s, a row's step at least; rows
EARLY = 0.02  # s, by which a stamp may be later than its arrival, of clocks that are kept together
NOTHING_NAMED: Mapping[str, Column] = {}


class Rows(NamedTuple):
    """A drive in N rows."""

    columns: dict[str, np.ndarray]  # by our names (N,), "t" [s]; NaN where nothing was measured
    stamps: str  # whose times: "header" or "arrival"
    notes: tuple[str, ...]  # what was done, a sentence each


def stamps_of(streams: Sequence[Stream], asked: str = "auto") -> tuple[str, str]:
    """Whose times are used, "header" or "arrival", and why.

    The sender's, where there are any and all clocks are that of the recorder: a message without a stamp of its own is
    known by its arrival alone.

    Raises:
        ValueError: the senders' are `asked` for, and there are none.
    """
    bare = [stream.topic for stream in streams if stream.header is None]
    apart = {s.topic: float(np.median(s.arrival - s.header)) * 1e-9 for s in streams if s.header is not None}
    if asked == "header" and not apart:
        raise ValueError(f"no stamps of senders, only times of arrival: {', '.join(bare)} have none")
    if asked == "arrival" or not apart:
        return "arrival", "times are those of arrival" + ("" if apart else ": no message has a stamp of its sender")
    if asked == "auto" and (words := next(filter(None, map(_impossible, streams)), "")):
        return "arrival", f"times are those of arrival: {words}"
    late = [*apart.values(), *[0.0] * bool(bare)]
    if asked == "auto" and max(late) - min(late) > CLOCKS:
        topic = max(apart, key=lambda name: abs(apart[name]))
        words = f"stamps of {topic} are {apart[topic]:.3g} s from their arrival, by another clock than the others"
        return "arrival", f"times are those of arrival: {words}"
    listed = ", ".join(f"{topic} {1e3 * x:.3g} ms" for topic, x in apart.items())
    more = f"; of arrival for {', '.join(bare)}, which has none" if bare else ""
    return "header", f"times are those of the senders (arrival later by {listed}){more}"


def _impossible(stream: Stream) -> str:
    """Why the stamps of a sender cannot be times of one clock, that of the recorder; empty where they can be."""
    if stream.header is None:
        return ""
    back = np.diff(stream.header) * 1e-9
    if back.size and back.min() < -CLOCKS:
        after = (stream.arrival[int(back.argmin()) + 1] - stream.arrival[0]) * 1e-9
        return f"stamps of {stream.topic} go back by {-back.min():.3g} s, {after:.4g} s after its first message"
    early = float(np.median(stream.header - stream.arrival)) * 1e-9
    if EARLY < early < CLOCKS:
        return f"stamps of {stream.topic} are {1e3 * early:.3g} ms later than their arrival, by another clock"
    return ""


def _holes(stream: Stream, values: Values) -> str:
    """How many messages lack a number that the others have, as poses of a robot that is lost; empty where none does."""
    whole = [np.isfinite(value) for value in values.values() if np.isfinite(value).any()]
    lacks = ~np.logical_and.reduce(whole) if whole else np.zeros(stream.size, bool)
    if not lacks.any():
        return ""
    first, last = ((stream.arrival[i] - stream.arrival[0]) * 1e-9 for i in np.flatnonzero(lacks)[[0, -1]])
    return f"{stream.topic}: {int(lacks.sum())} of {stream.size} messages lack a number, {first:.4g} to {last:.4g} s"


# long: mostly its arguments and what they mean
def table(
    recording: Recording,
    found: Mapping[str, tuple[Stream, Role]],
    named: Mapping[str, Column] = NOTHING_NAMED,
    commands: Collection[str] = (),
    asked: str = "auto",
) -> Rows:
    """The chosen streams in rows.

    Rows are as far apart as the fastest stream's messages. A command holds until the next one, but not across a gap of
    its own. What is measured is taken between its neighbours, only where these are one period of its own apart, and
    only in the row nearest to a message: a slow sensor fills few rows.

    Args:
        recording: all streams.
        found: the stream and role of each role.
        named: by our name where it stands besides, its columns as TOPIC.FIELD of one topic.
        commands: those of our names that hold.
        asked: "header" or "arrival"; "auto" where the streams decide.

    Raises:
        ValueError: nothing is chosen, or what is named is not there, the streams do not overlap, or are too long for
            rows this short.
    """
    sources = [(*_found(recording, place, name), name in commands) for name, place in named.items()]
    sources += [(stream, role.values(stream.fields), role.held) for stream, role in found.values()]
    streams = list({stream.topic: stream for stream, _, _ in sources}.values())
    if not streams:
        raise ValueError("no topic of it is of a type that serves by itself; name its numbers as TOPIC.FIELD")
    stamps, note = stamps_of(streams, asked)
    t, begin, step = _clock(streams, stamps)
    begin += _phase([_changes(s.times(stamps), values) for s, values, held in sources if held], begin, step)
    columns: dict[str, np.ndarray] = {"t": begin * 1e-9 + t}
    for stream, values, held in sources:
        laid = _laid((stream.times(stamps) - begin) * 1e-9, values, t, step, held)
        columns |= {name: column for name, column in laid.items() if name not in columns}
    gaps = {stream.topic: stream.regularity(stamps)[1] for stream in streams}
    holes = [words for stream, values, _ in sources if (words := _holes(stream, values))]
    told = (f"{topic}: {count} gaps" for topic, count in gaps.items() if count)
    return Rows(columns, stamps, (note, *told, *dict.fromkeys(holes)))


def _found(recording: Recording, place: Column, name: str) -> tuple[Stream, Values]:
    """The stream that has all columns of a quantity, and its numbers in SI units.

    Raises:
        ValueError: none has; it says which one has not.
    """
    for stream in recording.streams:
        table = {f"{stream.topic}.{field}": values for field, values in stream.fields.items()}
        if all(part in table for part in place.parts):
            return stream, {name: place.values(table)}
    known = {f"{stream.topic}.{field}" for stream in recording.streams for field in stream.fields}
    if lacks := [part for part in place.parts if part not in known]:
        raise ValueError(f"it has no {', '.join(lacks)}; any of its numbers may be named, as TOPIC.FIELD")
    raise ValueError(f"{place.words} must be of one topic, to be of one instant")


def _clock(streams: Sequence[Stream], stamps: str) -> tuple[np.ndarray, int, float]:
    """The times of the rows [s] since the first instant that all streams know [ns], and how far apart they are [s]."""
    usual = [stream.regularity(stamps)[0] for stream in streams]
    step = max(min((period for period in usual if period > 0), default=np.inf), SHORTEST)
    begin = max(int(stream.times(stamps).min()) for stream in streams)
    end = min(int(stream.times(stamps).max()) for stream in streams)
    count = math.floor((end - begin) * 1e-9 / step) + 1
    if count < 2:
        raise ValueError(f"{', '.join(s.topic for s in streams)} were never recorded at the same time")
    if count > MOST_ROWS:
        raise ValueError(f"{count} rows of {step:g} s, more than {MOST_ROWS}: cut it first")
    return np.arange(count) * step, begin, step


def _changes(own: np.ndarray, values: Values) -> np.ndarray:
    """When [ns] a command became another one, of commands (n,) at their own times."""
    order = np.argsort(own, kind="stable")
    new = [np.diff(value[order]) != 0 for value in values.values()]
    return own[order][1:][np.logical_or.reduce(new)] if new else own[:0]


def _phase(changes: Sequence[np.ndarray], begin: int, step: float) -> int:
    """How much later [ns] rows begin so that commands that change in time with them are on average not moved.

    A command begins in a row: one second apart, all of them would be moved by the same part of a step, and each 0.05 s
    between rows 0.02 s apart half of them by half a step; a delay that is identified would be off by what they are
    moved on average. Rows stay where that is no more than chance, and the moves no larger than those of commands at
    any time. Otherwise they begin where the mean square of the moves is least, and so their mean is none.
    """
    when = np.concatenate([np.zeros(0), *((own - begin) * 1e-9 for own in changes)]) / step
    if not when.size:
        return 0
    moved = _moved(when, 0.0)
    by_chance = abs(moved.mean()) < max(MOVED, CHANCE * moved.std() / np.sqrt(when.size))
    if by_chance and np.mean(moved**2) < LARGE:
        return 0
    places, middles = np.arange(PLACES) / PLACES, (np.arange(PLACES) + 0.5) / PLACES
    counts = np.histogram(when % 1.0, PLACES, (0.0, 1.0))[0]
    share = places[np.argmin([counts @ _moved(middles, place) ** 2 for place in places])]
    for _ in range(3):
        share -= _moved(when, share).mean()
    share %= 1.0
    return round(share * step * 1e9) if share < 1 - 1e-6 else 0  # a whole step is none


def _moved(when: np.ndarray, share: float) -> np.ndarray:
    """By how many steps commands at `when` steps come to lie later, in rows that begin at a share of a step."""
    return (share - when + 0.5) % 1.0 - 0.5


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
        fresh = there & (t - own[first] <= max(longest(np.diff(own)), step))
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
        value = unwrapped(value[order]) if name == "heading" else value[order]
        between = value[first] + share * (value[after] - value[first])
        laid[name] = np.where(exact, value[first], np.where(near, between, np.nan))
    return laid
