"""Numbers in text, as every program writes them: in ASCII, without separators between digits."""

from __future__ import annotations

import re

REAL = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
INTEGER = re.compile(r"[+-]?\d+", re.ASCII)


def real(text: str) -> float:
    """A number, infinite where it is too large for one.

    Raises:
        ValueError: it is none: Python alone would read `1_0` and digits of other scripts, and nan and inf.
    """
    if not REAL.fullmatch(text.strip()):
        raise ValueError(f"{text.strip()!r} is no number")
    return float(text)


def integer(text: str) -> int:
    """A whole number.

    Raises:
        ValueError: it is none.
    """
    if not INTEGER.fullmatch(text.strip()):
        raise ValueError(f"{text.strip()!r} is no whole number")
    return int(text)
