"""Files of columns with a header: separated by commas, semicolons, tabs or spaces, with comments behind a # or //."""

from __future__ import annotations

import csv
import datetime
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from . import csv_text, files
from .csv_text import is_number, numbered
from .headings import of_quaternions
from .numbers import real

LARGEST_FILE = 500_000_000  # bytes of a log
LARGEST = 1e30  # a cell that is larger stands for a value that is not there
UNITS = {  # what one of the unit is in SI
    **{"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "m": 1.0, "cm": 1e-2, "mm": 1e-3, "rad": 1.0, "deg": np.pi / 180},
    **{"m/s": 1.0, "mm/s": 1e-3, "km/h": 1 / 3.6, "rad/s": 1.0, "deg/s": np.pi / 180, "rpm": np.pi / 30},
    **{"mph": 0.44704, "m/s^2": 1.0, "rad/s^2": 1.0, "deg/s^2": np.pi / 180, "Nm": 1.0, "mNm": 1e-3},
}

DATE = re.compile(r"\d[-/:.]\d+[-/:]")  # what only a date or a time of day has
KINDS = {"t": "s ms us ns", "x": "m cm mm", "y": "m cm mm", "heading": "rad deg", "steering_angle": "rad deg"}
KINDS |= dict.fromkeys(("left", "right"), "m cm mm")  # of a corridor
KINDS |= dict.fromkeys(("lat", "lon"), "deg rad") | {"yaw_rate": "rad/s deg/s rpm"}
KINDS |= dict.fromkeys(("vx", "vy", "speed"), "m/s mm/s km/h mph")  # units of our names


def units_like(unit: str) -> list[str]:
    """The units in which a file may give what is in a SI unit here; all of them where that is none we know."""
    kinds = {*KINDS.values(), "m/s^2", "rad/s^2 deg/s^2", "Nm mNm"}
    return next((kind.split() for kind in kinds if unit in kind.split()), list(UNITS))


class Column(NamedTuple):
    """A column of a file.

    Attributes:
        column: its name in the file; empty: it is not to be read.
        unit: its unit there, as "deg", "km/h" or "ms"; empty: the SI unit.
        factor: on its numbers; -1 for another sign.
        nanoseconds: of a time, the column of what is added to it; empty: it has none.
        quaternion: of a heading, the columns x, y, z, w of the quaternion that tells it, or z and w alone.
    """

    column: str
    unit: str = ""
    factor: float = 1.0
    nanoseconds: str = ""
    quaternion: tuple[str, ...] = ()

    @property
    def parts(self) -> tuple[str, ...]:
        """The columns that are read for it; none of one that is not to be read."""
        return self.quaternion or ((self.column,) if self.column else ())

    def values(self, table: Mapping[str, np.ndarray]) -> np.ndarray:
        """Its numbers (N,) in SI units, of a table with its parts.

        Raises:
            ValueError: they are no quaternions.
        """
        if self.quaternion:
            return self.factor * of_quaternions(np.column_stack([table[part] for part in self.quaternion]))
        with np.errstate(over="ignore"):  # of an absurd factor, which is refused later
            return table[self.column] * UNITS.get(self.unit, 1.0) * self.factor

    @property
    def words(self) -> str:
        """The same, for a person."""
        return ", ".join(self.parts)


# long: the checks stand in their order
def read(
    file: str | Path,
    columns: Sequence[str],
    optional: Sequence[str] = (),
    least: int = 2,
    time: str = "t",
    blank: Sequence[str] = (),
    nanoseconds: str | None = None,
) -> dict[str, np.ndarray]:
    """Columns of a CSV file by the names in its header; the other columns are not looked at.

    The header is the first row, or before rows that are numbers alone the last of the comments with as many names as
    they have columns; without one the columns are called 1, 2, 3. Times may be dates with a time of day (ISO 8601),
    which are read as seconds since 1970.

    Args:
        file: the CSV file.
        columns: that must be there.
        optional: columns that are read where they are there.
        least: number of rows that there must be below the header.
        time: the column whose numbers must increase.
        blank: columns in which an empty cell reads as NaN.
        nanoseconds: the column of what is added to the time; empty: none, None: there may be none.

    Returns:
        For each column its numbers, shape (rows,).

    Raises:
        ValueError: names the file and what is wrong with it: the row, the column and the rule.
    """
    columns = (*columns, nanoseconds) if nanoseconds else columns
    rows = _rows(file, columns)
    header = [name.strip() for name in rows[0][1]]
    wanted = _wanted(file, header, columns, optional)
    if len(rows) - 1 < least:
        raise ValueError(f"{file} must have at least {least} rows below its header; it has {len(rows) - 1}")
    for line, cells in rows[1:]:
        if len(cells) != len(header):
            raise ValueError(f"{file}, row {line}: must have {len(header)} cells like its header; it has {len(cells)}")
    table = {}
    for name in wanted:
        at, empty = header.index(name), name in blank
        values = _stamps(file, rows, at) if name == time else None
        if values is None:
            values = np.array([_cell(file, line, name, cells[at], empty) for line, cells in rows[1:]])
        table[name] = values
    if nanoseconds:
        table[time] = table[time] + 1e-9 * _within_a_second(file, rows, nanoseconds, table[nanoseconds])
    if time in table:
        more = f'; nanoseconds in a column of their own: {{ column = "{time}", nanoseconds = "its name" }}'
        _increasing(file, rows, time, table[time], more if nanoseconds == "" else "")
    return table


def numbers(file: str | Path) -> tuple[dict[str, np.ndarray], int]:
    """All columns of numbers or dates that have a name of their own, and how many rows are damaged.

    A damaged row has another number of cells than the header, or a word among its numbers; it is left out. An empty
    cell reads as NaN.

    Raises:
        ValueError: the file cannot be read or has no row.
    """
    (_, header), *rows = _rows(file, ())
    header = [name.strip() for name in header]
    whole = [(line, cells) for line, cells in rows if len(cells) == len(header)]
    if not whole:
        raise ValueError(f"{file} has no row below its header with as many cells")
    table: dict[str, np.ndarray] = {}
    wrong = np.zeros(len(whole), bool)
    for at, name in enumerate(header):
        texts = [cells[at].strip() for _, cells in whole]
        first = next(filter(None, texts), "")
        if name and header.count(name) == 1 and (is_number(first) or DATE.search(first)):
            table[name] = np.array([_lenient(text) for text in texts])
            wrong |= np.isnan(table[name]) & np.array([text != "" for text in texts])
    return {name: values[~wrong] for name, values in table.items()}, len(rows) - len(whole) + int(wrong.sum())


def _lenient(cell: str) -> float:
    """The number or instant in a cell; NaN of any other."""
    try:
        value = real(cell)
    except ValueError:
        value = _instant(cell) if DATE.search(cell) else None
    return value if value is not None and abs(value) < LARGEST else np.nan


def _within_a_second(file: str | Path, rows: list[tuple[int, list[str]]], name: str, values: np.ndarray) -> np.ndarray:
    """Nanoseconds, refused where they are none that follow whole seconds."""
    wrong = (values < 0) | (values >= 1e9)
    if wrong.any():
        at = int(np.argmax(wrong))
        raise ValueError(f"{file}, row {rows[at + 1][0]}, column {name}: {values[at]:.15g} must be from 0 to 999999999")
    return values


def _stamps(file: str | Path, rows: list[tuple[int, list[str]]], at: int) -> np.ndarray | None:
    """Dates with a time of day, as seconds since 1970, UTC where they say no zone; None of a column of numbers.

    Raises:
        ValueError: dates or times of day alone, or of another spelling than ISO 8601.
    """
    name, first = rows[0][1][at].strip(), rows[1][1][at].strip()
    if not DATE.search(first):
        return None
    rule = "seconds, or a date with a time of day as in 2025-11-28T09:30:00.25Z"
    rule += "; where they stand in two columns, make one of them"
    instants = []
    for line, cells in rows[1:]:
        text = cells[at].strip()
        if (instant := _instant(text)) is None:
            raise ValueError(f"{file}, row {line}, column {name}: {text!r} must be {rule}")
        instants.append(instant)
    return np.array(instants)


def _instant(text: str) -> float | None:
    """Seconds since 1970 of a date with a time of day; None of other words."""
    try:
        whole = datetime.datetime.fromisoformat(text) if len(text) > 10 else None
    except ValueError:
        whole = None
    return whole and (whole if whole.tzinfo else whole.replace(tzinfo=datetime.UTC)).timestamp()


def names(file: str | Path, columns: Sequence[str] = ()) -> list[str]:
    """The names in the header of a CSV file that should have some `columns`; raises as `read`."""
    return [name.strip() for name in _rows(file, columns)[0][1]]


def _wanted(file: str | Path, header: list[str], columns: Sequence[str], optional: Sequence[str]) -> list[str]:
    """The columns to read, each of which must stand in the header once."""
    missing = [name for name in columns if name not in header]
    if missing:
        named = header != numbered(len(header))
        there = "its first row has" if named else "it has no header, and its columns are called"
        raise ValueError(f"{file} has no column {', '.join(missing)}; {there} {', '.join(header)}")
    wanted = [name for name in (*columns, *optional) if name in header]
    double = [name for name in wanted if header.count(name) > 1]
    if double:
        raise ValueError(f"{file} has more than one column {', '.join(double)}")
    return wanted


def _increasing(file: str | Path, rows: list[tuple[int, list[str]]], time: str, values: np.ndarray, same: str) -> None:
    """Refuse times that do not increase from row to row; `same` is said of one that stands still."""
    back = np.diff(values) <= 0
    if back.any():
        at = int(np.argmax(back)) + 1
        now, before = (f"{values[i]:.15g}" for i in (at, at - 1))
        rule = f"must be above {before}, the time before"
        if now == before:
            rule = f"must be above the time before, which is the same: leave one of the two rows out{same}"
        raise ValueError(f"{file}, row {rows[at + 1][0]}, column {time}: {now} {rule}")


def _rows(file: str | Path, columns: Sequence[str]) -> list[tuple[int, list[str]]]:
    """The rows that are not empty, each with its line number in the file; at least the header."""
    try:
        text = files.text(Path(file), LARGEST_FILE)
    except UnicodeDecodeError as error:
        raise ValueError(f"{file} is no text file in UTF-8") from error
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        reason = error.strerror if isinstance(error, OSError) else error
        raise ValueError(f"{file} cannot be read: {reason}") from error
    if "\0" in text:
        raise ValueError(f"{file} is no text file")
    try:
        rows = csv_text.split(text)
    except (csv.Error, ValueError) as error:
        raise ValueError(f"{file}: {error}") from error
    if not rows:
        raise ValueError(f"{file} is empty; its first row must name the columns {', '.join(columns)}")
    return rows


def _cell(file: str | Path, line: int, name: str, text: str, blank: bool) -> float:
    if blank and not text.strip():
        return np.nan
    try:
        value = real(text)
    except ValueError:
        value = np.nan
    if not np.abs(value) < LARGEST:
        rule = f"a finite number, in digits from 0 to 9 and below {LARGEST:g} in size"
        rule += "; a cell is left empty where nothing was measured" if blank else ""
        raise ValueError(f"{file}, row {line}, column {name}: {text.strip()!r} must be {rule}")
    return value
