"""What every key of a configuration is: kind of value, default, unit, rule, meaning, and where docs speak of it.

Nothing is said here that stands elsewhere: kinds, defaults, units and rules are those of the fields of settings and of
the simulator's classes, meanings the "Attributes" of their docstrings and the sources of their numbers.
"""

from __future__ import annotations

import dataclasses
import difflib
import functools
import inspect
import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

import agvjax

from ..ensemble.draws import Correlation, Distribution, OneOf, Span
from ..io.csv_file import Column
from .codecs import CODECS
from .names import CLASSES, ELEMENTS
from .recipes import RECIPES
from .settings import Bound, Config, Limit, Weights
from .spellings import RANGES

BELIEVED = tuple(f"controller.{what}.believed" for what in ("compensation", "prediction"))
ANY_NAME = {  # tables that take any name of a kind, and what stands under it
    "imports": ("<file>", ()),
    "scenario.deadzone": ("<actuator>", (agvjax.Deadzone(),)),
    "ensemble.draws": ("<leaf>", ()),
    "tune.tied": ("<gain>", ()),
    "tune.bounds": ("<gain>", ()),
    "tune.goals": ("<metric>", (Weights(),)),
    "tune.limits": ("<metric>", (Limit(),)),
    "tune.options": ("<name>", ()),
    **dict.fromkeys(("sweep.over", "certify.over"), ("<leaf>", ())),
    "sweep.fails": ("<metric>", (Bound(),)),
    "identify.columns": ("<quantity>", (Column(""),)),
    "identify.topics": ("<role>", ()),
    **dict.fromkeys(BELIEVED, ("<actuator>", (agvjax.Deadzone(),))),
}
DRAWS = {**RANGES, "one_of": OneOf, "distribution": Distribution}
PAGES = {  # where docs speak of keys that begin so; the longest that fits
    "": "docs/configuration.md",
    "controller": "docs/following.md, docs/vehicles.md",
    **dict.fromkeys(("controller.compensation", "controller.prediction"), "docs/deadzone.md"),
    "controller.anti_windup": "docs/vehicles.md",
    "scenario": "docs/vehicles.md",
    "scenario.path": "docs/following.md, docs/vehicles.md",
    **dict.fromkeys(("ensemble", "tune", "pareto"), "docs/tuning.md"),
    "speed": "docs/following.md",
    "margins": "docs/deadzone.md",
    "certify": "docs/certify.md",
    "sweep": "docs/robustness.md",
    "identify": "docs/robot.md, docs/logs.md",
    **dict.fromkeys(("apply", "watch"), "docs/staged.md"),
}
LEFT_OPEN = "set by law and vehicle"


class Described(NamedTuple):
    """A key of a configuration, in words.

    Attributes:
        key: with dots; `<leaf>`, `<metric>` and others stand for any name of that kind.
        kind: of value, as "a number".
        default: as TOML has it, or in words; where types differ in it, each with theirs.
        unit: empty where there is none.
        rule: empty where any value of its kind will do.
        text: what it means.
        page: where docs speak of it.
    """

    key: str
    kind: str
    default: str = ""
    unit: str = ""
    rule: str = ""
    text: str = ""
    page: str = ""


def every_key() -> list[str]:
    """The dotted name of every key, in the order of a configuration."""
    return list(_all())


def described(key: str) -> Described:
    """What a key is; any name may stand in the place of `<leaf>`, `<metric>` and others, with or without quotes.

    Raises:
        agvjax.InputError: there is no such key; names the nearest one.
    """
    bare = key.replace('"', "").replace("'", "").strip()
    everything = _all()
    if bare in everything:
        return everything[bare]
    for pattern in sorted((name for name in everything if "<" in name), key=len, reverse=True):
        if re.fullmatch(_expression(pattern), bare):
            return everything[pattern]
    near = difflib.get_close_matches(bare, everything, 1, 0.6) or [
        name for name in everything if name.rpartition(".")[2] == bare.rpartition(".")[2]
    ]
    rule = f"a known key; did you mean {near[0]}?" if near else f"a key, or a table: {', '.join(vars(Config()))}"
    raise agvjax.InputError([agvjax.Fault("key", repr(key), rule)])


def of_type(place: str, name: str) -> list[Described]:
    """The keys that a type has where it may stand, and all below them, with its own defaults, units and rules."""
    return [row for kind, row in _below(place, None) if kind == name]


