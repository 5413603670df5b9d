"""CSV files with a header: waypoints and recorded disturbances; and the objects that tables of TOML make of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

import agvjax

from ..io import geo, logs
from ..io.csv_file import names
from ..io.track_names import guessed
from . import routes, tracks
from .columns import Note, array, columns_of, unsaid, wrong
from .spellings import Toml, numbers


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
        wrong("closed", closed, "true or false")
    rows, _ = _points(table, closed, note=note)
    source, origin = "file" if "file" in table else "points", tracks.origin(rows)
    try:
        speed = rows[:, 2] if rows.shape[1] == 3 else 1.0
        path = agvjax.Waypoints.through(rows[:, :2] - origin, speed, closed)
        return dataclasses.replace(path, points=np.asarray(path.points) + (*origin, 0.0), origin=origin)
    except ValueError as error:
        key = "speed" if "speed" in table and str(error).startswith("speed must") else source
        more = f"; {WIDER}" if source == "file" and "suddenly" in str(error) else ""
        wrong(key, table[key], f"what a path can be made of ({error}{more})")


def _points(
    table: Mapping[str, Toml],
    closed: Toml,
    optional: Sequence[str] = ("speed",),
    note: Note = unsaid,
    stops: bool = False,
) -> tuple[np.ndarray, np.ndarray | None]:
    """Points, (N, 2) or with a speed each (N, 3), and half widths (N, 2) where the file has both."""
    source, widths = _source(table, "points"), None
    if source == "file":
        points, speed, widths = track_of(table, bool(closed), optional, note, stops)
    else:
        rule = "a list of [x, y] in m, or of [x, y, speed]"
        rows = array(table, "points", rule)
        if rows.ndim != 2 or rows.shape[1] not in (2, 3):
            wrong("points", f"shape {rows.shape}", rule)
        points, speed = rows[:, :2], rows[:, 2] if rows.shape[1] == 3 else None
    if "speed" in table and speed is not None:
        wrong("speed", table["speed"], f"absent where the {source} has speeds")
    if "speed" in table:
        speed = array(table, "speed", "a number > 0 in m/s, or one for each point")
    if speed is None:
        return points, widths
    if speed.shape not in ((), (len(points),)):
        wrong("speed", f"shape {speed.shape}", f"a number in m/s, or one for each of {len(points)} points")
    return np.column_stack([points, np.broadcast_to(speed, len(points))]), widths


def track_of(
    table: Mapping[str, Toml], closed: bool, optional: Sequence[str], note: Note, stops: bool = False
) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
    """Points (N, 2), speeds and half widths of the table's file, where it has them."""
    file, spacing = table["file"], table.get("spacing")
    if spacing is not None and not (numbers(spacing) is not None and np.ndim(spacing) == 0 and 0 <= spacing < np.inf):
        wrong("spacing", spacing, "a number >= 0 in m")
    bag, topic = isinstance(file, str) and logs.is_recording(file), table.get("topic", "")
    if "topic" in table and not (bag and isinstance(topic, str)):
        wrong("topic", topic, "a topic of a recording" if bag else "absent where the file is no recording")
    if isinstance(file, str) and (bag or geo.is_geo(file)):
        if "columns" in table:
            wrong("columns", table["columns"], "absent where the file is no CSV file")
        from ..io.logs import plans  # few tracks are recordings, and every command reads this file

        try:
            columns, words = plans.track(file, topic) if bag else geo.read(file)
        except ValueError as error:
            wrong("file", file, f"a track ({error})")
        note(f"{file}: {words}" if bag else words)
        if not {"t", "speed"} & {*columns, *table}:
            note(f"{file}: it has no speeds: 1 m/s (scenario.path.speed)")
    else:
        columns = columns_of(table, ("x", "y"), optional, note)
    try:
        track = tracks.waypoints(columns, closed, "speed" in table, spacing, stops)
    except ValueError as error:
        wrong("file", file, f"what a path can be made of ({error})")
    for text in track.said:
        note(f"{file}: {text}")
    return track.points, track.speed, track.widths


