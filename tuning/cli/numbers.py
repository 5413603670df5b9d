"""Numbers of the command line: as they are written in decimal, and nothing else that Python takes for one."""

from __future__ import annotations

PLAIN = frozenset("0123456789+-.eE ")


def decimal(text: str) -> float:
    """The number that a text is.

    Raises:
        ValueError: it is none, or is written with underscores or in digits of another script.
    """
    if not set(text) <= PLAIN:
        raise ValueError(f"no decimal number: {text!r}")
    return float(text)


def whole(text: str) -> int:
    """The whole number that a text is; raises as `decimal`."""
    decimal(text)
    return int(text)
