"""CSV files with a header."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

UNITS = {
    "s": 1.0,
    "ms": 1e-3,
    "us": 1e-6,
    "ns": 1e-9,
    "m": 1.0,
    "cm": 1e-2,
    "mm": 1e-3,
    "rad": 1.0,
    "deg": np.pi / 180,
    "m/s": 1.0,
    "mm/s": 1e-3,
    "km/h": 1 / 3.6,
    "rad/s": 1.0,
    "deg/s": np.pi / 180,
    "rpm": np.pi / 30,
    "m/s^2": 1.0,
    "rad/s^2": 1.0,
    "deg/s^2": np.pi / 180,
    "Nm": 1.0,
    "mNm": 1e-3,
}


class Column(NamedTuple):
    """Where a quantity stands in a file, in which unit (without one it is SI), and a factor on what stands there."""

    column: str
    unit: str = ""
    factor: float = 1.0


def read(
    file: Any,
    columns: Sequence[str],
    optional: Sequence[str] = (),
    least: int = 2,
    time: str = "t",
    blank: Sequence[str] = (),
) -> dict[str, np.ndarray]:
    """Columns of a CSV file by the names in its first row; of the optional ones those that are there.

    The column `time` must increase from row to row. An empty cell is NaN in the `blank` columns and wrong in others.
    Columns not named are left alone.

    Raises:
        ValueError: names the file and what is wrong with it: the row, the column and the rule.
    """
    rows = _rows(file)
    if not rows:
        raise ValueError(f"{file} is empty; its first row must name the columns {', '.join(columns)}")
    header = [name.strip() for name in rows[0][1]]
    missing = [name for name in columns if name not in header]
    if missing and len(header) == 1 and (other := next((c for c in ";\t" if c in header[0]), "")):
        name = {";": "semicolons", "\t": "tabs"}[other]
        raise ValueError(f"{file} must have its columns separated by commas; they seem to be by {name}")
    if missing:
        raise ValueError(f"{file} has no column {', '.join(missing)}; its first row has {', '.join(header)}")
    wanted = [name for name in (*columns, *optional) if name in header]
    double = [name for name in wanted if header.count(name) > 1]
    if double:
        raise ValueError(f"{file} has more than one column {', '.join(double)}")
    if len(rows) - 1 < least:
        raise ValueError(f"{file} must have at least {least} rows below its header; it has {len(rows) - 1}")
    for line, cells in rows[1:]:
        if len(cells) != len(header):
            raise ValueError(f"{file}, row {line}: must have {len(header)} cells like its header; it has {len(cells)}")
    found = {}
    for name in wanted:
        place = header.index(name)
        empty = name in blank
        found[name] = np.array([_cell(file, line, name, cells[place], empty) for line, cells in rows[1:]])
    if time in found and np.any(np.diff(found[time]) <= 0):
        at = int(np.argmax(np.diff(found[time]) <= 0))
        now, before = (f"{found[time][i]:.15g}" for i in (at + 1, at))
        raise ValueError(f"{file}, row {rows[at + 2][0]}, column {time}: {now} must be above {before}, the time before")
    return found


def _rows(file: Any) -> list[tuple[int, list[str]]]:
    """The rows that hold something, each with its number in the file."""
    try:
        text = Path(file).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{file} is no text file in UTF-8") from error
    except (OSError, ValueError) as error:
        raise ValueError(f"{file} cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if "\0" in text:
        raise ValueError(f"{file} is no text file")
    reader = csv.reader(text.splitlines())
    try:
        return [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise ValueError(f"{file}, row {reader.line_num}: {error}") from error


def _cell(file: Any, line: int, name: str, text: str, blank: bool = False) -> float:
    if blank and not text.strip():
        return np.nan
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise ValueError(f"{file}, row {line}, column {name}: {text.strip()!r} must be a finite number")
    return value
