"""Tables of TOML into objects, and what is wrong with what was given."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

import agvjax
from agvjax.metric_table import METRICS, metrics_of

from ..ensemble.draws import Between, Correlation, Distribution, Draw, OneOf, Span, Times
from ..io.csv_file import Column
from .names import CLASSES, ELEMENTS
from .recipes import RECIPES, Recipe
from .settings import CHOICES, OPEN, Bound, Limit, Weights, default_limits

EMPTY = ("sweep.controllers", "sweep.export", "tune.gains")  # lists that may hold nothing
DRAWS = ("between", "times", "one_of", "distribution")


class Reader:
    """Builds objects from tables and collects what is wrong on the way."""

    def __init__(self) -> None:
        self.faults: list[agvjax.Fault] = []
        self.plant: Any = agvjax.Decoupled()  # of the scenario, as far as read

    def wrong(self, key: str, value: Any, rule: str, source: str = "") -> None:
        """Note what is wrong."""
        self.faults.append(agvjax.Fault(key, value if isinstance(value, (int, float)) else repr(value), rule, source))

    def unknown(self, key: str, value: Any, known: Sequence[str]) -> None:
        """Note a name that is not known."""
        name = key.rpartition(".")[2]
        near = difflib.get_close_matches(name, known, 1, 0.5)
        self.wrong(key, value, f"a known key; did you mean {near[0]}?" if near else f"one of {', '.join(known)}")

    def build(self, key: str, default: Any, given: Any) -> Any:
        """The object at `key`: the default with what the table gives."""
        if key in CLASSES:
            return self.pick(key, default, given)
        if key == "identify.columns":
            return self.columns(key, given)
        if key == "ensemble.correlation":
            return self.correlation(key, given)
        if default is OPEN and key in self.opened():
            default = self.opened()[key]
        if default is None:
            self.wrong(key, given, "absent: it can be set in Python only")
            return default
        if key == "scenario":
            return self.scenario(default, given)
        if key == "scenario.actuators":
            return self.chains(key, default, given)
        if key == "ensemble.draws":
            return self.draws(key, given)
        if key == "tune.bounds":
            pairs = self.pairs(key, given, _is_pair, "[low, high] with low <= high")
            return {name: (float(pair[0]), float(pair[1])) for name, pair in pairs.items()}
        if key in ("tune.goals", "tune.limits"):
            return self.requirements(key, default, given)
        if key == "sweep.over":
            return self.axes(key, default, given)
        if key == "sweep.fails":
            return self.bounds(key, default, given)
        if key == "tune.tied":
            return self.pairs(key, given, lambda value: isinstance(value, str), "the name of a gain")
        if key == "tune.choices":
            rule = "a list of the values to try"
            return self.pairs(key, given, lambda value: isinstance(value, list) and bool(value), rule)
        if key.endswith((".Pi_hat", ".Pi_psi_hat")) and isinstance(given, Mapping):
            return self.fields(key, agvjax.KnownSlopes(), given)
        if dataclasses.is_dataclass(default) and not isinstance(default, type):
            return self.fields(key, default, given)
        if isinstance(default, dict):
            return self.mapping(key, default, given)
        return self.scalar(key, default, given)

    def opened(self) -> dict[str, Any]:
        """What a table of these keys adds to, where the settings leave open what the law and the plant say."""
        known = metrics_of(self.plant)
        limits = {name: limit for name, limit in default_limits().items() if name in known}
        return {"tune.gains": (), "tune.limits": limits, "sweep.over": (), "sweep.metrics": (), "ensemble.draws": {}}

    def fields(self, key: str, default: Any, given: Any) -> Any:
        """A dataclass from a table."""
        if not isinstance(given, Mapping):
            self.wrong(key, given, "a table")
            return default
        known = [f.name for f in dataclasses.fields(default)]
        counts = [f.name for f in dataclasses.fields(default) if f.metadata.get("static") and type(f.default) is int]
        new = {}
        for name, value in given.items():
            part = f"{key}.{name}" if key else name
            if name not in known:
                self.unknown(part, value, known)
            elif name in counts and not (type(value) is int and value >= 1):
                self.wrong(part, value, "a whole number >= 1")
            else:
                new[name] = self.build(part, getattr(default, name), value)
        return dataclasses.replace(default, **new)

    def pick(self, key: str, default: Any, given: Any) -> Any:
        """An object of the class that the table names."""
        classes = CLASSES[key]
        if isinstance(given, str):
            given = {"type": given}
        if not isinstance(given, Mapping):
            self.wrong(key, given, "a table or the name of a type")
            return default
        kind = given.get("type")
        if kind is not None and (not isinstance(kind, str) or kind not in classes):
            self.wrong(f"{key}.type", kind, f"one of {', '.join(classes)}")
            return default
        rest = {name: value for name, value in given.items() if name != "type"}
        recipe = RECIPES.get(type(default) if kind is None else classes[kind])
        if recipe is not None:
            return self.make(key, default, rest, recipe)
        if kind is not None and (classes[kind] is None or type(default) is not classes[kind]):
            default = None if classes[kind] is None else classes[kind]()
            if isinstance(default, agvjax.Sampled):
                default = dataclasses.replace(default, vehicle=self.plant)
        if default is None:
            for name, value in rest.items():
                self.wrong(f"{key}.{name}", value, "absent: this type has nothing to set")
            return None
        return self.fields(key, default, rest)

    def make(self, key: str, default: Any, given: Mapping[str, Any], recipe: Recipe) -> Any:
        """An object that a function of its own makes from the table."""
        for name in given:
            if name not in recipe.keys:
                self.unknown(f"{key}.{name}", given[name], recipe.keys)
        try:
            return recipe.make(given)
        except agvjax.InputError as error:
            for problem in error.faults:
                self.wrong(f"{key}.{problem.key}", problem.value, problem.rule, problem.source)
            return default

    def scenario(self, default: Any, given: Any) -> Any:
        """The plant first: the names of actuators, and the deadzones that are meant where none are given, are its."""
        if isinstance(given, Mapping) and "plant" in given:
            plant = self.build("scenario.plant", default.plant, given["plant"])
            nominal = default.deadzone if plant.actuators == default.plant.actuators else plant.deadzones()
            default = dataclasses.replace(default, plant=plant, deadzone=nominal)
            given = {name: value for name, value in given.items() if name != "plant"}
        self.plant = default.plant
        return self.fields("scenario", default, given)

    def chains(self, key: str, default: Any, given: Any) -> Any:
        """By actuator what its signal runs through, in the order of the table."""
        if not isinstance(given, Mapping) or not all(isinstance(table, Mapping) for table in given.values()):
            self.wrong(key, given, "a table for each actuator, of its elements in the order of the signal")
            return default
        for name in set(given) - set(self.plant.actuators):
            self.unknown(f"{key}.{name}", given[name], self.plant.actuators)
        return {name: self.chain(f"{key}.{name}", given[name]) for name in given if name in self.plant.actuators}

    def chain(self, key: str, given: Mapping[str, Any]) -> agvjax.Chain:
        """Elements by name, which says of what type one is unless the table does."""
        parts = {}
        for name, table in given.items():
            kind = table.get("type", name) if isinstance(table, Mapping) else name
            if kind not in ELEMENTS or not isinstance(table, Mapping):
                rule = f"a table, its name or its type one of {', '.join(ELEMENTS)}"
                self.wrong(f"{key}.{name}", table, rule)
                continue
            rest = {field: value for field, value in table.items() if field != "type"}
            parts[name] = self.fields(f"{key}.{name}", ELEMENTS[kind](), rest)
        return agvjax.Chain(**parts)

    def mapping(self, key: str, default: dict[str, Any], given: Any) -> Any:
        """A dictionary from a table."""
        if not isinstance(given, Mapping):
            self.wrong(key, given, "a table")
            return default
        if key == "tune.options":
            return dict(given)
        for name in set(given) - set(default):
            self.unknown(f"{key}.{name}", given[name], tuple(default))
        return {n: self.build(f"{key}.{n}", part, given[n]) if n in given else part for n, part in default.items()}

    def scalar(self, key: str, default: Any, given: Any) -> Any:
        """A number, array, string, flag or list of names."""
        if isinstance(default, bool) or isinstance(default, str):
            if type(given) is not type(default):
                self.wrong(key, given, "true or false" if isinstance(default, bool) else "a string")
                return default
            if given not in CHOICES.get(key, (given,)):
                self.wrong(key, given, f"one of {', '.join(CHOICES[key])}")
                return default
            return given
        if isinstance(default, tuple):
            none = given == [] and key not in EMPTY
            if none or not isinstance(given, list) or not all(isinstance(x, str) for x in given):
                self.wrong(key, given, "a list of names, at least one")
                return default
            return tuple(given)
        array = _numbers(given)
        listed = key.startswith(("controller.", "scenario."))  # where a leaf may be an array its own rule says which
        if array is None or (array.ndim and not listed):
            self.wrong(key, given, "a number or a list of numbers" if listed else "a number")
            return default
        if array.ndim:
            return array.astype(float)
        whole = isinstance(default, int) and np.isfinite(array) and array == np.round(array)
        return int(array) if whole else float(array)

    def draws(self, key: str, given: Any) -> dict[str, Draw]:
        """Distributions by the leaf they draw."""
        found: dict[str, Draw] = {}
        before = len(self.faults)
        if not isinstance(given, Mapping):
            self.wrong(key, given, "a table")
            return {}
        for name, draw in flat(given, DRAWS):
            read = _draw(draw)
            if read is None:
                rule = "{ between = [low, high] }, { times = [low, high] } with low <= high, { one_of = [values] }, or"
                rule += ' { distribution = "a name in scipy.stats", its parameters, times = true or false }'
                self.wrong(f"{key}.{name}", draw, rule)
                continue
            try:
                read.quantile(0.5, 1.0)
                found[name] = read
            except ValueError as error:
                self.wrong(f"{key}.{name}", draw, f"a distribution of scipy.stats with its parameters ({error})")
        return found if len(self.faults) == before else {}

    def columns(self, key: str, given: Any) -> dict[str, Column]:
        """Columns of a log by what they hold: a name, or a name, a unit and a factor."""
        if not isinstance(given, Mapping):
            self.wrong(key, given, "a table")
            return {}
        found = {}
        for name, value in given.items():
            table = {"column": value} if isinstance(value, str) else value
            column = Column(**{"column": name, **table}) if _column(table) else None
            if column is None:
                rule = '"the name of a column", or { column = "its name", unit = "deg", factor = -1 }, no factor 0'
                self.wrong(f"{key}.{name}", value, rule)
            else:
                found[name] = column
        return found

    def correlation(self, key: str, given: Any) -> Correlation | None:
        """Leaves and a matrix."""
        leaves = given.get("leaves") if isinstance(given, Mapping) and set(given) == {"leaves", "matrix"} else None
        matrix = _numbers(given["matrix"]) if isinstance(leaves, list) and isinstance(given["matrix"], list) else None
        names = isinstance(leaves, list) and all(isinstance(name, str) for name in leaves)
        if matrix is None or matrix.ndim != 2 or not names or not leaves:
            self.wrong(key, given, "{ leaves = [names], matrix = [[numbers]] }")
            return None
        return Correlation(tuple(leaves), tuple(tuple(row) for row in matrix.tolist()))

    def requirements(self, key: str, default: Any, given: Any) -> Any:
        """Goals or limits by metric: a table of statistics, or one number for a mean, of a limit for the worst too."""
        if not isinstance(given, Mapping):
            self.wrong(key, given, "a table")
            return default
        goals, before = key == "tune.goals", len(self.faults)
        found = {} if goals else dict(default)
        for name, value in given.items():
            if name not in METRICS:
                self.unknown(f"{key}.{name}", value, tuple(METRICS))
            elif isinstance(value, Mapping):
                found[name] = self.fields(f"{key}.{name}", Weights() if goals else Limit(), value)
            else:
                number = self.scalar(f"{key}.{name}", 1.0, value)
                found[name] = Weights(mean=number) if goals else Limit(mean=number, worst=number)
        return found if len(self.faults) == before else default

    def axes(self, key: str, default: Any, given: Any) -> Any:
        """The axes of a sweep: a list of tables, in each the leaves that move as one."""
        if not isinstance(given, list) or not all(isinstance(table, Mapping) and table for table in given):
            self.wrong(key, given, "a list of tables of leaves: [[sweep.over]]")
            return default
        before, found = len(self.faults), []
        for table in given:
            spans = {name: _span(value) for name, value in flat(table, DRAWS)}
            for name, value in flat(table, DRAWS):
                if spans[name] is None:
                    rule = "{ between = [low, high], points = 11 }, without points to be sampled; or times, one_of, a"
                    self.wrong(f"{key}.{name}", value, f"{rule} distribution; or a list of values")
            found.append(spans)
        return tuple(found) if len(self.faults) == before else default

    def bounds(self, key: str, default: Any, given: Any) -> Any:
        """Failures by metric: a table, or a number for a multiple of the nominal run's."""
        if not isinstance(given, Mapping):
            self.wrong(key, given, "a table")
            return default
        tables = {name: value if isinstance(value, Mapping) else {"value": value} for name, value in given.items()}
        return {name: self.fields(f"{key}.{name}", Bound(), value) for name, value in tables.items()}

    def pairs(self, key: str, given: Any, fits: Callable[[Any], bool], rule: str) -> dict[str, Any]:
        """Values by dotted name, those that fit."""
        if not isinstance(given, Mapping):
            self.wrong(key, given, "a table")
            return {}
        found = dict(flat(given, ()))
        for name, value in found.items():
            if not fits(value):
                self.wrong(f"{key}.{name}", value, rule)
        return {name: value for name, value in found.items() if fits(value)}


