"""The spellings of TOML that are no plain table, number or word: each is read and written by one codec."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

import agvjax
from agvjax.metric_table import METRICS, metrics_of

from ..ensemble.draws import Between, Correlated, Correlation, Distribution, Draw, OneOf, Span, Times
from ..io.csv_file import Column
from .settings import Bound, Limit, Weights, default_limits

if TYPE_CHECKING:
    from .read import Reader
    from .write import Writer

Toml = Any  # what a file may hold, or a person may have put in its place
KINDS = ("between", "times", "one_of", "distribution")  # of draws


class Codec:
    """How one setting is spelled: `read` makes it of a table, `write` makes the table of it.

    `read` notes what is wrong with the table and goes on with the default. `write` leaves what is no such setting as it
    is: it is then refused with the rule of `read`.
    """

    def read(self, reader: Reader, key: str, default: Any, table: Toml) -> Any:
        """The setting at `key`."""
        raise NotImplementedError

    def write(self, writer: Writer, key: str, value: Any) -> Toml:
        """What `read` reads to the same."""
        return value


@dataclasses.dataclass(frozen=True)
class Names(Codec):
    """A list of names; one may have to be there."""

    least: int = 1

    def read(self, reader: Reader, key: str, default: Any, table: Toml) -> Any:
        """A tuple."""
        if not isinstance(table, list) or len(table) < self.least or not all(isinstance(x, str) for x in table):
            reader.wrong(key, table, "a list of names, at least one")
            return default
        return tuple(table)


@dataclasses.dataclass(frozen=True)
class Named(Codec):
    """A table of values of one kind by name; a name with dots may be tables in tables.

    Attributes:
        one: makes a value of what stands in the table, or raises ValueError with the rule.
        spelled: what stands in the table for a value.
        kinds: keys that tell a value that is a table from a part of a longer name; None where names have no dots.
    """

    one: Callable[[Toml], Any]
    spelled: Callable[[Any], Toml] = lambda value: value
    kinds: Sequence[str] | None = ()

    def read(self, reader: Reader, key: str, default: Any, table: Toml) -> Any:
        """A dictionary."""
        if not isinstance(table, Mapping):
            reader.wrong(key, table, "a table")
            return default
        values, before = {}, len(reader.faults)
        for name, value in table.items() if self.kinds is None else flat(table, self.kinds):
            try:
                values[name] = self.one(value)
            except ValueError as error:
                reader.wrong(f"{key}.{name}", value, str(error))
        return values if len(reader.faults) == before else default

    def write(self, writer: Writer, key: str, value: Any) -> Toml:
        """A table without tables in it for dots."""
        return {name: self.spelled(x) for name, x in value.items()} if isinstance(value, Mapping) else value


class Columns(Named):
    """Columns of a log by what they hold; one without a name of its own has the name of that."""

    def read(self, reader: Reader, key: str, default: Any, table: Toml) -> Any:
        """A dictionary."""
        columns = super().read(reader, key, {}, table)
        return {name: x if x.column else x._replace(column=name) for name, x in columns.items()}


class Axes(Named):
    """The axes of a sweep: a list of tables, in each the leaves that move as one."""

    def read(self, reader: Reader, key: str, default: Any, table: Toml) -> Any:
        """A tuple of dictionaries."""
        if not isinstance(table, list) or not all(isinstance(axis, Mapping) and axis for axis in table):
            reader.wrong(key, table, "a list of tables of leaves: [[sweep.over]]")
            return default
        axes = [super(Axes, self).read(reader, key, None, axis) for axis in table]
        return default if None in axes else tuple(axes)

    def write(self, writer: Writer, key: str, value: Any) -> Toml:
        """A list of tables."""
        several = isinstance(value, (tuple, list))
        return [super(Axes, self).write(writer, key, axis) for axis in value] if several else value


@dataclasses.dataclass(frozen=True)
class Judged(Codec):
    """Tables of one dataclass by metric, or a number that stands for one; only what is not the default is written."""

    kind: type
    of_number: Callable[[float], Any]
    metrics: Sequence[str] = ()  # that there are; empty where another rule says so

    def read(self, reader: Reader, key: str, default: Any, table: Toml) -> Any:
        """A dictionary."""
        if not isinstance(table, Mapping):
            reader.wrong(key, table, "a table")
            return default
        values, before = dict(self.base(reader.plant)), len(reader.faults)
        for name, value in table.items():
            part = f"{key}.{name}"
            if self.metrics and name not in self.metrics:
                reader.unknown(part, value, self.metrics)
            elif isinstance(value, Mapping):
                values[name] = reader.fields(part, self.kind(), value)
            else:
                values[name] = self.of_number(reader.plain(part, 1.0, value))
        return values if len(reader.faults) == before else default

    def write(self, writer: Writer, key: str, value: Any) -> Toml:
        """A table of tables."""
        return {name: self.spelled(x) for name, x in value.items()} if isinstance(value, Mapping) else value

    def spelled(self, value: Any) -> Toml:
        """What of one is not the default."""
        same = type(value) is self.kind
        return {n: x for n, x in vars(value).items() if x != getattr(self.kind(), n)} if same else value

    def base(self, plant: agvjax.Plant) -> Mapping[str, Any]:
        """What the table adds to."""
        return {}


class Limits(Judged):
    """Limits add to the default ones that the plant has; a table of nothing takes one of them away."""

    def read(self, reader: Reader, key: str, default: Any, table: Toml) -> Any:
        """A dictionary of what limits something."""
        values = super().read(reader, key, default, table)
        return {name: x for name, x in values.items() if x != Limit()} if isinstance(values, dict) else values

    def write(self, writer: Writer, key: str, value: Any) -> Toml:
        """A table of tables."""
        base = dict.fromkeys(self.base(writer.plant), Limit())
        return super().write(writer, key, base | dict(value) if isinstance(value, Mapping) else value)

    def base(self, plant: agvjax.Plant) -> Mapping[str, Any]:
        """The default limits."""
        return {name: limit for name, limit in default_limits().items() if name in metrics_of(plant)}


class Fails(Judged):
    """Bounds beyond which a run has failed, which must not be tables of nothing."""

    def spelled(self, value: Any) -> Toml:
        """At least the value."""
        return super().spelled(value) or {"value": value.value}


class Correlations(Codec):
    """`{ leaves = [names], matrix = [[numbers]] }`."""

    def read(self, reader: Reader, key: str, default: Any, table: Toml) -> Any:
        """A `Correlation`."""
        whole = isinstance(table, Mapping) and set(table) == {"leaves", "matrix"}
        leaves, rows = (table["leaves"], table["matrix"]) if whole else (None, None)
        matrix = numbers(rows) if isinstance(leaves, list) and isinstance(rows, list) else None
        if not leaves or matrix is None or matrix.ndim != 2 or not all(isinstance(name, str) for name in leaves):
            reader.wrong(key, table, "{ leaves = [names], matrix = [[numbers]] }")
            return default
        return Correlation(tuple(leaves), tuple(tuple(row) for row in matrix.tolist()))

    def write(self, writer: Writer, key: str, value: Any) -> Toml:
        """A table of two lists."""
        return value._asdict() if isinstance(value, Correlation) else value


class Options(Codec):
    """A table of anything: the optimiser's own words."""

    def read(self, reader: Reader, key: str, default: Any, table: Toml) -> Any:
        """A dictionary."""
        if not isinstance(table, Mapping):
            reader.wrong(key, table, "a table")
            return default
        return dict(table)