def _expression(pattern: str) -> str:
    """What a key with placeholders matches: the name of a leaf or a gain has dots, other names have none."""
    escaped = re.sub(r"<(leaf|gain|file)>", "\0", pattern)
    escaped = re.sub(r"<\w+>", "\1", escaped)
    return re.escape(escaped).replace("\0", ".+?").replace("\1", r"[^.]+")


@functools.cache
def _all() -> dict[str, Described]:
    """Every key; those that several types have merged into one."""
    found: dict[str, list[tuple[str, Described]]] = {}
    for kind, row in _fields("", Config(), ""):
        found.setdefault(row.key, []).append((kind, row))
    return {key: _merged(rows)._replace(page=_page(key)) for key, rows in found.items()}


def _merged(rows: list[tuple[str, Described]]) -> Described:
    """One row of those of several types; where types differ, each word is said with them."""

    def words(name: str, apart: str) -> str:
        types: dict[str, list[str]] = {}
        for kind, row in rows:
            if text := getattr(row, name):
                types.setdefault(text, []).append(kind)
        if len(types) < 2:
            return next(iter(types), "")
        said = ((text, ", ".join(dict.fromkeys(filter(None, kinds)))) for text, kinds in types.items())
        return apart.join(f"{text} ({kinds})" if kinds else text for text, kinds in said)

    parts = {name: words(name, " or " if name == "kind" else "; ") for name in Described._fields[1:]}
    return Described(key=rows[0][1].key, **parts)


def _page(key: str) -> str:
    return PAGES[max((head for head in PAGES if f"{key}.".startswith(f"{head}." if head else "")), key=len)]


Rows = Iterator[tuple[str, Described]]  # of each the type whose it is


def _fields(key: str, holder: Any, kind: str) -> Rows:
    """The keys of a dataclass or named tuple, and all below them."""
    texts = meanings(type(holder))
    if isinstance(holder, tuple):
        defaults = {name: (x, {}) for name, x in holder._asdict().items()}  # pyright: ignore[reportAttributeAccessIssue]
    else:
        defaults = {f.name: (getattr(holder, f.name), f.metadata) for f in dataclasses.fields(holder)}
    for name, (default, metadata) in defaults.items():
        part = f"{key}.{name}" if key else name
        text, source = texts.get(name, ""), metadata.get("source", "")
        if text and source and source not in text:
            text = f"{text} ({source})"
        subject = type(default if dataclasses.is_dataclass(default) else holder)
        text = text or source or f"see {subject.__name__}: {_first_line(subject)}"
        row = Described(part, _kind(part, default, metadata), _spelled(part, default), text=text)
        unit, rule = metadata.get("unit", ""), metadata.get("rule")
        row = row._replace(unit="" if unit == "1" else unit, rule=rule.text if rule else "")
        yield kind, row
        yield from _below(part, default)


def _below(key: str, default: Any) -> Rows:
    """The keys below one: of every type that may stand there, of every name, or of the dataclass."""
    if key in CLASSES:
        names = ", ".join(CLASSES[key])
        yield "", Described(f"{key}.type", "a name", _spelled(key, default), "", f"one of {names}", "the type")
        for name, cls in CLASSES[key].items():
            if cls in RECIPES:
                keys = RECIPES[cls].keys.items()
                yield from ((name, Described(f"{key}.{part}", "a value", text=text)) for part, text in keys)
            elif cls is not None:
                yield from _fields(key, cls(), name)
    elif key == "scenario.actuators":
        place = f"{key}.<actuator>.<element>"
        rule = f"one of {', '.join(ELEMENTS)}"
        text = "which element it is, if its name is not that of a type"
        chain = "the elements that an actuator's signal passes through after its deadzone, in this order"
        yield "", Described(f"{key}.<actuator>", "a table", text=chain)
        yield "", Described(place, "a table", "{}", text="an element that the signal passes through after the deadzone")
        yield "", Described(f"{place}.type", "a name", "", "", rule, text)
        for name, cls in ELEMENTS.items():
            yield from _fields(place, cls(), name)
    elif key in ANY_NAME:
        yield from _any_name(key, *ANY_NAME[key])
    elif key == "ensemble.correlation":
        yield from _fields(key, Correlation((), ()), "")
    elif dataclasses.is_dataclass(default) and not isinstance(default, type):
        yield from _fields(key, default, "")
    if key == "controller":
        yield "", Described("controller.<gain>", "a table", "", text=_first_line(agvjax.Schedule))
        yield from _fields("controller.<gain>", agvjax.Schedule(), "")


