"""What is wrong with the draws of an ensemble."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

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


def beyond_rules(scenario: Any, draws: Mapping[str, Draw]) -> list[Fault]:
    """Ends of the draws that their leaf may not hold."""
    wrong, leaves = [], agvjax.leaves(scenario)
    for name, draw in draws.items():
        wrong += ends_beyond_rules(scenario, name, draw.box(np.asarray(leaves[name], float)), f"ensemble.draws.{name}")
    return wrong


def ends_beyond_rules(tree: Any, name: str, ends: Iterable[Any], key: str) -> list[Fault]:
    """Values that a leaf may not hold."""
    wrong = [fault for end in ends for fault in agvjax.faults(agvjax.replace(tree, {name: end}))]
    return [fault._replace(key=key) for fault in wrong if fault.key == name]