def _draw(given: Any) -> Draw | None:
    """A draw as a table says it; None where it says none."""
    if not isinstance(given, Mapping):
        return None
    if "distribution" in given:
        rest = {name: value for name, value in given.items() if name not in ("distribution", "times")}
        times, fine = given.get("times", False), all(_number(value) for value in rest.values())
        if not (isinstance(given["distribution"], str) and isinstance(times, bool) and fine):
            return None
        return Distribution(given["distribution"], {name: float(value) for name, value in rest.items()}, times)
    kind, value = next(iter(given.items())) if len(given) == 1 else ("", [])
    if kind in ("between", "times") and _is_pair(value) and np.all(np.isfinite(value)):
        return {"between": Between, "times": Times}[kind](float(value[0]), float(value[1]))
    if kind == "one_of" and isinstance(value, list) and value and all(_number(x) and np.isfinite(x) for x in value):
        return OneOf(tuple(float(x) for x in value))
    return None


def _span(given: Any) -> Span | None:
    """An axis as a table or a list says it; None where it says none."""
    given = {"one_of": given} if isinstance(given, list) else given
    if not isinstance(given, Mapping):
        return None
    points, draw = given.get("points"), _draw({name: value for name, value in given.items() if name != "points"})
    if draw is None or not (points is None or (isinstance(points, int) and points >= 1)) or isinstance(points, bool):
        return None
    try:
        draw.quantile(0.5, 1.0)
    except ValueError:
        return None
    if isinstance(draw, OneOf):
        return None if points or len(set(draw.values)) < len(draw.values) else Span(draw, len(draw.values))
    return Span(draw, points or 0)


