"""What is wrong with the draws of an ensemble."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

import agvjax

from .draws import Draw


def undrawable(scenario: Any, draws: Mapping[str, Draw]) -> list[agvjax.Fault]:
    """Draws of what is no leaf of the scenario."""
    leaves = agvjax.leaves(scenario)
    found = [
        agvjax.Fault("ensemble.draws", name, f"a leaf of the scenario{near(name, leaves)}")
        for name in draws
        if name not in leaves
    ]
    if not draws:
        found.append(agvjax.Fault("ensemble.draws", "{}", "at least one leaf of the scenario"))
    return found


def near(name: str, known: Iterable[str]) -> str:
    """A hint after a rule."""
    found = difflib.get_close_matches(name, list(known), 1, 0.5)
    return f"; did you mean {found[0]}?" if found else f": {', '.join(known)}"


def beyond_rules(scenario: Any, draws: Mapping[str, Draw]) -> list[agvjax.Fault]:
    """Ends of the draws that their leaf may not hold."""
    found = []
    for name, draw in draws.items():
        nominal = np.asarray(agvjax.leaves(scenario)[name], float)
        found += ends_beyond_rules(scenario, name, draw.box(nominal), f"ensemble.draws.{name}")
    return found


def ends_beyond_rules(tree: Any, name: str, ends: Iterable[Any], key: str) -> list[agvjax.Fault]:
    """Values that a leaf may not hold."""
    bad = [p for end in ends for p in agvjax.faults(agvjax.replace(tree, {name: end})) if p.key == name]
    return [p._replace(key=key) for p in bad]
