"""Tables of TOML of earlier releases: names that are read for now and said to be old, and what has gone."""

from __future__ import annotations

import dataclasses
import functools
import warnings
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from agvjax.metric_table import OLD_NAMES

from ..io.plain import toml
from .spellings import Toml, flat

T = TypeVar("T", bound=type)
METRIC_KEYS = {"tune": ("goals", "limits"), "sweep": ("fails", "metrics"), "pareto": ("metric",)}  # hold metric names
RETIRED = {  # keys of earlier releases, which hold nothing in their files
    "tune.choices": "absent: tune one of each in a folder of its own, by a loop of the shell",
    "sweep.export": "absent: in Python, tuning.load(folder).to_xarray() is the table, to be written in any form",
}

# keys that earlier releases did not have: a run of theirs goes on without what they ask for
LATER = {"tune.screen", *(f"speed.{name}" for name in ("within", "after", "low", "high", "points", "halvings"))}
LATER |= {
    "margins.instants",
    "margins.vehicles",
    "identify.ahead",
    "identify.topics",
    "identify.stamps",
    "sweep.rollouts",
}
LATER |= {f"apply.{name}" for name in ("vehicles", "starts", "share", "confidence", "margin", "slack", "samples")}
LATER |= {f"watch.{name}" for name in ("false_alarms", "logs", "allowed", "seen")}
LATER |= {f"certify.{name}" for name in ("within", "within_heading", "over", "step", "boxes", "halvings")}

FIXED = {  # what earlier releases judged by, and what their computers did not have
    "criteria.band": 0.05,
    "criteria.late": 4.0,
    "criteria.margin": 1.0,
    "controller.compensation": "none",
    "controller.prediction": "none",
}


def warned(text: str) -> None:
    """What is old, to whoever wrote it in Python."""
    warnings.warn(text, DeprecationWarning, stacklevel=3)


def present(table: Mapping[str, Toml], note: Callable[[str], None]) -> dict[str, Toml]:
    """The table with the present names of metrics; each old one is told to `note`."""
    table = dict(table)
    for section, keys in METRIC_KEYS.items():
        if isinstance(table.get(section), Mapping):
            parts = table[section].items()
            table[section] = {k: _renamed(x, f"{section}.{k}", note) if k in keys else x for k, x in parts}
    return table


def _renamed(value: Toml, key: str, note: Callable[[str], None]) -> Toml:
    """A name of a metric, a list of them, or a table by their names, in present names."""
    if isinstance(value, Mapping):
        return {_new_name(name, f"{key}.{name}", note): part for name, part in value.items()}
    if isinstance(value, list):
        return [_renamed(name, key, note) for name in value]
    return _new_name(value, f"{key} = {value}", note) if isinstance(value, str) else value


def _new_name(name: str, place: str, note: Callable[[str], None]) -> str:
    new = OLD_NAMES.get(name, name)
    if new != name:
        note(f"{place}: the old name of {new}")
    return new


def gathered_keywords(**homes: type) -> Callable[[T], T]:
    """A dataclass whose earlier keywords go on working: each fills a field of the `homes`, attribute -> its class."""

    def decorate(cls: T) -> T:
        present_init, defaults = vars(cls)["__init__"], vars(cls)
        present = {f.name for f in dataclasses.fields(cls)}

        @functools.wraps(present_init)
        def init(self: object, *values: object, **keywords: Any) -> None:
            for home, kind in homes.items():
                earlier = {f.name for f in dataclasses.fields(kind)} & keywords.keys() - present
                if earlier:
                    warned(f"{', '.join(sorted(earlier))}: now in {home}={kind.__name__}(...)")
                    moved = {name: keywords.pop(name) for name in earlier}
                    keywords[home] = dataclasses.replace(keywords.get(home, defaults[home]), **moved)
            present_init(self, *values, **keywords)

        setattr(cls, "__init__", init)  # noqa: B010  # pyright takes no other name for a method
        return cls

    return decorate


def difference(old: str, new: str) -> str:
    """What differs between two configurations in TOML, of this release or of earlier ones, in words; empty: nothing.

    Raises:
        ValueError: one of them is no TOML.
    """
    before, now = (dict(flat(present(toml(text), lambda name: None), ())) for text in (old, new))
    before = {key: value for key, value in FIXED.items() if key in now} | before
    gone = {key for key, value in before.items() if key in RETIRED and not value} | (LATER - set(before))
    keys = [key for key in dict.fromkeys((*before, *now)) if before.get(key) != now.get(key) and key not in gone]
    lines = [("was", before, key) for key in keys] + [("is", now, key) for key in keys]
    return "; ".join(f"{verb} `{key} = {table[key]}`" for verb, table, key in lines if key in table)


def counts_first_command(text: str) -> bool:
    """Whether a configuration is of a release that counted a computer's first command, from nothing, as variation."""
    names = dict(flat(toml(text), ()))
    newer = any(name.split(".")[:2] == ["controller", "compensation"] for name in names)
    return names.get("controller.type") == "sampled" and not newer
