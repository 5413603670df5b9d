"""What is wrong with the draws of an ensemble."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any

import agvjax
from agvjax import Fault

from .draws import Draw


def undrawable(scenario: Any, draws: Mapping[str, Draw]) -> list[Fault]:
    """Draws of what is no leaf of the scenario."""
    if not draws:
        return [Fault("ensemble.draws", "{}", "at least one leaf of the scenario")]
    leaves = agvjax.leaves(scenario)
    missing = [name for name in draws if name not in leaves]
    return [Fault("ensemble.draws", name, f"a leaf of the scenario{near(name, leaves)}") for name in missing]


def near(name: str, known: Iterable[str]) -> str:
    """A hint after a rule: the nearest name that is known, or all of them."""
    nearest = difflib.get_close_matches(name, list(known), 1, 0.5)
    return f"; did you mean {nearest[0]}?" if nearest else f": {', '.join(known)}"
