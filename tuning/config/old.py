"""Tables of TOML of earlier releases: names that are read for now and said to be old, and what has gone."""

from __future__ import annotations

import tomllib
import warnings
from collections.abc import Callable, Mapping

from agvjax.metric_table import OLD_NAMES

from .spellings import Toml, flat

BY_METRIC = ("tune.goals", "tune.limits", "sweep.fails")  # tables
OF_METRICS = ("sweep.metrics", "pareto.metric")  # a name, or a list of names
RETIRED = {  # keys of earlier releases, which hold nothing in their files
    "tune.choices": "absent: tune one of each in a folder of its own, by a loop of the shell",
    "sweep.export": "absent: in Python, tuning.load(folder).to_xarray() is the table, to be written in any form",
}


def warned(text: str) -> None:
    """What is old, to whoever wrote it in Python."""
    warnings.warn(text, DeprecationWarning, stacklevel=3)


def present(table: Mapping[str, Toml], note: Callable[[str], None], key: str = "") -> dict[str, Toml]:
    """The table with the present names of metrics; each old one is told to `note`."""

    def renamed(name: str, where: str) -> str:
        new = OLD_NAMES.get(name, name)
        if new != name:
            note(f"{where}: the old name of {new}")
        return new

    read: dict[str, Toml] = {}
    for name, value in table.items():
        part = f"{key}.{name}" if key else name
        if key in BY_METRIC:
            read[renamed(name, part)] = value
        elif part in OF_METRICS and isinstance(value, str):
            read[name] = renamed(value, f"{part} = {value}")
        elif part in OF_METRICS and isinstance(value, list):
            read[name] = [renamed(x, f"{part} = {x}") if isinstance(x, str) else x for x in value]
        elif isinstance(value, Mapping) and part in ("tune", "sweep", "pareto", *BY_METRIC):
            read[name] = present(value, note, part)
        else:
            read[name] = value
    return read


def difference(old: str, new: str) -> str:
    """What differs between two configurations in TOML, of this release or of earlier ones, in words; empty: nothing."""
    before, now = (dict(flat(present(tomllib.loads(text), lambda name: None), ())) for text in (old, new))
    gone = {key for key, value in before.items() if key in RETIRED and not value}
    keys = [key for key in dict.fromkeys((*before, *now)) if before.get(key) != now.get(key) and key not in gone]
    lines = [("was", before, key) for key in keys] + [("is", now, key) for key in keys]
    return "; ".join(f"{verb} `{key} = {table[key]}`" for verb, table, key in lines if key in table)