def _number(given: Any) -> bool:
    return isinstance(given, (int, float)) and not isinstance(given, bool)


def _column(given: Any) -> bool:
    """Whether this table says where a column is."""
    if not isinstance(given, Mapping) or not set(given) <= {"column", "unit", "factor"}:
        return False
    factor = given.get("factor", 1.0)
    return (
        all(isinstance(given.get(name, ""), str) for name in ("column", "unit"))
        and _number(factor)
        and bool(np.isfinite(factor))
        and factor != 0
    )


def _numbers(given: Any) -> np.ndarray | None:
    """A number or a regular list of numbers as an array; None for anything else."""
    if isinstance(given, bool) or not isinstance(given, (int, float, list)):
        return None
    try:
        array = np.asarray(given)
        return array.astype(float) if array.dtype.kind in "ifO" else None
    except (ValueError, TypeError, OverflowError):  # unequal lists, strings among numbers, integers beyond any float
        return None


def _is_pair(pair: Any) -> bool:
    array = _numbers(pair) if isinstance(pair, list) else None
    return array is not None and array.shape == (2,) and bool(array[0] <= array[1])


def flat(table: Mapping[str, Any], ends: Sequence[str], prefix: str = "") -> list[tuple[str, Any]]:
    """Dotted keys, quoted or not, as one flat list."""
    rows = []
    for name, value in table.items():
        nested = isinstance(value, Mapping) and not set(value) & set(ends)
        rows += flat(value, ends, f"{prefix}{name}.") if nested and value else [(prefix + name, value)]
    return rows
