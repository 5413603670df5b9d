"""Tables of TOML into routes, and back."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

import agvjax

from . import tracks
from .names import CLASSES
from .spellings import Toml, numbers

MADE = (agvjax.Waypoints, agvjax.Route)  # paths that are no shapes
SHAPES = {name: cls for name, cls in CLASSES["scenario.path"].items() if cls is not None and cls not in MADE}
LAYING = {  # what a route can be told, and what it means
    "along": "instead of a file or points: the route of a shape, by its name or as a table with its type",
    "closed": "whether the path goes on from its last point to its first",
    "dwell": "how long the law commands rest [s] where the speed is 0 on the way, 0 without it; or one for each point,"
    " above 0 at stops",
    "radius": "of every corner [m]: straight lines with rounded corners instead of a spline",
    "tolerance": "how far from a corner its arc may pass [m]: straight lines with rounded corners instead of a spline",
    "until": "where a route along a shape ends by the shape's clock [s]; without it at its lap or end",
    "faster": "times the speed; its square times the lateral acceleration of the limits",
    "limits": "what the speed is reduced to: speed, acceleration, deceleration, lateral_acceleration, jerk, stop",
    "half_width": "of a corridor on either side [m], one number or left and right; 0: no corridor",
}
FLAGS = ("closed",)
LISTS = {  # that may be more than a number
    "half_width": "a number in m, left and right, or a pair for each point",
    "dwell": "a number in s, or one for each point",
}


def laid(table: Mapping[str, Toml], rows: np.ndarray | None, widths: np.ndarray | None) -> agvjax.Route:
    """A route of a table: along a shape, or of rows (N, 2) or (N, 3) of points and speeds; with half widths (N, 2).

    Raises:
        agvjax.InputError: with keys of the table.
    """
    given = {name: _value(table, name) for name in LAYING if name in table and name != "along"}
    quicker = given.get("faster", 1.0)
    limits = _limits(table.get("limits", {})).faster(quicker)
    half_width = given.get("half_width", 0.0) if widths is None else widths
    common = {"limits": limits, "half_width": half_width}
    key = "along" if rows is None else "file" if "file" in table else "points"
    origin = (0.0, 0.0) if rows is None else tracks.origin(rows)
    try:
        if rows is None:
            _absent(table, ("closed", "dwell", "radius", "tolerance", "speed"), "where the route is along a shape")
            route = agvjax.Route.along(_shape(table["along"]), until=given.get("until"), faster=quicker, **common)
        else:
            _absent(table, ("until",), "but where the route is along a shape")
            points, speed = rows[:, :2] - origin, quicker * (rows[:, 2] if rows.shape[1] == 3 else 1.0)
            closed, dwell = given.get("closed", False), given.get("dwell", 0.0)
            corner = {name: given[name] for name in ("radius", "tolerance") if name in given}
            lay: Any = agvjax.Route.corners if corner else agvjax.Route.through
            route = lay(points, speed, dwell=dwell, closed=closed, **corner, **common)
    except ValueError as error:
        if isinstance(error, agvjax.InputError):
            raise
        named = str(error).split(maxsplit=1)[0]
        bad = named if named in table else key
        raise agvjax.InputError([agvjax.Fault(bad, table[bad], f"what a route can be made of ({error})")]) from error
    made = {name: table[name] for name in LAYING if name in table}
    if rows is not None:
        made |= _plainly(rows, np.asarray(half_width))
    return dataclasses.replace(route, made=json.dumps(made), origin=origin)


def _plainly(rows: np.ndarray, half_width: np.ndarray) -> dict[str, Toml]:
    """Points, speeds and half widths; what is the same at all points as one number, for a person to change."""
    one = rows.shape[1] == 3 and len({*rows[:, 2].tolist()}) == 1
    same = half_width.ndim == 2 and bool(np.all(half_width == half_width[0]))
    table: dict[str, Toml] = {"points": rows[:, :2].tolist() if one else rows.tolist()}
    table |= {"speed": float(rows[0, 2])} if one else {}
    return table | {"half_width": (half_width[0] if same else half_width).tolist()}


def table_of(route: agvjax.Route) -> dict[str, Toml]:
    """The table that `laid` makes the route of again; a route that Python laid has none."""
    return json.loads(route.made) if route.made else {"points": "laid in Python"}


def faster(route: agvjax.Route, factor: float) -> agvjax.Route:
    """The route driven so many times as fast, with the square of it as the limit of lateral acceleration.

    Its limits on speeding up and slowing down stay. Laid again: its pieces, and so all shapes of arrays, stay too.

    Raises:
        ValueError: Python laid it, so that nothing is known of its limits.
    """
    if not route.made:
        raise ValueError("a route that Python laid cannot be laid again at another speed: lay it of a table")
    table = table_of(route)
    rows = np.asarray(table["points"], float) if "points" in table else None
    widths = None if rows is None else np.asarray(table["half_width"], float)
    if rows is not None and "speed" in table:
        rows = np.column_stack([rows, np.full(len(rows), table["speed"])])
    return laid({**table, "faster": factor * table.get("faster", 1.0)}, rows, widths)


def _absent(table: Mapping[str, Toml], names: tuple[str, ...], why: str) -> None:
    wrong = [agvjax.Fault(name, table[name], f"absent {why}") for name in names if name in table]
    if wrong:
        raise agvjax.InputError(wrong)


def _value(table: Mapping[str, Toml], name: str) -> Any:
    """A flag, a table, or numbers."""
    value = table[name]
    if name == "limits":
        return value
    if name in FLAGS:
        if not isinstance(value, bool):
            raise agvjax.InputError([agvjax.Fault(name, value, "true or false")])
        return value
    array = numbers(value)
    if name == "faster" and (array is None or array.ndim or not 0 < array < np.inf):
        raise agvjax.InputError([agvjax.Fault(name, value, "a number > 0, times the speed")])
    if array is None or not array.size or (array.ndim and name not in LISTS):
        rule = LISTS.get(name, "a number")
        raise agvjax.InputError([agvjax.Fault(name, value, rule)])
    return array if array.ndim else float(array)


def _limits(table: Toml) -> agvjax.SpeedLimits:
    """The speed limits of a table."""
    usual = agvjax.SpeedLimits()
    if not isinstance(table, Mapping):
        raise agvjax.InputError([agvjax.Fault("limits", table, f"a table with {', '.join(vars(usual))}")])
    wrong, values = [], {}
    for name, value in table.items():
        key, number = f"limits.{name}", numbers(value)
        if name not in vars(usual):
            wrong.append(agvjax.Fault(key, value, f"one of {', '.join(vars(usual))}"))
        elif name == "stop":
            if not isinstance(value, bool):
                wrong.append(agvjax.Fault(key, value, "true or false"))
            values[name] = bool(value)
        elif number is None or number.ndim or not number > 0:
            wrong.append(agvjax.Fault(key, value, "a number > 0; inf for no limit"))
        else:
            values[name] = float(number)
    if wrong:
        raise agvjax.InputError(wrong)
    return dataclasses.replace(usual, **values)


def _shape(table: Toml) -> agvjax.Path:
    """A shape by its name, or by a table of it."""
    table = {"type": table} if isinstance(table, str) else table
    kind = table.get("type") if isinstance(table, Mapping) else None
    if not isinstance(table, Mapping) or kind not in SHAPES:
        rule = f"one of {', '.join(SHAPES)}, or a table with its type and numbers"
        raise agvjax.InputError([agvjax.Fault("along", table, rule)])
    shape, wrong, values = SHAPES[kind](), [], {}
    for name, value in table.items():
        if name == "type":
            continue
        array = numbers(value)
        if name not in agvjax.leaves(shape) or array is None:
            wrong.append(agvjax.Fault(f"along.{name}", value, f"a number of {kind}: {', '.join(agvjax.leaves(shape))}"))
        else:
            values[name] = array if array.ndim else float(array)
    shape = agvjax.replace(shape, values)
    wrong += [fault._replace(key=f"along.{fault.key}") for fault in agvjax.faults(shape)]
    if wrong:
        raise agvjax.InputError(wrong)
    return shape
