"""CSV files with a header: waypoints and recorded disturbances; and the objects that tables of TOML make of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, NoReturn

import numpy as np

import agvjax

from ..io.csv_file import KINDS, UNITS, Column, names, read
from . import routes
from .spellings import Toml, column, numbers


class Recipe(NamedTuple):
    """How an object that its fields do not make is made from a table, and the table that makes it again.

    `make` raises `agvjax.InputError` with keys of the table. `keys` says of each what it means.
    """

    keys: Mapping[str, str]
    make: Callable[[Mapping[str, Toml]], agvjax.Path | agvjax.Disturbance]
    table: Callable[[Any], dict[str, Toml]]
    columns: tuple[str, ...] = ()  # of its file
    hint: str = ""  # what would be read from columns that are not there, and where it comes from without

    def unread(self, table: Mapping[str, Toml]) -> str:
        """The columns of its file that say nothing; empty where there are none."""
        if "file" not in table:
            return ""
        taken, there = [place.column for place in _places(table, self.columns).values()], names(table["file"])
        unread = [name for name in there if name not in (*taken, *table.get("columns", {}))]
        hint = f"; {self.hint}" if set(taken) - set(there) else ""
        return f"{table['file']}: {', '.join(unread)} not read{hint}" if unread else ""


def _waypoints(table: Mapping[str, Toml]) -> agvjax.Waypoints:
    """From `file` and its `columns`, or `points`; `closed`, and `speed` where the points bring none."""
    closed = table.get("closed", False)
    if not isinstance(closed, bool):
        _wrong("closed", closed, "true or false")
    rows, _ = _points(table, closed)
    source = "file" if "file" in table else "points"
    try:
        return agvjax.Waypoints.through(rows[:, :2], rows[:, 2] if rows.shape[1] == 3 else 1.0, closed)
    except ValueError as error:
        key = "speed" if "speed" in table and str(error).startswith("speed must") else source
        _wrong(key, table[key], f"what a path can be made of ({error})")


def _points(
    table: Mapping[str, Toml], closed: Toml, optional: Sequence[str] = ("speed",)
) -> tuple[np.ndarray, np.ndarray | None]:
    """Points, (N, 2) or with a speed each (N, 3), and half widths (N, 2) where the file has both."""
    source, widths = _source(table, "points"), None
    if source == "file":
        columns = _file(table, ("x", "y"), optional)
        points, speed = np.column_stack([columns["x"], columns["y"]]), columns.get("speed")
        if "left" in columns and "right" in columns:
            widths = np.column_stack([columns["left"], columns["right"]])
        if closed and len(points) > 3 and np.array_equal(points[0], points[-1]):  # as racing lines are written
            points, speed = points[:-1], None if speed is None else speed[:-1]
            widths = None if widths is None else widths[:-1]
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


def _route(table: Mapping[str, Toml]) -> agvjax.Route:
    """Along a shape, or of `file` and its `columns`, or `points`; and how to lay it, see `routes.laid`."""
    if "along" in table:
        for name in ("file", "points", "columns"):
            if name in table:
                _wrong(name, table[name], "absent where the route is along a shape")
        return routes.laid(table, None, None)
    if "file" not in table and "points" not in table:
        _wrong("file", "", "the name of a CSV file, where there are neither points nor a shape that the route is along")
    rows, widths = _points(table, table.get("closed"), ("speed", "left", "right"))
    return routes.laid(table, rows, widths)


def _recorded(table: Mapping[str, Toml]) -> agvjax.Recorded:
    """From `file` and its `columns`, or `times` and `values`; and `amplitude`, a factor."""
    if _source(table, "times") == "file":
        if "values" in table:
            _wrong("values", table["values"], "absent where there is a file")
        columns = _file(table, ("t",), CHANNELS)
        if len(columns) == 1:
            _wrong("file", table["file"], f"a file with at least one of the columns {', '.join(CHANNELS)}")
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


CHANNELS = ("x", "y", "heading")  # of a disturbance; a column that is not there is 0
FILE = {
    "file": "name of a CSV file with columns x and y [m], and perhaps speed [m/s]; of a route left and right [m] too",
    "columns": "where a quantity stands in the file, where the file has another name or unit for it",
    "points": "instead of a file: a list of [x, y] [m], or of [x, y, speed]",
    "speed": "speed [m/s], or one for each point; negative, on a route, backwards; 1 m/s where none is given",
}
RECIPES: dict[type, Recipe] = {
    agvjax.Waypoints: Recipe(
        {**FILE, "closed": routes.LAYING["closed"]},
        _waypoints,
        lambda path: {"points": np.asarray(path.points).tolist(), "closed": path.closed},
        ("x", "y", "speed"),
        "a column speed [m/s], or the one that scenario.path.columns names, would be; without one"
        " scenario.path.speed holds, 1 m/s where it is not set",
    ),
    agvjax.Route: Recipe(
        {**FILE, **routes.LAYING},
        _route,
        routes.table_of,
        ("x", "y", "speed", "left", "right"),
        "a column speed [m/s], negative where the route is driven backwards, and left and right, the half widths of a"
        " corridor [m], would be",
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
        ("t", *CHANNELS),
        "columns x, y, heading would be, without one it is 0",
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


def _file(table: Mapping[str, Toml], needed: Sequence[str], optional: Sequence[str]) -> dict[str, np.ndarray]:
    """Columns of the table's file, by our names and in SI units."""
    file = table["file"]
    if not isinstance(file, str):
        _wrong("file", file, "the name of a file")
    where = _places(table, (*needed, *optional))
    asked = [name for name in (*needed, *optional) if name in needed or name in table.get("columns", {})]
    for name in needed:
        if name not in where:
            _wrong(f"columns.{name}", "", "the name of a column: the file needs it")
    must, may = ([where[n].column for n in names if n in where] for names in (asked, optional))
    time = where.get("t", Column(""))
    try:
        found = read(file, must, may, time=time.column, nanoseconds=time.nanoseconds)
    except ValueError as error:
        also = f" and perhaps {', '.join(optional)}"
        rule = f"a CSV file with the columns {', '.join(needed)}{also}, or others named in columns = "
        rule += f'{{ {needed[0]} = "its name" }} ({error})'
        _wrong("file", file, rule)
    return {n: found[p.column] * UNITS.get(p.unit, 1.0) * p.factor for n, p in where.items() if p.column in found}


