"""Names of earlier releases in tables of TOML: read for now, and said to be old."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from agvjax.metric_table import OLD_NAMES

from .spellings import Toml

BY_METRIC = ("tune.goals", "tune.limits", "sweep.fails")  # tables
OF_METRICS = ("sweep.metrics", "pareto.metric")  # a name, or a list of names


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
