"""The rows of a text of columns: their separator, their header, their decimal mark."""

from __future__ import annotations

import csv
import re

import numpy as np

from .numbers import real

COMMENTS = ("#", "//", "% ")  # what begins a line that is none of the rows; before the first row one may be the header
SEPARATORS = ";\t,"  # the first of them that the header has; without one, columns are separated by spaces
EMPTY = SEPARATORS + " "  # what a row is made of that has no cell with something in it
DECIMAL = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?", re.ASCII)  # a number with a decimal comma


def split(text: str) -> list[tuple[int, list[str]]]:
    """The header and the rows below it, each with its line number and its cells; none of a file without any."""
    lines, comments = [], []  # with their numbers; the comments are those before the first row
    for number, line in enumerate(text.splitlines(), 1):
        if line.lstrip().startswith(COMMENTS):
            comments += [] if lines else [(number, line.lstrip().lstrip("#/%"))]
        elif line.strip(EMPTY) or (lines and line.strip()):  # a row of empty cells may be a hole: it is not passed over
            lines.append((number, line))
    while lines and not lines[-1][1].strip(EMPTY):
        lines.pop()
    rows = _cells(lines)
    if not rows or sum(map(is_word, rows[0][1])) > sum(map(is_number, rows[0][1])):  # a row may have words too: on, off
        return rows
    named = [cells for comment in comments for cells in _cells([comment]) if any(map(is_word, cells[1]))]
    wide = [(number, re.split(r"\t|\s{2,}", text.strip())) for number, text in comments]  # names of several words
    fitting = sorted(cells for cells in (*wide, *named) if len(cells[1]) == len(rows[0][1])) or named
    return (fitting[-1:] or [(0, numbered(len(rows[0][1])))]) + rows


def _with_points(rows: list[tuple[int, list[str]]]) -> list[tuple[int, list[str]]]:
    """Rows whose numbers have decimal points, of a file that writes decimal commas.

    Raises:
        ValueError: it has both, so that 1.234 may be a thousand.
    """
    commas = [(line, cell) for line, cells in rows for cell in cells if "," in cell and DECIMAL.fullmatch(cell.strip())]
    if not commas:
        return rows
    for line, cells in rows:
        for cell in cells:
            if "." in cell and not is_word(cell) and is_number(cell):
                rule = f"one decimal mark: {commas[0][1].strip()} in row {commas[0][0]}, {cell.strip()} in row {line}"
                raise ValueError(f"numbers must have {rule}")
    return [
        (line, [cell.replace(",", ".") if DECIMAL.fullmatch(cell.strip()) else cell for cell in cells])
        for line, cells in rows
    ]


def numbered(count: int) -> list[str]:
    """The names of columns that have none: 1, 2, 3."""
    return [str(k) for k in range(1, count + 1)]


def _cells(lines: list[tuple[int, str]]) -> list[tuple[int, list[str]]]:
    """What stands between the separators that the first of the lines has; quotes keep one that belongs to a cell."""
    if not lines:
        return []
    first = re.sub(r"[,;]\s+", lambda found: found[0][0], lines[0][1])  # blanks behind a separator are none
    mark = next((mark for mark in SEPARATORS if mark in first), " ")
    spaces = mark == " "
    texts = [line.strip() if spaces else line for _, line in lines]
    reader = csv.reader(texts, delimiter=mark, skipinitialspace=spaces)
    rows = [(lines[reader.line_num - 1][0], row) for row in reader if row]
    return rows if mark == "," else _with_points(rows)  # where commas separate, one in quotes may be of a thousand


def is_word(cell: str) -> bool:
    """Whether a cell of the first row names a column: it begins with a letter, and is no nan or inf.

    Before that may stand what others write there: `__time`, `%time`, `.pose.position.x`, `/odom/pose/position/x`.
    """
    start = cell.strip().lstrip("_%./")[:1]
    return start.isalpha() and cell.strip().lower() not in ("nan", "inf", "infinity")


def is_number(cell: str) -> bool:
    """Whether a cell is a finite number with a decimal point."""
    try:
        return np.isfinite(real(cell))
    except ValueError:
        return False