def _any_name(key: str, name: str, holders: tuple[Any, ...]) -> Rows:
    place = f"{key}.{name}"
    kind, text = OF_NAME[key]
    yield "", Described(place, kind, text=text)
    for holder in holders:
        yield from _fields(place, holder, "")
    if name == "<leaf>":
        for word, cls in DRAWS.items():
            rule = "a name in scipy.stats, with its parameters beside it" if word == "distribution" else ""
            yield "", Described(f"{place}.{word}", "a value", "", "", rule, _first_line(cls))
    if key == "ensemble.draws":
        text = "with a distribution: whether it is that of a factor on the nominal value"
        yield "", Described(f"{place}.times", "true or false", text=text)
    if key == "sweep.over":  # the points of a box are all
        text = "number of points of a grid axis; without it the axis is sampled"
        yield "", Described(f"{place}.points", "a whole number", _spelled("", Span(OneOf(()), 0).points), text=text)


OF_NAME = {
    "imports": ("a string", "SHA-256 of a Python file with your own classes"),
    "scenario.deadzone": ('a table, or "none"', "the deadzone of an actuator of the plant"),
    "ensemble.draws": ('a table, or "default"', "how a leaf of the scenario is drawn, by its dotted name"),
    "tune.tied": ("a name", "the gain that this one follows"),
    "tune.bounds": ("[low, high]", "the range of a gain"),
    "tune.goals": ("a number or a table", "weights of a metric in the goal; a number weights its mean"),
    "tune.limits": ("a number or a table", "limits on a metric; a number limits its mean and worst, inf is no limit"),
    "tune.options": ("a value", "a further argument of the optimiser"),
    **dict.fromkeys(("sweep.over", "certify.over"), ("a table, or a list of values", "values of a leaf on the axis")),
    "sweep.fails": ("a number or a table", "bound of a metric above which a run has failed"),
    "identify.columns": ("a name or a table", "the column of a quantity of the log"),
    "identify.topics": ("the name of a topic", "the topic of a recording that serves as a role"),
    **dict.fromkeys(BELIEVED, ('a table, or "none"', "the assumed deadzone of an actuator")),
}


def _kind(key: str, default: Any, metadata: Any) -> str:
    """What stands at a key, in words."""
    if choices := metadata.get("choices"):
        return f"one of {', '.join(map(str, choices))}"
    if key in CLASSES:
        return "a name, or a table with its type"
    if key in CODECS and CODECS[key].rule not in ("", "a table"):
        return CODECS[key].rule
    if key in ANY_NAME or key in CODECS or dataclasses.is_dataclass(default):
        return "a table"
    if isinstance(default, bool):
        return "true or false"
    if isinstance(default, str):
        return "a string"
    if isinstance(default, tuple) and not default:
        return "a list of names"
    if isinstance(default, (tuple, list, np.ndarray)) or np.ndim(default):
        return "a list of numbers"
    whole = isinstance(default, int) and (metadata.get("static") or "whole" in str(metadata.get("rule", "")))
    several = [shape for shape in metadata.get("shapes", ()) if shape]
    return "a whole number" if whole else "a number, or a list of them" if several else "a number"


def _spelled(key: str, default: Any) -> str:
    """A default as TOML has it."""
    if default is None:
        return '"none"' if None in CLASSES.get(key, {}).values() else LEFT_OPEN
    if key in CLASSES:
        return "".join(f'"{name}"' for name, cls in CLASSES[key].items() if cls is type(default))
    if isinstance(default, bool):
        return str(default).lower()
    if isinstance(default, str):
        return f'"{default}"'
    if isinstance(default, (tuple, list, np.ndarray)):
        return f"[{', '.join(_spelled('', x) for x in default)}]"
    if dataclasses.is_dataclass(default):
        return ""
    if isinstance(default, dict):
        return ", ".join(default)
    return f"{float(default):.10g}" if np.ndim(default) == 0 else ""


def _first_line(cls: type) -> str:
    """The first line of a docstring."""
    return (inspect.getdoc(cls) or "").partition("\n")[0].rstrip(".")


@functools.cache
def meanings(cls: type) -> dict[str, str]:
    """What a class says of its attributes, and those that it derives from; of each the section "Attributes"."""
    texts: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        section = (inspect.cleandoc(base.__doc__ or "") + "\n").partition("\nAttributes:\n")[2]
        for name, text in re.findall(r"^    (\w+): (.*\n(?: {8}.*\n)*)", section, re.M):
            texts[name] = re.sub(r"\s+", " ", text).strip().rstrip(".")
    return texts