def _places(table: Mapping[str, Toml], known: Sequence[str]) -> dict[str, Column]:
    """Where each name stands in the table's file: by its own name, unless `columns` says another or that it is none."""
    given = table.get("columns", {})
    if not isinstance(given, Mapping):
        _wrong("columns", given, 'a table of columns by name, as in { x = "x_m" }')
    where = {}
    for name, value in given.items():
        if name not in known:
            _wrong(f"columns.{name}", value, f"one of {', '.join(known)}")
        try:
            where[name] = column(value, name)
        except ValueError as error:
            _wrong(f"columns.{name}", value, str(error))
        if where[name].nanoseconds and name != "t":
            _wrong(f"columns.{name}.nanoseconds", where[name].nanoseconds, "left out but for t")
        if where[name].quaternion:
            _wrong(f"columns.{name}.quaternion", list(where[name].quaternion), "left out: only logs are read by one")
        units = KINDS[name].split() if known[0] != "t" or name == "t" else []  # of a disturbance SI alone
        if where[name].unit and where[name].unit not in units:
            _wrong(f"columns.{name}.unit", where[name].unit, f"one of {', '.join(units)}" if units else "absent")
    taken = {place.column for place in where.values()}
    where = {name: where.get(name, Column("" if name in taken else name)) for name in known}
    return {name: place for name, place in where.items() if place.column}


def _array(table: Mapping[str, Toml], name: str, rule: str) -> np.ndarray:
    """Numbers of a table, at least one."""
    array = numbers(table.get(name))
    if array is None or not array.size:
        _wrong(name, table.get(name), rule)
    return array


def _wrong(key: str, value: Toml, rule: str) -> NoReturn:
    raise agvjax.InputError([agvjax.Fault(key, value, rule)])
