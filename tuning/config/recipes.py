"""CSV files with a header: waypoints and recorded disturbances; and the objects that tables of TOML make of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, NoReturn

import numpy as np

import agvjax

from ..io import geo
from ..io.csv_file import KINDS, UNITS, Column, names, numbered, read
from ..io.track_names import guessed
from . import routes, tracks
from .spellings import Toml, column, numbers

Note = Callable[[str], None]


def unsaid(text: str) -> None:
    """A note that nobody is told."""


class Recipe(NamedTuple):
    """How an object that its fields do not make is made from a table, and the table that makes it again.

    `make` raises `agvjax.InputError` with keys of the table, and tells a note of what was read of a file, and what was
    not. `keys` says of each what it means.
    """

    keys: Mapping[str, str]
    make: Callable[[Mapping[str, Toml], Note], agvjax.Path | agvjax.Disturbance]
    table: Callable[[Any], dict[str, Toml]]


def _waypoints(table: Mapping[str, Toml], note: Note = unsaid) -> agvjax.Waypoints:
    """From `file` and its `columns`, or `points`; `closed`, and `speed` where the points bring none."""
    closed = table.get("closed", False)
    if not isinstance(closed, bool):
        _wrong("closed", closed, "true or false")
    rows, _ = _points(table, closed, note=note)
    source, origin = "file" if "file" in table else "points", tracks.origin(rows)
    try:
        speed = rows[:, 2] if rows.shape[1] == 3 else 1.0
        path = agvjax.Waypoints.through(rows[:, :2] - origin, speed, closed)
        points = np.asarray(path.points) + (*origin, 0.0)
        return dataclasses.replace(path, points=points, origin=origin)
    except ValueError as error:
        key = "speed" if "speed" in table and str(error).startswith("speed must") else source
        more = f"; {WIDER}" if source == "file" and "suddenly" in str(error) else ""
        _wrong(key, table[key], f"what a path can be made of ({error}{more})")


def _points(
    table: Mapping[str, Toml], closed: Toml, optional: Sequence[str] = ("speed",), note: Note = unsaid
) -> tuple[np.ndarray, np.ndarray | None]:
    """Points, (N, 2) or with a speed each (N, 3), and half widths (N, 2) where the file has both."""
    source, widths = _source(table, "points"), None
    if source == "file":
        points, speed, widths = _track(table, bool(closed), optional, note)
    else:
        rule = "a list of [x, y] in m, or of [x, y, speed]"
        rows = _array(table, "points", rule)
        if rows.ndim != 2 or rows.shape[1] not in (2, 3):
            _wrong("points", f"shape {rows.shape}", rule)
        points, speed = rows[:, :2], rows[:, 2] if rows.shape[1] == 3 else None
    if "speed" in table and speed is not None:
        _wrong("speed", table["speed"], f"absent where the {source} has speeds")
    if "speed" in table:
        speed = _array(table, "speed", "a number > 0 in m/s, or one for each point")
    if speed is None:
        return points, widths
    if speed.shape not in ((), (len(points),)):
        _wrong("speed", f"shape {speed.shape}", f"a number in m/s, or one for each of {len(points)} points")
    return np.column_stack([points, np.broadcast_to(speed, len(points))]), widths


def _track(
    table: Mapping[str, Toml], closed: bool, optional: Sequence[str], note: Note
) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
    """Points (N, 2), speeds and half widths of the table's file, where it has them."""
    file, spacing = table["file"], table.get("spacing")
    if spacing is not None and not (numbers(spacing) is not None and np.ndim(spacing) == 0 and 0 <= spacing < np.inf):
        _wrong("spacing", spacing, "a number >= 0 in m")
    if isinstance(file, str) and geo.is_geo(file):
        if "columns" in table:
            _wrong("columns", table["columns"], "absent where the file is no CSV file")
        try:
            columns, words = geo.read(file)
        except ValueError as error:
            _wrong("file", file, f"a track ({error})")
        note(words)
    else:
        columns = _file(table, ("x", "y"), optional, note)
    try:
        track = tracks.waypoints(columns, closed, "speed" in table, spacing)
    except ValueError as error:
        _wrong("file", file, f"what a path can be made of ({error})")
    for text in track.said:
        note(f"{file}: {text}")
    return track.points, track.speed, track.widths


