"""What a recording holds, whatever wrote it: streams of numbers with their times."""

from __future__ import annotations

import array
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

GAP = 3.0  # usual periods: what is longer is a gap
MOST = 0.9  # share of the periods that are usual: of a sender that jitters, its long ones too
Part = Any  # a message, or part of one: of a class that a library makes by the definitions of the file
Sent = tuple[str, str, int, Callable[[], Part]]  # topic, type, arrival [ns], and the message when it is asked for
CLOCKS = 1.0  # s between the stamps of a message and of its arrival, beyond which they are of two clocks


class Stream(NamedTuple):
    """Messages of one topic, N of them."""

    topic: str
    kind: str  # the type of its messages
    arrival: np.ndarray  # (N,), int64 ns, when the recorder got them
    header: np.ndarray | None  # (N,), int64 ns, when the sender stamped them; None where it does not
    fields: dict[str, np.ndarray]  # (N,) by dotted name, as they were sent

    @property
    def size(self) -> int:
        """How many messages."""
        return len(self.arrival)

    def times(self, stamps: str) -> np.ndarray:
        """Their times (N,) [int64 ns]: of the "header" where there is one and it is asked for, else of arrival."""
        return self.header if stamps == "header" and self.header is not None else self.arrival

    def regularity(self, stamps: str) -> tuple[float, int, float]:
        """The usual period [s], the number of gaps, and the jitter [s]: the spread of periods that are no gap."""
        periods = np.diff(np.sort(self.times(stamps))) * 1e-9
        if not periods.size:
            return math.nan, 0, math.nan
        usual = float(np.median(periods))
        gaps = periods > longest(periods)
        return usual, int(gaps.sum()), float(np.std(periods[~gaps])) if (~gaps).any() else math.nan


def longest(periods: np.ndarray) -> float:
    """The longest of some periods that is no gap [s]; infinite where there are none."""
    return max(GAP * float(np.quantile(periods, MOST)), 1e-9) if periods.size else np.inf


class Recording(NamedTuple):
    """A file, or a folder, of streams."""

    name: str
    streams: tuple[Stream, ...]  # those that could be read
    unread: dict[str, tuple[str, int]]  # by topic its type and how many: nothing that a vehicle's drive is learned from
    lost: tuple[str, ...]  # what is missing, a sentence each: a file that ends too early, a message that is damaged


class Gathered:
    """Messages of one topic while they are read: eight bytes a number."""

    def __init__(self, topic: str, kind: str) -> None:
        """Of a topic and the type of its messages."""
        self.topic, self.kind = topic, kind
        self.arrival, self.header = array.array("q"), array.array("q")
        self.fields: dict[str, array.array[float]] = {}

    def add(self, arrival: int, header: int | None, numbers: Mapping[str, float]) -> None:
        """One message: when it came [ns], its own stamp [ns] if it has one, and its numbers."""
        for name in numbers:
            if name not in self.fields:  # it was in no message before
                self.fields[name] = array.array("d", [math.nan]) * len(self.arrival)
        self.arrival.append(arrival)
        if header is not None:
            self.header.append(header)
        for name, values in self.fields.items():
            values.append(numbers.get(name, math.nan))

    def stream(self) -> Stream:
        """All of them."""
        stamped = len(self.header) == len(self.arrival) and any(self.header)  # a stamp of 0 was never set
        header = np.array(self.header, np.int64) if stamped else None
        fields = {name: np.array(values) for name, values in self.fields.items()}
        return Stream(self.topic, self.kind, np.array(self.arrival, np.int64), header, fields)
