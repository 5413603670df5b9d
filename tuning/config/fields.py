"""What fields of settings are made with: the rules of their numbers, and choices of words."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any

import numpy as np

import agvjax
from agvjax._pytree import Rule

OPEN: Any = None  # what the law and the plant say; `complete` fills it in
USUAL = agvjax.Criteria()


def _whole(low: int, high: float, most: str) -> Rule:
    return Rule(f"a whole number from {low} to {most}", lambda x: (x >= low) & (x <= high) & (x == np.round(x)))


COUNT = Rule("a whole number >= 1", lambda x: (x >= 1) & (x == np.round(x)))
STARTS, ROUNDS, DRIVES = _whole(1, 1000, "1000"), _whole(0, 100, "100"), _whole(0, 4096, "4096")
SWEPT = _whole(1, 1e9, "10^9")
ROLLED = _whole(10_000, 1e8, "10^8")
SCREENED = _whole(0, 1e5, "10^5")
MANY, SOME, WHOLE = _whole(1, 1e6, "10^6"), _whole(0, 1e7, "10^7"), _whole(0, 2**53, "2^53")
RATE = Rule("0, or from 10^-3 to 10^6", lambda x: (x == 0) | ((x >= 1e-3) & (x <= 1e6)))
WEIGHT = Rule(">= 0 and at most 10^6", lambda x: (x >= 0) & (x <= 1e6))
FACTOR = Rule("> 1 and at most 10^3", lambda x: (x > 1) & (x <= 1e3))
LONG = Rule("from 10^-3 to 10^4", lambda x: (x >= 1e-3) & (x <= 1e4))
DURATION = Rule("from 0.1 to 3600", lambda x: (x >= 0.1) & (x <= 3600))
MEMORY = Rule("from 10^-3 to 10", lambda x: (x >= 1e-3) & (x <= 10))
SHARE = Rule("> 0 and < 1", lambda x: (x > 0) & (x < 1))
PROVING = _whole(10, 1e6, "10^6")
PACE = Rule("from 10^-3 to 10^3", lambda x: (x >= 1e-3) & (x <= 1e3))


def choice(default: Any, options: Iterable[Any]) -> Any:
    """A field that holds one of some words or numbers."""
    return dataclasses.field(default=default, metadata={"choices": tuple(options)})