class Slopes(Codec):
    """A believed slope: a number or one per axis, or a table of both slopes of a deadzone that is known."""

    def read(self, reader: Reader, key: str, default: Any, table: Toml) -> Any:
        """A number, an array or `KnownSlopes`."""
        if isinstance(table, Mapping):
            return reader.fields(key, agvjax.KnownSlopes(), table)
        return reader.plain(key, 1.0, table)

    def write(self, writer: Writer, key: str, value: Any) -> Toml:
        """The same."""
        return writer.fields(key, value) if isinstance(value, agvjax.KnownSlopes) else value


class Chains(Codec):
    """By actuator a table of elements in the order of the signal, of the type that its name says unless it has one."""

    def read(self, reader: Reader, key: str, default: Any, table: Toml) -> Any:
        """A dictionary of chains."""
        if not isinstance(table, Mapping) or not all(isinstance(chain, Mapping) for chain in table.values()):
            reader.wrong(key, table, "a table for each actuator, of its elements in the order of the signal")
            return default
        actuators = reader.plant.actuators
        for name in set(table) - set(actuators):
            reader.unknown(f"{key}.{name}", table[name], actuators)
        return {name: self.chain(reader, f"{key}.{name}", table[name]) for name in table if name in actuators}

    def chain(self, reader: Reader, key: str, table: Mapping[str, Toml]) -> agvjax.Chain:
        """What one actuator's signal runs through."""
        parts, kinds = {}, reader.classes["elements"]
        for name, fields in table.items():
            kind = fields.get("type", name) if isinstance(fields, Mapping) else None
            if kind not in kinds:
                reader.wrong(f"{key}.{name}", fields, f"a table, its name or its type one of {', '.join(kinds)}")
                continue
            rest = {field: value for field, value in fields.items() if field != "type"}
            parts[name] = reader.fields(f"{key}.{name}", kinds[kind](), rest)
        return agvjax.Chain(**parts)

    def write(self, writer: Writer, key: str, value: Any) -> Toml:
        """Every element with its type."""
        return {
            name: {part: writer.typed(f"{key}.{name}.{part}", x, "elements") for part, x in chain.items()}
            for name, chain in value.items()
        }


