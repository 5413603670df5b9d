"""Folders of text tables with a file for each topic, as exporters of bags and loggers write them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from ..csv_file import UNITS, numbers
from ..track_names import guessed
from .recording import Recording, Stream
from .roles import TABLE, kind_of

ENDS = (".csv", ".dat", ".tsv", ".txt")
PARTS = {"s": "ns", "sec": "nanosec", "secs": "nsecs", "seconds": "nanoseconds"}  # of a time in two columns
SENT = ("header.stamp", "header_stamp", "field.header.stamp")  # the sender's time, before the names of its parts
EPOCHS = {1e17: "ns", 1e14: "us", 1e11: "ms"}  # since 1970, in a unit that a time above tells


def files(folder: Path) -> list[Path]:
    """Its text tables, by name."""
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in ENDS)


def read(path: Path, tick: Callable[[int], object]) -> Recording:
    """The tables of a folder, a stream for each that has a column of times; its topic is the file's name.

    A table has the type of the messages whose fields its columns are called, as exporters of bags call them.

    Raises:
        ValueError: no table has times.
    """
    streams, unread, lost = [], {}, []
    for file in files(path):
        try:
            columns, damaged = numbers(file)
        except ValueError as error:
            lost.append(str(error))
            continue
        if damaged:
            lost.append(f"{file.name}: {damaged} damaged rows are left out")
        rows = len(next(iter(columns.values()), ()))
        if (stream := _stream(file.stem, columns)) is None:
            unread[file.stem] = ("table without a column of times", rows)
            continue
        if stream.size < rows:
            lost.append(f"{file.name}: {rows - stream.size} rows without a time are left out")
        streams.append(stream)
        tick(stream.size)
    return Recording(path.name, tuple(streams), unread, tuple(lost))


def _stream(topic: str, columns: Mapping[str, np.ndarray]) -> Stream | None:
    """A table as a stream; None of one without times."""
    sent, of_sent = _stamps(columns, SENT)
    own, of_own = _stamps(columns, ("",))
    if own is None and (place := guessed(list(columns)).get("t")):
        own, of_own = _nanoseconds(columns[place.column], place.unit), (place.column,)
    first = own if own is not None else sent
    if first is None:
        return None
    timed = np.logical_and.reduce([np.isfinite(columns[name]) for name in (*of_sent, *of_own)])
    fields = {
        name.removeprefix("field.").removeprefix("."): values[timed]
        for name, values in columns.items()
        if name not in (*of_sent, *of_own) and not name.startswith("%")
    }
    return Stream(topic, kind_of(fields) or TABLE, first[timed], None if sent is None else sent[timed], fields)


def _stamps(columns: Mapping[str, np.ndarray], prefixes: tuple[str, ...]) -> tuple[np.ndarray | None, tuple[str, ...]]:
    """Times (N,) [int64 ns] in columns of whole and parts of seconds, or in one, behind a prefix; and their names."""
    for prefix in prefixes:
        for whole, part in PARTS.items():
            for mark in "._" if prefix else ("",):
                names = (f"{prefix}{mark}{whole}", f"{prefix}{mark}{part}")
                if all(name in columns for name in names):
                    seconds, rest = (np.nan_to_num(columns[name]).astype(np.int64) for name in names)
                    return seconds * 1_000_000_000 + rest, names
        if prefix in columns:
            return _nanoseconds(columns[prefix], ""), (prefix,)
    return None, ()


def _nanoseconds(times: np.ndarray, unit: str) -> np.ndarray:
    """Times [int64 ns] in a unit; without one in seconds, or in what only a time since 1970 is so large in."""
    size = float(np.nanmax(np.abs(times))) if np.isfinite(times).any() else 0.0
    unit = unit or next((name for least, name in EPOCHS.items() if size > least), "s")
    return np.round(np.nan_to_num(times) * (UNITS[unit] * 1e9)).astype(np.int64)
