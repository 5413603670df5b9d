"""What is wrong with the draws of an ensemble."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

import agvjax
from agvjax import Fault

from .draws import Draw, Usual


def undrawable(scenario: Any, draws: Mapping[str, Draw]) -> list[Fault]:
    """Draws of what is no leaf of the scenario."""
    if not draws:
        return [Fault("ensemble.draws", "{}", "at least one leaf of the scenario")]
    leaves = agvjax.leaves(scenario)
    missing = [name for name in draws if name not in leaves]
    wrong = [Fault("ensemble.draws", name, f"a leaf of the scenario{near(name, leaves)}") for name in missing]
    open_ = [name for name, draw in draws.items() if isinstance(draw, Usual) and name not in missing]
    wrong += [Fault(f"ensemble.draws.{name}", "default", "a draw: this leaf has no default one") for name in open_]
    shapes = {name: np.shape(leaves[name]) for name in draws if name not in missing}
    return wrong + [f for name, s in shapes.items() if (f := uneven(f"ensemble.draws.{name}", draws[name], s))]


def uneven(key: str, draw: Draw, shape: tuple[int, ...]) -> Fault | None:
    """A range for each element of a leaf that has another number of them."""
    if draw.width is None or shape == (draw.width,):
        return None
    return Fault(key, f"{draw.width} ranges", f"one range, or one for each element of the shape {shape}")


def near(name: str, known: Iterable[str]) -> str:
    """A hint after a rule: the nearest name that is known, or all of them."""
    nearest = difflib.get_close_matches(name, list(known), 1, 0.5)
    return f"; did you mean {nearest[0]}?" if nearest else f": {', '.join(known)}"