class Deadzones(Codec):
    """By actuator a table that changes the plant's nominal deadzone, or "none" for an actuator without one."""

    def read(self, reader: Reader, key: str, default: Any, table: Toml) -> Any:
        """A dictionary of deadzones."""
        if not isinstance(table, Mapping):
            reader.wrong(key, table, "a table")
            return default
        for name in set(table) - set(reader.plant.actuators):
            reader.unknown(f"{key}.{name}", table[name], reader.plant.actuators)
        deadzones = {}
        for name in reader.plant.actuators:
            fields = table.get(name, {} if name in default else "none")
            if fields != "none":
                deadzones[name] = reader.fields(f"{key}.{name}", default.get(name, agvjax.Deadzone()), fields)
        return deadzones

    def write(self, writer: Writer, key: str, value: Any) -> Toml:
        """All their numbers."""
        tables = {name: writer.write(f"{key}.{name}", x, agvjax.Deadzone()) for name, x in value.items()}
        return tables | {name: "none" for name in writer.plant.deadzones() if name not in value}


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


def _number(value: Toml) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _pair(value: Toml) -> tuple[float, float]:
    array = numbers(value) if isinstance(value, list) else None
    if array is None or array.shape != (2,) or not array[0] <= array[1]:
        raise ValueError("[low, high] with low <= high")
    return float(array[0]), float(array[1])


def _gain(value: Toml) -> str:
    if not isinstance(value, str):
        raise ValueError("the name of a gain")
    return value


def _draw(table: Toml) -> Draw:
    """`{ between = [low, high] }` and its like."""
    rule = "{ between = [low, high] }, { times = [low, high] } with low <= high, { one_of = [values] }, or"
    rule += ' { distribution = "a name in scipy.stats", its parameters, times = true or false }'
    rest = dict(table) if isinstance(table, Mapping) else {}
    if "distribution" in rest:
        name, times = rest.pop("distribution"), rest.pop("times", False)
        if not (isinstance(name, str) and isinstance(times, bool) and all(map(_number, rest.values()))):
            raise ValueError(rule)
        draw = Distribution(name, {key: float(value) for key, value in rest.items()}, times)
        try:
            draw.quantile(0.5, 1.0)
        except ValueError as error:
            raise ValueError(f"a distribution of scipy.stats with its parameters ({error})") from error
        return draw
    kind, value = next(iter(rest.items())) if len(rest) == 1 else ("", None)
    array = numbers(value) if isinstance(value, list) else None
    if array is None or array.ndim != 1 or not array.size or not np.all(np.isfinite(array)):
        raise ValueError(rule)
    if kind == "one_of":
        return OneOf(tuple(array.tolist()))
    if kind not in ("between", "times") or array.size != 2 or array[0] > array[1]:
        raise ValueError(rule)
    return (Between if kind == "between" else Times)(*array.tolist())