def _route(table: Mapping[str, Toml], note: Note = unsaid) -> agvjax.Route:
    """Along a shape, or of `file` and its `columns`, or `points`; and how to lay it, see `routes.laid`."""
    if "along" in table:
        for name in ("file", "points", "columns", "topic", "spacing"):
            if name in table:
                wrong(name, table[name], "absent where the route is along a shape")
        return routes.laid(table, None, None)
    if "file" not in table and "points" not in table:
        wrong("file", "", "the name of a CSV file, where there are neither points nor a shape that the route is along")
    cornered = set(table) & {"radius", "tolerance", "half_width"}  # the file's widths are of a spline alone
    optional = ("speed",) if cornered else ("speed", "left", "right")
    rows, widths = _points(table, table.get("closed"), optional, note, stops=True)
    if {"file", "half_width"} <= set(table) and _has_widths(table["file"]):
        note(f"{table['file']}: its widths do not count beside scenario.path.half_width = {table['half_width']}")
    return routes.laid(table, rows, widths)


def _has_widths(file: str) -> bool:
    """Whether a file that could be read has the widths of a corridor."""
    if geo.is_geo(file) or logs.is_recording(file):
        return False
    header = names(file)
    return {"left", "right"} <= {*header, *guessed(header)}


def _recorded(table: Mapping[str, Toml], note: Note = unsaid) -> agvjax.Recorded:
    """From `file` and its `columns`, or `times` and `values`; and `amplitude`, a factor."""
    if _source(table, "times") == "file":
        if "values" in table:
            wrong("values", table["values"], "absent where there is a file")
        said: list[str] = []
        columns = columns_of(table, ("t",), CHANNELS, said.append)
        if len(columns) == 1:
            wrong("file", table["file"], f"a file with at least one of the columns {', '.join(CHANNELS)}")
        for text in said:
            note(text)
        times = columns["t"]
        values = np.column_stack([columns.get(name, np.zeros_like(times)) for name in CHANNELS])
    else:
        times = array(table, "times", "a list of numbers in s")
        values = array(table, "values", "a list of [x, y, heading], one for each time")
        if times.ndim != 1 or times.size < 2 or not np.all(np.isfinite(times)) or np.any(np.diff(times) <= 0):
            wrong("times", table["times"], "at least two numbers in s, each above the one before")
        if values.shape != (times.size, 3) or not np.all(np.isfinite(values)):
            rule = f"a list of {times.size} finite [x, y, heading], one for each time"
            wrong("values", table["values"], rule)
    factor: Any = array({"amplitude": 1.0, **table}, "amplitude", "a number or one for each of three channels")
    return agvjax.Recorded(times=times, values=values, amplitude=factor if factor.ndim else float(factor))


WIDER = "scenario.path.spacing takes points farther apart, and a route with tolerance rounds corners"
CHANNELS = ("x", "y", "heading")  # of a disturbance; a column that is not there is 0
FILE = {
    "file": "name of a CSV file with columns x and y [m], or lat and lon [deg], and perhaps speed [m/s] or, of a"
    " recorded drive, t [s]; of a route left and right [m] too; or of a GPX or GeoJSON file; or of a"
    " recording, for a path that was planned or a drive",
    "topic": "of a recording, the topic of the plan (Path) or of the pose, where there are several",
    "spacing": "points of the file that are nearer to the one before are left out [m]; without it those of a recorded"
    " drive that a path cannot be laid through: standing still and jitter",
    "columns": "where a quantity stands in the file, where the file has another name or unit for it",
    "points": "instead of a file: a list of [x, y] [m], or of [x, y, speed]",
    "speed": "speed [m/s], or one for each point; negative, on a route, backwards, and 0 on the way a stop; 1 m/s where"
    " none is given",
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
        wrong(inline, table[inline], "absent where there is a file")
    if "file" not in table and inline not in table:
        wrong("file", "", f"the name of a CSV file, where there are no {inline}")
    for name in ("columns", "topic", "spacing"):
        if "file" not in table and name in table:
            wrong(name, table[name], "absent where there is no file")
    return "file" if "file" in table else inline
