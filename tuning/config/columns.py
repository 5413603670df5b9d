"""Columns of files that tables of TOML name: by our names, by those that others give them, or as they are told."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NoReturn

import numpy as np

import agvjax

from ..io import geo
from ..io.csv_file import KINDS, UNITS, Column, names, read
from ..io.csv_text import numbered
from ..io.track_names import guessed
from .spellings import Toml, column, numbers

DEGREES = 0.1  # m, within which no path lies: numbers without a name that do are degrees
Note = Callable[[str], None]


def unsaid(text: str) -> None:
    """A note that nobody is told."""


def columns_of(
    table: Mapping[str, Toml], needed: Sequence[str], optional: Sequence[str], note: Note
) -> dict[str, np.ndarray]:
    """Columns of the table's file, by our names and in SI units; `note` is told of what it has besides."""
    file = table["file"]
    if not isinstance(file, str):
        wrong("file", file, "the name of a file")
    track, also, given = needed[0] == "x", tuple(optional), table.get("columns", {})
    if not isinstance(given, Mapping):
        wrong("columns", given, 'a table of columns by name, as in { x = "x_m" }')
    try:
        header = names(file, needed)
        ours = _guessed(table, header, optional) if track else {}
        if track and {"lat", "lon"} <= {*ours, *given} and not {"x", "y"} & {*ours, *given}:
            needed = ("lat", "lon")
        also += ("t",) if track else ()
        where = _places(table, (*needed, *also), ours, track)
        asked = [name for name in (*needed, *also) if name in needed or name in given]
        for name in needed:
            if name not in where:
                wrong(f"columns.{name}", "", "the name of a column: the file needs it")
        found, where = _read(file, where, asked, also if "t" not in given else (), note)
        si = {n: found[p.column] * UNITS.get(p.unit, 1.0) * p.factor for n, p in where.items() if p.column in found}
        if needed[0] == "lat":
            si["x"], si["y"], words = geo.plane(file, *(np.degrees(si.pop(name)) for name in needed))
            note(f"{file}: {words}")
    except ValueError as error:
        if isinstance(error, agvjax.InputError):
            raise
        rule = f"a CSV file with the columns {', '.join(needed)} and perhaps {', '.join(optional)}, or others named in"
        wrong("file", file, f'{rule} columns = {{ {needed[0]} = "its name" }} ({error})')
    if header == numbered(2) and max(np.ptp(si["x"]), np.ptp(si["y"])) < DEGREES:
        rule = f'in metres: its points lie within {DEGREES:g} m; degrees are columns = {{ lat = "1", lon = "2" }}'
        wrong("file", file, f"{rule}, or the other way round")
    _say(table, header, {name: place for name, place in where.items() if place.column in found}, track, note)
    return si


def _read(
    file: str, where: dict[str, Column], asked: Sequence[str], doubtful: Sequence[str], note: Note
) -> tuple[dict[str, np.ndarray], dict[str, Column]]:
    """The columns of a file that are there, and where; times that are `doubtful` only if they are times."""
    time = where.get("t", Column(""))
    must, may = ([where[name].column for name in some if name in where] for some in (asked, where))
    try:
        return read(file, must, may, time=time.column, nanoseconds=time.nanoseconds), where
    except ValueError as error:
        if not time.column or "t" not in doubtful:
            raise
        rest = {name: place for name, place in where.items() if name != "t"}
        found = read(file, [name for name in must if name != time.column], [p.column for p in rest.values()], time="")
        note(f"its times are not read: {error}")
        return found, rest


def _guessed(table: Mapping[str, Toml], header: Sequence[str], optional: Sequence[str]) -> dict[str, Column]:
    """By our name the columns that a header calls otherwise; of speed none where the table says it."""
    if header == numbered(2):
        return {"x": Column("1"), "y": Column("2")}
    said = ("speed",) if "speed" in table and "speed" not in header else ()
    return {n: p for n, p in guessed(header).items() if n in ("x", "y", "lat", "lon", "t", *optional) and n not in said}


def _say(
    table: Mapping[str, Toml], header: Sequence[str], where: Mapping[str, Column], track: bool, note: Note
) -> None:
    """Tell what was read of columns that are called otherwise, what was not, and what a path goes without."""
    given = table.get("columns", {})
    renamed = [(n, p) for n, p in where.items() if p.column != n and n not in given]
    said = [f"{n} is {p.column}{f' [{p.unit}]' if p.unit else ''}" for n, p in renamed]
    taken = {part for p in where.values() for part in (p.column, p.nanoseconds)}
    unread = [name for name in header if name and name not in taken and name not in given]
    said += [f"{', '.join(unread)} not read"] if unread else []
    if track and not {"speed", "t"} & set(where) and "speed" not in table:
        said.append("no column speed: 1 m/s (scenario.path.speed, or scenario.path.columns.speed)")
    if said:
        note(f"{table['file']}: {'; '.join(said)}")


def _places(
    table: Mapping[str, Toml], known: Sequence[str], guesses: Mapping[str, Column], track: bool
) -> dict[str, Column]:
    """Where each name stands in the table's file: as guessed or by its own name, unless `columns` says otherwise."""
    where = {}
    for name, value in table.get("columns", {}).items():
        if name not in known:
            wrong(f"columns.{name}", value, f"one of {', '.join(known)}")
        try:
            where[name] = column(value, name)
        except ValueError as error:
            wrong(f"columns.{name}", value, str(error))
        if where[name].nanoseconds and name != "t":
            wrong(f"columns.{name}.nanoseconds", where[name].nanoseconds, "left out but for t")
        if where[name].quaternion:
            wrong(f"columns.{name}.quaternion", list(where[name].quaternion), "left out: only logs are read by one")
        units = KINDS[name].split() if track or name == "t" else []  # of a disturbance SI alone
        if where[name].unit and where[name].unit not in units:
            wrong(f"columns.{name}.unit", where[name].unit, f"one of {', '.join(units)}" if units else "absent")
    taken = {place.column for place in where.values()}
    usual = {name: guesses.get(name, Column(name)) for name in known}
    where = {name: where.get(name, Column("") if usual[name].column in taken else usual[name]) for name in known}
    degrees = {
        name: place._replace(unit=place.unit or "deg") for name, place in where.items() if name in ("lat", "lon")
    }
    return {name: place for name, place in (where | degrees).items() if place.column}


def array(table: Mapping[str, Toml], name: str, rule: str) -> np.ndarray:
    """Numbers of a table, at least one."""
    array = numbers(table.get(name))
    if array is None or not array.size:
        wrong(name, table.get(name), rule)
    return array


def wrong(key: str, value: Toml, rule: str) -> NoReturn:
    """Refuse the value of a key of a table."""
    raise agvjax.InputError([agvjax.Fault(key, value, rule)])