SPELLED: dict[type, Callable[[Any], Toml]] = {
    Between: lambda draw: {"between": [draw.low, draw.high]},
    Times: lambda draw: {"times": [draw.low, draw.high]},
    OneOf: lambda draw: {"one_of": draw.values},
    Distribution: lambda draw: {"distribution": draw.name, **draw.parameters, "times": draw.times},
    Correlated: lambda draw: _drawn(draw.marginal),
}


def _drawn(draw: Any) -> Toml:
    return SPELLED[type(draw)](draw) if type(draw) in SPELLED else draw


def _span(table: Toml) -> Span:
    """A draw with `points`, the number of values on a grid: all of `one_of`; 0, or none of the others, to sample."""
    rule = "{ between = [low, high], points = 11 }, without points to be sampled; or times, one_of, a distribution;"
    rest = {"one_of": table} if isinstance(table, list) else dict(table) if isinstance(table, Mapping) else {}
    points = rest.pop("points", None)
    try:
        draw = _draw(rest)
        every = len(draw.values) if isinstance(draw, OneOf) else 0
        points = every if points is None else points
        if (
            type(points) is not int
            or points < 0
            or (every and (points not in (0, every) or len(set(draw.values)) < every))
        ):
            raise ValueError
    except ValueError as error:
        raise ValueError(f"{rule} or a list of values") from error
    return Span(draw, points)


def _spanned(span: Any) -> Toml:
    if not isinstance(span, Span):
        return span
    every = len(span.draw.values) if isinstance(span.draw, OneOf) else 0
    return _drawn(span.draw) if span.points == every else {**_drawn(span.draw), "points": span.points}


def _column(value: Toml) -> Column:
    table = {"column": value} if isinstance(value, str) else value
    rule = '"the name of a column", or { column = "its name", unit = "deg", factor = -1 }, no factor 0'
    if not isinstance(table, Mapping) or not set(table) <= set(Column._fields):
        raise ValueError(rule)
    column = Column(**{"column": "", **table})
    words = isinstance(column.column, str) and isinstance(column.unit, str)
    if not words or not _number(column.factor) or not np.isfinite(column.factor) or column.factor == 0:
        raise ValueError(rule)
    return column


def _columned(column: Any) -> Toml:
    if not isinstance(column, Column):
        return column
    more = {name: x for name, x in (("unit", column.unit), ("factor", column.factor)) if x not in ("", 1.0)}
    return {"column": column.column, **more} if more else column.column


CODECS: dict[str, Codec] = {
    "scenario.deadzone": Deadzones(),
    "scenario.actuators": Chains(),
    "ensemble.draws": Named(_draw, _drawn, KINDS),
    "ensemble.correlation": Correlations(),
    "tune.gains": Names(0),
    "tune.tied": Named(_gain),
    "tune.bounds": Named(_pair),
    "tune.goals": Judged(Weights, lambda x: Weights(mean=x), tuple(METRICS)),
    "tune.limits": Limits(Limit, lambda x: Limit(mean=x, worst=x), tuple(METRICS)),
    "tune.options": Options(),
    "sweep.over": Axes(_span, _spanned, KINDS),
    "sweep.metrics": Names(),
    "sweep.controllers": Names(0),
    "sweep.fails": Fails(Bound, lambda x: Bound(value=x)),
    "identify.fit": Names(),
    "identify.columns": Columns(_column, _columned, None),
} | {f"{law}.{name}": Slopes() for law in ("controller", "controller.inner") for name in ("Pi_hat", "Pi_psi_hat")}
