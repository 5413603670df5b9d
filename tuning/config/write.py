"""A configuration as TOML."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
import tomli_w

import agvjax

from ..ensemble.draws import (
    Between,
    Correlated,
    Correlation,
    Distribution,
    OneOf,
    Span,
    Times,
)
from ..io.csv_file import Column
from .names import CLASSES, ELEMENTS
from .recipes import RECIPES
from .settings import VERSION, Bound, Config, Limit, Weights


def dump(config: Config) -> str:
    """The resolved configuration as TOML; `load` reads it back to the same."""
    return tomli_w.dumps(_fields("", config))


def _table(key: str, value: Any) -> Any:
    if isinstance(value, (Between, Times)):
        return {type(value).__name__.lower(): list(value)}
    if isinstance(value, OneOf):
        return {"one_of": list(value.values)}
    if isinstance(value, Correlated):
        return _table(key, value.marginal)
    if isinstance(value, Column):
        more = {name: x for name, x in (("unit", value.unit), ("factor", value.factor)) if x not in ("", 1.0)}
        return {"column": value.column, **more} if more else value.column
    if isinstance(value, Correlation):
        return {"leaves": list(value.leaves), "matrix": [list(row) for row in value.matrix]}
    if isinstance(value, Distribution):
        return {"distribution": value.name, **value.parameters, "times": value.times}
    if isinstance(value, Span):
        return _table(key, value.draw) | (
            {"points": value.points} if value.points and not isinstance(value.draw, OneOf) else {}
        )
    if isinstance(value, (Weights, Limit, Bound)):
        given = {n: x for n, x in vars(value).items() if x != getattr(type(value)(), n)}
        return given or {"value": value.value} if isinstance(value, Bound) else given
    if key.startswith("tune.choices."):
        return value
    if key in CLASSES:
        known = [n for n, c in CLASSES[key].items() if (value is None if c is None else type(value) is c)]
        kind = known[0] if known else f"{type(value).__module__}.{type(value).__qualname__}"  # the user's own
        recipe = RECIPES.get(type(value))
        fields = {} if value is None else recipe.table(value) if recipe else _fields(key, value)
        return {"type": kind, **fields} if fields else kind
    if dataclasses.is_dataclass(value):
        return _fields(key, value)
    if isinstance(value, agvjax.Chain):
        kinds = {cls: kind for kind, cls in ELEMENTS.items()}
        return {name: {"type": kinds[type(part)], **_fields(f"{key}.{name}", part)} for name, part in value.items()}
    if isinstance(value, Mapping):
        return {name: _table(f"{key}.{name}", part) for name, part in value.items()}
    if isinstance(value, tuple):
        return [_table(key, part) for part in value]
    plain = np.asarray(value)
    return value if isinstance(value, (str, bool)) else plain.tolist()


def _fields(key: str, value: Any) -> dict[str, Any]:
    parts = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
    named = {
        n: _table(f"{key}.{n}" if key else n, p) for n, p in parts.items() if p is not None or f"{key}.{n}" in CLASSES
    }
    return named


def gains_table(controller: Any) -> str:
    """`gains.toml`: the controller, which `--config` reads back; of a law of the user's own its numbers."""
    if type(controller) in CLASSES["controller"].values():
        return tomli_w.dumps({"version": VERSION, "controller": _table("controller", controller)})
    numbers = {name: np.asarray(x).tolist() for name, x in agvjax.leaves(controller).items()}
    return tomli_w.dumps({"version": VERSION, "gains": numbers})
