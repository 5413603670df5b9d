"""Values that stand in tables of TOML by name: draws, axes, pairs, columns; and the words that are written for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..ensemble.draws import LEAST, Between, Correlated, Distribution, Draw, OneOf, Plus, Range, Span, Times, Usual
from ..io.csv_file import Column
from ..io.logs.roles import ROLE_NAMES

Toml = Any  # what a file may hold, or a person may have put in its place
Setting = Any  # what that stands for: a number, a word, an object of the simulator or of the settings
KINDS = ("between", "plus", "times", "one_of", "distribution")  # of draws
NAMED = {  # tables of values by name, each with the keys of a value that is a table
    "ensemble.draws": KINDS,
    "tune.tied": (),
    "tune.bounds": (),
    "identify.columns": ("column", "unit", "factor", "quaternion"),
}


def flat(table: Mapping[str, Toml], kinds: Sequence[str], prefix: str = "") -> list[tuple[str, Toml]]:
    """Dotted keys, quoted or not, as one flat list; a table with one of the `kinds` in it is a value."""
    rows = []
    for name, value in table.items():
        nested = isinstance(value, Mapping) and not set(value) & set(kinds)
        rows += flat(value, kinds, f"{prefix}{name}.") if nested and value else [(prefix + name, value)]
    return rows


def numbers(value: Toml) -> np.ndarray | None:
    """A number or a regular list of numbers as an array; None for anything else."""
    if isinstance(value, bool) or not isinstance(value, (int, float, list)):
        return None
    try:
        array = np.asarray(value)
        return array.astype(float) if array.dtype.kind in "ifO" else None
    except (ValueError, TypeError, OverflowError):  # unequal lists, strings among numbers, integers beyond any float
        return None


def gain(value: Toml, name: str) -> str:
    """The gain that another is tied to."""
    if not isinstance(value, str):
        raise ValueError("the name of a gain")
    return value


def pair(value: Toml, name: str) -> tuple[float, float]:
    """The bounds of a gain."""
    array = numbers(value) if isinstance(value, list) else None
    if array is None or array.shape != (2,) or not array[0] <= array[1]:
        raise ValueError("[low, high] with low <= high")
    return float(array[0]), float(array[1])


RANGES: dict[str, type[Range]] = {"between": Between, "plus": Plus, "times": Times}


def draw(table: Toml, name: str = "") -> Draw:
    """How a leaf is drawn."""
    rule = (
        "{ between = [low, high] }, { plus = [low, high] }, { times = [low, high] } with low <= high, or a [low, high]"
    )
    rule += (
        ' for each element; { one_of = [values] }; { distribution = "a name in scipy.stats", its parameters, times ='
    )
    rule += ' true or false }; or "default"'
    if table == "default":
        return Usual()
    rest = dict(table) if isinstance(table, Mapping) else {}
    if "distribution" in rest:
        return _distribution(rest, rule)
    kind, value = next(iter(rest.items())) if len(rest) == 1 else ("", None)
    array = numbers(value) if isinstance(value, list) else None
    if array is None or not array.size or not np.all(np.isfinite(array)):
        raise ValueError(rule)
    if kind == "one_of" and array.ndim == 1:
        return OneOf(tuple(array.tolist()))
    if kind not in RANGES or array.ndim > 2 or array.shape[-1] != 2 or np.any(array[..., 0] > array[..., 1]):
        raise ValueError(rule)
    low, high = (tuple(end) if isinstance(end, list) else end for end in array.T.tolist())
    return RANGES[kind](low, high)


def _distribution(rest: dict[str, Toml], rule: str) -> Distribution:
    family, times = rest.pop("distribution"), rest.pop("times", False)
    if not (isinstance(family, str) and isinstance(times, bool) and all(map(_number, rest.values()))):
        raise ValueError(rule)
    distribution = Distribution(family, {key: float(value) for key, value in rest.items()}, times)
    try:
        for share in (LEAST, 0.5, 1 - LEAST):  # its tails may be infinite where the middle is not
            distribution.quantile(share, 1.0)
    except ValueError as error:
        raise ValueError(f"a distribution of scipy.stats with its parameters ({error})") from error
    return distribution


def _number(value: Toml) -> bool:
    return isinstance(value, (int, float)) and numbers(value) is not None  # no flag, and no integer beyond any float


def span(table: Toml, name: str = "") -> Span:
    """A draw with `points`: on a grid, of `one_of` all values; without points, or 0 of `one_of`, it is sampled."""
    rule = "{ between = [low, high], points = 11 }, without points to be sampled; or times, one_of, a distribution;"
    rule += " or a list of values"
    rest: Toml = {"one_of": table} if isinstance(table, list) else dict(table) if isinstance(table, Mapping) else {}
    points = rest.pop("points", None)
    try:
        axis = draw(rest)
    except ValueError as error:
        raise ValueError(rule) from error
    values = axis.values if isinstance(axis, OneOf) else ()
    usable = (0, len(values)) if values else range(1, 2**63)
    if len(set(values)) < len(values) or not (points is None or (type(points) is int and points in usable)):
        raise ValueError(rule)
    return Span(axis, len(values) if points is None else points)


def column(value: Toml, name: str) -> Column:
    """Where a quantity stands in a log; in a column of its own name unless another is said."""
    rule = '"the name of a column", or { column = "its name", unit = "deg", factor = -1 }, no factor 0'
    rule += '; of t, a second one for nanoseconds = "its name"'
    rule += '; of heading also { quaternion = ["qx", "qy", "qz", "qw"] }, or z and w alone, without unit'
    table: Toml = {"column": value} if isinstance(value, str) else value
    if not isinstance(table, Mapping) or not set(table) <= set(Column._fields) or "." in name:
        raise ValueError(rule)
    parts = table.get("quaternion", ())
    if parts != () and not _quaternion(name, table):
        raise ValueError(rule)
    place = Column(**{"column": "" if parts else name, **table, "quaternion": tuple(parts)})
    words = all(isinstance(word, str) for word in (place.column, place.unit, place.nanoseconds))
    if not words or not _number(place.factor) or not np.isfinite(place.factor) or place.factor == 0:
        raise ValueError(rule)
    return place


def topic(value: Toml, name: str) -> str:
    """The topic of a recording that serves as something; empty where none is to."""
    if name not in ROLE_NAMES:
        raise ValueError(f"one of {', '.join(ROLE_NAMES)} by name")
    if not isinstance(value, str):
        raise ValueError('the name of a topic, as "/odom", or "" for none')
    return value


def _quaternion(name: str, table: Mapping[str, Toml]) -> bool:
    """Whether a table tells a heading by the two or four columns of a quaternion, and nothing beside but a factor."""
    parts = table["quaternion"]
    named = isinstance(parts, (list, tuple)) and all(isinstance(part, str) and part for part in parts)
    alone = not (table.get("column") or table.get("unit") or table.get("nanoseconds"))
    return name == "heading" and named and alone and len(parts) in (2, 4) and len(set(parts)) == len(parts)


def _spelled_span(axis: Span) -> Toml:
    every = len(axis.draw.values) if isinstance(axis.draw, OneOf) else 0
    return spelled(axis.draw) if axis.points == every else {**spelled(axis.draw), "points": axis.points}


def _spelled_column(place: Column) -> Toml:
    usual = Column("")._asdict()
    more = {name: x for name, x in place._asdict().items() if name != "column" and x != usual[name]}
    if place.quaternion:
        return more | {"quaternion": list(place.quaternion)}
    return {"column": place.column, **more} if more else place.column


SPELLED = {
    **{
        cls: lambda draw, kind=kind: {kind: np.transpose([draw.low, draw.high]).tolist()}
        for kind, cls in RANGES.items()
    },
    Usual: lambda draw: "default",
    OneOf: lambda draw: {"one_of": draw.values},
    Distribution: lambda draw: {"distribution": draw.name, **draw.parameters, "times": draw.times},
    Correlated: lambda draw: spelled(draw.marginal),  # of their correlation [ensemble] has a table
    Span: _spelled_span,
    Column: _spelled_column,
}


def spelled(value: Setting) -> Toml:
    """What is written for a value; for one that is of no such kind the value."""
    return SPELLED[type(value)](value) if type(value) in SPELLED else value