def _route(table: Mapping[str, Toml], note: Note = unsaid) -> agvjax.Route:
    """Along a shape, or of `file` and its `columns`, or `points`; and how to lay it, see `routes.laid`."""
    if "along" in table:
        for name in ("file", "points", "columns"):
            if name in table:
                _wrong(name, table[name], "absent where the route is along a shape")
        return routes.laid(table, None, None)
    if "file" not in table and "points" not in table:
        _wrong("file", "", "the name of a CSV file, where there are neither points nor a shape that the route is along")
    cornered = set(table) & {"radius", "tolerance", "half_width"}  # the file's widths are of a spline alone
    rows, widths = _points(table, table.get("closed"), ("speed",) if cornered else ("speed", "left", "right"), note)
    return routes.laid(table, rows, widths)


def _recorded(table: Mapping[str, Toml], note: Note = unsaid) -> agvjax.Recorded:
    """From `file` and its `columns`, or `times` and `values`; and `amplitude`, a factor."""
    if _source(table, "times") == "file":
        if "values" in table:
            _wrong("values", table["values"], "absent where there is a file")
        said: list[str] = []
        columns = _file(table, ("t",), CHANNELS, said.append)
        if len(columns) == 1:
            _wrong("file", table["file"], f"a file with at least one of the columns {', '.join(CHANNELS)}")
        for text in said:
            note(text)
        times = columns["t"]
        values = np.column_stack([columns.get(name, np.zeros_like(times)) for name in CHANNELS])
    else:
        times = _array(table, "times", "a list of numbers in s")
        values = _array(table, "values", "a list of [x, y, heading], one for each time")
        if times.ndim != 1 or times.size < 2 or not np.all(np.isfinite(times)) or np.any(np.diff(times) <= 0):
            _wrong("times", table["times"], "at least two numbers in s, each above the one before")
        if values.shape != (times.size, 3) or not np.all(np.isfinite(values)):
            rule = f"a list of {times.size} finite [x, y, heading], one for each time"
            _wrong("values", table["values"], rule)
    factor: Any = _array({"amplitude": 1.0, **table}, "amplitude", "a number or one for each of three channels")
    return agvjax.Recorded(times=times, values=values, amplitude=factor if factor.ndim else float(factor))


DEGREES = 0.1  # m, within which no path lies: numbers without a name that do are degrees
WIDER = "scenario.path.spacing takes points farther apart, and a route with tolerance rounds corners"
CHANNELS = ("x", "y", "heading")  # of a disturbance; a column that is not there is 0
FILE = {
    "file": "name of a CSV file with columns x and y [m], or lat and lon [deg], and perhaps speed [m/s] or, of a"
    " recorded drive, t [s]; of a route left and right [m] too; or of a GPX or GeoJSON file",
    "spacing": "points of the file that are nearer to the one before are left out [m]; without it those of a recorded"
    " drive that a path cannot be laid through: standing still and jitter",
    "columns": "where a quantity stands in the file, where the file has another name or unit for it",
    "points": "instead of a file: a list of [x, y] [m], or of [x, y, speed]",
    "speed": "speed [m/s], or one for each point; negative, on a route, backwards; 1 m/s where none is given",
}
RECIPES: dict[type, Recipe] = {
    agvjax.Waypoints: Recipe(
        {**FILE, "closed": routes.LAYING["closed"]},
        _waypoints,
        lambda path: {"points": np.asarray(path.points).tolist(), "closed": path.closed},
    ),
    agvjax.Route: Recipe(
        {**FILE, **routes.LAYING},
        _route,
        routes.table_of,
    ),
    agvjax.Recorded: Recipe(
        {
            "file": "name of a CSV file with a column t and at least one of x, y [m/s^2] and heading [rad/s]",
            "columns": "where a quantity stands in the file, where the file has another name or unit for it",
            "times": "instead of a file: increasing times [s]",
            "values": "instead of a file: [x, y, heading] at each time [m/s^2, m/s^2, rad/s]",
            "amplitude": "a factor, or one for each channel",
        },
        _recorded,
        lambda push: {name: np.asarray(value).tolist() for name, value in vars(push).items()},
    ),
}


