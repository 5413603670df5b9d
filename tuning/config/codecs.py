"""The spellings of TOML that are no plain table, number or word: each is read and written by one codec."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import agvjax
from agvjax.metric_table import METRICS

from ..ensemble.draws import Correlation
from .settings import GAINS, Bound, Limit, Weights
from .spellings import KINDS, NAMED, Setting, Toml, column, draw, flat, gain, numbers, pair, span, spelled, topic

if TYPE_CHECKING:
    from .read import Reader
    from .write import Writer


def _as_it_is(writer: Writer, key: str, value: Setting) -> Toml:
    return value


@dataclasses.dataclass(frozen=True)
class Codec:
    """How one setting is spelled.

    Attributes:
        read: makes the setting at a key of its default and of what stands in TOML; notes what is wrong with that.
        write: makes of a setting what `read` reads to the same.
        table: what must stand in TOML; `rule` says so to a person.
        setting: what `write` takes; anything else is left as it is, to be refused when it is read.
    """

    read: Callable[[Reader, str, Setting, Toml], Setting]
    write: Callable[[Writer, str, Setting], Toml] = _as_it_is
    table: type | tuple[type, ...] = Mapping
    rule: str = "a table"
    setting: type | tuple[type, ...] = Mapping


def _names(least: int = 1) -> Codec:
    """A list of names; at `least` so many."""
    rule = "a list of names, at least one"

    def read(reader: Reader, key: str, default: Setting, table: list[Toml]) -> tuple[str, ...]:
        if len(table) < least or not all(isinstance(name, str) for name in table):
            reader.wrong(key, table, rule)
        return tuple(table)

    return Codec(read, table=list, rule=rule)


def _gains() -> Codec:
    """A list of names, or a word for the gains of whatever law it is."""
    rule = f"a list of names, or one of {', '.join(GAINS)}"

    def read(reader: Reader, key: str, default: Setting, table: list[Toml] | str) -> tuple[str, ...] | str:
        if table not in GAINS and not (isinstance(table, list) and all(isinstance(name, str) for name in table)):
            reader.wrong(key, table, rule)
        return table if isinstance(table, str) else tuple(table)

    return Codec(read, table=(list, str), rule=rule)


def _named(one: Callable[[Toml, str], Setting], kinds: Sequence[str] = ()) -> Codec:
    """A table of values by name, which `one` makes or raises ValueError with the rule.

    A name with dots may be written as tables in tables; a table with one of the `kinds` in it is a value.
    """

    def read(reader: Reader, key: str, default: Setting, table: Mapping[str, Toml]) -> dict[str, Setting]:
        values = {}
        for name, value in flat(table, kinds):
            try:
                values[name] = one(value, name)
            except ValueError as error:
                reader.wrong(f"{key}.{name}", value, str(error))
        return values

    return Codec(read, lambda writer, key, values: {name: spelled(value) for name, value in values.items()})


def _axes() -> Codec:
    """The axes of a sweep or of a box: a list of tables, in each the leaves that move as one."""
    axis, rule = _named(span, KINDS), "a list of tables of leaves, as [[sweep.over]]"

    def read(reader: Reader, key: str, default: Setting, table: list[Toml]) -> tuple[dict[str, Setting], ...]:
        if not all(isinstance(part, Mapping) and part for part in table):
            reader.wrong(key, table, rule)
            return default
        return tuple(axis.read(reader, key, None, part) for part in table)

    def write(writer: Writer, key: str, value: Sequence[Setting]) -> Toml:
        return [axis.write(writer, key, part) if isinstance(part, Mapping) else part for part in value]

    return Codec(read, write, list, rule, (list, tuple))


def _judged(
    of: Callable[[float], Setting],
    usual_limits: bool = False,
    blank: str = "",
) -> Codec:
    """Tables of one dataclass by metric, or numbers that stand for one; what is the default is not written.

    Args:
        of: the object that a number stands for.
        usual_limits: whether the table adds to the usual limits; a table in which all is the default takes one away.
        blank: the field that is written where all are the default, which takes nothing away then; empty: none is.
    """
    usual = type(of(1.0))()

    def read(reader: Reader, key: str, default: Setting, table: Mapping[str, Toml]) -> dict[str, Setting]:
        values = dict(reader.limits) if usual_limits else {}
        for name, value in reader.named(key, table, tuple(METRICS)).items():
            if not isinstance(value, Mapping):
                values[name] = of(reader.plain(f"{key}.{name}", 1.0, value))
                continue
            values[name] = reader.fields(f"{key}.{name}", usual, value)
            if values[name] == usual and not blank:
                del values[name]
        return values

    def write(writer: Writer, key: str, values: Mapping[str, Setting]) -> Toml:
        gone = dict.fromkeys(writer.limits if usual_limits else (), usual)
        return {name: one(x) for name, x in {**gone, **values}.items()}

    def one(value: Setting) -> Toml:
        if type(value) is not type(usual):
            return value
        changed = {n: x for n, x in vars(value).items() if x != getattr(usual, n)}
        return changed or ({blank: getattr(value, blank)} if blank else {})

    return Codec(read, write)


def _correlation(reader: Reader, key: str, default: Setting, table: Mapping[str, Toml]) -> Correlation | None:
    leaves, rows = (table["leaves"], table["matrix"]) if set(table) == {"leaves", "matrix"} else (None, None)
    matrix = numbers(rows) if isinstance(leaves, list) and isinstance(rows, list) else None
    if not leaves or matrix is None or matrix.ndim != 2 or not all(isinstance(name, str) for name in leaves):
        reader.wrong(key, table, "{ leaves = [names], matrix = [[numbers]] }")
        return default
    return Correlation(tuple(leaves), tuple(tuple(row) for row in matrix.tolist()))


def _slope(reader: Reader, key: str, default: Setting, table: Toml) -> Setting:
    """An assumed slope: a number or one per axis, or a table of both slopes of a deadzone that is known."""
    if isinstance(table, Mapping):
        return reader.fields(key, agvjax.readings.KnownSlopes(), table)
    return reader.plain(key, 1.0, table)


def _deadzones(reader: Reader, key: str, default: Setting, table: Mapping[str, Toml]) -> dict[str, agvjax.Deadzone]:
    """By actuator a table that changes the nominal deadzone, or "none" for an actuator without one."""
    tables = {**dict.fromkeys(default, {}), **reader.named(key, table, reader.plant.actuators)}
    return {
        name: reader.fields(f"{key}.{name}", default.get(name, agvjax.Deadzone()), tables[name])
        for name in reader.plant.actuators
        if tables.get(name, "none") != "none"
    }


def _believed(reader: Reader, key: str, default: Setting, table: Mapping[str, Toml]) -> dict[str, agvjax.Deadzone]:
    """By actuator a table that changes the scenario's deadzone, or "none"; of other actuators a deadzone of its own.

    That the vehicle has such actuators, the law itself says.
    """
    known = reader.deadzone if set(table) <= set(reader.deadzone) else {}
    tables = {**dict.fromkeys(known, {}), **table}
    return {
        name: reader.fields(f"{key}.{name}", known.get(name, agvjax.Deadzone()), part)
        for name, part in tables.items()
        if part != "none"
    }


def _write_believed(writer: Writer, key: str, value: Mapping[str, Setting]) -> Toml:
    tables = {name: writer.write(f"{key}.{name}", part, agvjax.Deadzone()) for name, part in value.items()}
    known = writer.plant.deadzones()
    return tables | ({name: "none" for name in known if name not in value} if set(value) <= set(known) else {})


def _write_deadzones(writer: Writer, key: str, value: Mapping[str, Setting]) -> Toml:
    tables = {name: writer.write(f"{key}.{name}", part, agvjax.Deadzone()) for name, part in value.items()}
    return tables | {name: "none" for name in writer.plant.deadzones() if name not in value}


def _chains(reader: Reader, key: str, default: Setting, table: Mapping[str, Toml]) -> dict[str, agvjax.Chain]:
    """By actuator a table of elements in the order of the signal, of the type that its name says unless it has one."""
    if not all(isinstance(chain, Mapping) for chain in table.values()):
        reader.wrong(key, table, CHAINS)
        return default
    chains = reader.named(key, table, reader.plant.actuators)
    return {name: _chain(reader, f"{key}.{name}", parts) for name, parts in chains.items()}


def _chain(reader: Reader, key: str, table: Mapping[str, Toml]) -> agvjax.Chain:
    parts, kinds = {}, reader.classes["elements"]
    for name, fields in table.items():
        kind = fields.get("type", name) if isinstance(fields, Mapping) else ""
        cls = kinds.get(kind) if isinstance(kind, str) else None
        if cls is None:
            reader.wrong(f"{key}.{name}", fields, f"a table, its name or its type one of {', '.join(kinds)}")
            continue
        rest = {field: value for field, value in fields.items() if field != "type"}
        parts[name] = reader.fields(f"{key}.{name}", cls(), rest)
    return agvjax.Chain(**parts)


def _write_chains(writer: Writer, key: str, value: Mapping[str, Setting]) -> Toml:
    return {
        name: {part: writer.typed(f"{key}.{name}.{part}", x, "elements") for part, x in chain.items()}
        for name, chain in value.items()
    }


CHAINS = "a table for each actuator, of its elements in the order of the signal"
SLOPE = Codec(_slope, lambda writer, key, slopes: writer.fields(key, slopes), object, "", agvjax.readings.KnownSlopes)
CODECS = {
    "scenario.deadzone": Codec(_deadzones, _write_deadzones),
    "scenario.actuators": Codec(_chains, _write_chains, rule=CHAINS),
    **{f"controller.{part}.believed": Codec(_believed, _write_believed) for part in ("compensation", "prediction")},
    "ensemble.draws": _named(draw, NAMED["ensemble.draws"]),
    "ensemble.correlation": Codec(_correlation, lambda writer, key, x: x._asdict(), setting=Correlation),
    "tune.gains": _gains(),
    "tune.tied": _named(gain),
    "tune.bounds": _named(pair),
    "tune.goals": _judged(lambda x: Weights(mean=x)),
    "tune.limits": _judged(lambda x: Limit(mean=x, worst=x), usual_limits=True),
    "tune.options": Codec(lambda reader, key, default, table: dict(table)),
    "sweep.over": _axes(),
    "certify.over": _axes(),
    "sweep.metrics": _names(),
    "sweep.controllers": _names(0),
    "sweep.fails": _judged(lambda x: Bound(value=x), blank="value"),
    "identify.fit": _names(),
    "identify.columns": _named(column, NAMED["identify.columns"]),
    "identify.topics": _named(topic),
    **{
        f"{law}.{name}": SLOPE
        for law in ("controller", "controller.inner", "controller.inner.inner")
        for name in ("Pi_hat", "Pi_psi_hat")
    },
}
