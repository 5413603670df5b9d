"""Markdown as a terminal shows it: tables in columns, no marks."""

from __future__ import annotations

import re
import shutil
import textwrap
from collections.abc import Iterator

NUMBER = re.compile(r"[-+]?[\d.,]*\d(e[-+]?\d+)?%?|inf|nan|")


def plain(text: str, width: int | None = None) -> str:
    """The Markdown `text` without marks: columns of a table lined up, lines wrapped, pictures left out.

    Args:
        text: Markdown of the reports: paragraphs, lists, tables, pictures.
        width: letters in a line, that of the terminal by default; a table is not wrapped.
    """
    width = width or shutil.get_terminal_size((100, 24)).columns
    blocks, table = [], []
    for line in [*text.splitlines(), ""]:
        if line.startswith("|"):
            table.append([_unmarked(cell) for cell in re.split(r"(?<!\\)\|", line)[1:-1]])
            continue
        if table:
            blocks += _lined_up(table)
            table = []
        if not line.startswith("!["):
            blocks += _wrapped(_unmarked(line), width)
    return re.sub(r"\n{3,}", "\n\n", "\n".join(blocks)).strip("\n")


def _unmarked(text: str) -> str:
    text = re.sub(r"\*\*(.+?)\*\*|(?<![\w*])\*([^*\s][^*]*)\*", lambda m: m[1] or m[2], text.replace(r"\|", "|"))
    return re.sub(r"`([^`]*)`", r"\1", re.sub(r"^#+ ", "", text)).rstrip()


def _wrapped(line: str, width: int) -> Iterator[str]:
    indent = "  " if line.startswith("* ") else ""
    yield from textwrap.wrap(line, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False) or [
        ""
    ]


def _lined_up(rows: list[list[str]]) -> Iterator[str]:
    rows = [[cell.strip() for cell in row] for row in rows]
    rows = [row for row in rows if not all(re.fullmatch(r":?-{3,}:?", cell) for cell in row)]
    columns = list(zip(*rows, strict=True))
    wide = [max(map(len, column)) for column in columns]
    right = [any(column[1:]) and all(NUMBER.fullmatch(cell) for cell in column[1:]) for column in columns]
    for row in rows:
        cells = (cell.rjust(w) if r else cell.ljust(w) for cell, w, r in zip(row, wide, right, strict=True))
        yield "  ".join(cells).rstrip()