def _source(table: Mapping[str, Toml], inline: str) -> str:
    """Which of the two ways the numbers are given."""
    if "file" in table and inline in table:
        _wrong(inline, table[inline], "absent where there is a file")
    if "file" not in table and inline not in table:
        _wrong("file", "", f"the name of a CSV file, where there are no {inline}")
    if "file" not in table and "columns" in table:
        _wrong("columns", table["columns"], "absent where there is no file")
    return "file" if "file" in table else inline


def _file(
    table: Mapping[str, Toml], needed: Sequence[str], optional: Sequence[str], note: Note
) -> dict[str, np.ndarray]:
    """Columns of the table's file, by our names and in SI units; `note` is told of what it has besides."""
    file = table["file"]
    if not isinstance(file, str):
        _wrong("file", file, "the name of a file")
    track, also, given = needed[0] == "x", tuple(optional), table.get("columns", {})
    if not isinstance(given, Mapping):
        _wrong("columns", given, 'a table of columns by name, as in { x = "x_m" }')
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
                _wrong(f"columns.{name}", "", "the name of a column: the file needs it")
        must, may = ([where[n].column for n in names if n in where] for names in (asked, also))
        time = where.get("t", Column(""))
        found = read(file, must, may, time=time.column, nanoseconds=time.nanoseconds)
        si = {n: found[p.column] * UNITS.get(p.unit, 1.0) * p.factor for n, p in where.items() if p.column in found}
        if needed[0] == "lat":
            si["x"], si["y"], words = geo.plane(file, *(np.degrees(si.pop(name)) for name in needed))
            note(f"{file}: {words}")
    except ValueError as error:
        if isinstance(error, agvjax.InputError):
            raise
        rule = f"a CSV file with the columns {', '.join(needed)} and perhaps {', '.join(optional)}, or others named in"
        _wrong("file", file, f'{rule} columns = {{ {needed[0]} = "its name" }} ({error})')
    if header == numbered(2) and max(np.ptp(si["x"]), np.ptp(si["y"])) < DEGREES:
        rule = f'in metres: its points lie within {DEGREES:g} m; degrees are columns = {{ lat = "1", lon = "2" }}'
        _wrong("file", file, f"{rule}, or the other way round")
    _say(table, header, {name: place for name, place in where.items() if place.column in found}, track, note)
    return si


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
            _wrong(f"columns.{name}", value, f"one of {', '.join(known)}")
        try:
            where[name] = column(value, name)
        except ValueError as error:
            _wrong(f"columns.{name}", value, str(error))
        if where[name].nanoseconds and name != "t":
            _wrong(f"columns.{name}.nanoseconds", where[name].nanoseconds, "left out but for t")
        units = KINDS[name].split() if track or name == "t" else []  # of a disturbance SI alone
        if where[name].unit and where[name].unit not in units:
            _wrong(f"columns.{name}.unit", where[name].unit, f"one of {', '.join(units)}" if units else "absent")
    taken = {place.column for place in where.values()}
    usual = {name: guesses.get(name, Column(name)) for name in known}
    where = {name: where.get(name, Column("") if usual[name].column in taken else usual[name]) for name in known}
    degrees = {
        name: place._replace(unit=place.unit or "deg") for name, place in where.items() if name in ("lat", "lon")
    }
    return {name: place for name, place in (where | degrees).items() if place.column}


def _array(table: Mapping[str, Toml], name: str, rule: str) -> np.ndarray:
    """Numbers of a table, at least one."""
    array = numbers(table.get(name))
    if array is None or not array.size:
        _wrong(name, table.get(name), rule)
    return array


def _wrong(key: str, value: Toml, rule: str) -> NoReturn:
    raise agvjax.InputError([agvjax.Fault(key, value, rule)])
