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


MANY = 3.0  # times, from which on a ratio is said as such


def change(ratio: float) -> str:
    """A ratio as a change: `+12%`, and from `MANY` on `57 times`."""
    return f"{ratio - 1:+.0%}" if ratio < MANY else f"{ratio:.3g} times"


def beyond(ratio: float, digits: int = 0) -> str:
    """How a value of `ratio` times a limit stands to it: `12% above`, `3% below`, `57 times`."""
    if ratio >= MANY:
        return f"{ratio:.3g} times"
    return f"{abs(ratio - 1):.{digits}%} {'above' if ratio > 1 else 'below'}"
