"""Which scenarios to tune for: distributions over any leaf of a scenario, and samples of them."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

import agvjax
from agvjax.leaves import get


class Between(NamedTuple):
    """Uniform between two values, in the unit of the leaf."""

    low: float
    high: float

    def box(self, nominal: Any) -> tuple[Any, Any]:
        """Smallest and largest value."""
        return self.low + 0 * nominal, self.high + 0 * nominal


class Times(NamedTuple):
    """The nominal value times a uniform factor."""

    low: float
    high: float

    def box(self, nominal: Any) -> tuple[Any, Any]:
        """Smallest and largest value, for a nominal value that is not negative."""
        return self.low * nominal, self.high * nominal


Draw = Between | Times


def default_draws() -> dict[str, Draw]:
    """The default tuning problem: every deadzone number within a half of nominal, disturbance and start drawn too."""
    parts = ("slope_right", "slope_left", "threshold_right", "threshold_left")
    draws: dict[str, Draw] = {f"deadzone.{c}.{p}": Times(0.5, 1.5) for c in ("position", "heading") for p in parts}
    return draws | {
        "disturbance.amplitude": Between(0.0, 0.4),
        "start.position": Between(-0.5, 0.5),
        "start.heading": Between(-0.5, 1.0),
    }


def sample(scenario: Any, draws: Mapping[str, Draw], size: int, seed: int) -> agvjax.Batch:
    """`size` scenarios with the named leaves drawn independently.

    A number depends on the seed, the name of its leaf and its place in the ensemble alone: a larger ensemble begins
    with the smaller one, and another draw added changes none of the others.
    """
    values = {}
    for name, draw in draws.items():
        nominal = np.asarray(get(scenario, name), float)
        random = np.random.Generator(np.random.Philox(key=[seed, zlib.crc32(name.encode())]))
        low, high = draw.box(nominal)
        values[name] = low + (high - low) * random.random((size, *nominal.shape))
    return agvjax.batch(scenario, values)


def lowest(scenario: Any, draws: Mapping[str, Draw], name: str) -> float:
    """The smallest value that a leaf can take in the ensemble."""
    nominal = np.asarray(get(scenario, name), float)
    return float(np.min(draws[name].box(nominal)[0] if name in draws else nominal))
