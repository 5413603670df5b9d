"""Places on a map: in files they count from the map's origin, inside from where a path that is far away begins.

So single precision does for maps of any size, and UTM coordinates are as good as others.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

import agvjax

from ..ensemble.draws import Draw, Span
from ..ensemble.moved import moved
from . import routes
from .settings import Config

Origin = tuple[float, float]
POSITION = "start.position"


def origin(scenario: agvjax.Scenario) -> np.ndarray:
    """Where (2,) [m] of its map the places of a scenario count from."""
    path = scenario.path
    return np.asarray(path.origin if isinstance(path, (agvjax.Waypoints, agvjax.Route)) else (0.0, 0.0))


def start(scenario: agvjax.Scenario, way: float) -> agvjax.Scenario:
    """The scenario with its start counted from its origin (`way` -1), or from the map's again (1)."""
    off, place = way * origin(scenario), np.asarray(scenario.start.position, float)
    if not off.any() or place.shape != (2,):  # what is wrong with it, the rules say
        return scenario
    return dataclasses.replace(scenario, start=dataclasses.replace(scenario.start, position=place + off))


def draws(config: Config, way: float) -> tuple[Config, list[agvjax.Fault]]:
    """The configuration with what it draws and sweeps of starts moved as `start` does, and what cannot be."""
    off, wrong = way * origin(config.scenario), []
    if not off.any():
        return config, []

    def one(key: str, name: str, value: Draw | Span) -> Draw | Span:
        leaf = name.removeprefix("scenario.")
        by = {POSITION: off, f"{POSITION}[0]": off[0], f"{POSITION}[1]": off[1]}.get(leaf)
        if by is None:
            return value
        by = np.asarray(by)
        try:
            return value._replace(draw=moved(value.draw, by)) if isinstance(value, Span) else moved(value, by)
        except ValueError as error:
            far = f"where the path begins {np.abs(off).max():.6g} m from the origin of its map"
            wrong.append(agvjax.Fault(f"{key}.{name}", "x and y alike", f"{error}, {far}"))
            return value

    ensemble, sweep = config.ensemble, config.sweep
    if isinstance(ensemble.draws, Mapping):
        found = {name: one("ensemble.draws", name, draw) for name, draw in ensemble.draws.items()}
        ensemble = dataclasses.replace(ensemble, draws=found)
    if sweep.over is not None:
        axes = tuple({name: one("sweep.over", name, span) for name, span in axis.items()} for axis in sweep.over)
        sweep = dataclasses.replace(sweep, over=axes)
    return dataclasses.replace(config, ensemble=ensemble, sweep=sweep), wrong


def begun(path: agvjax.Waypoints | agvjax.Route) -> agvjax.Start:
    """Where a path begins, looking along it, at its speed; by its own coordinates, without waking JAX."""
    if isinstance(path, agvjax.Waypoints):
        position, slope = np.asarray(path.coefficients, float)[0, :2]
        velocity, sign = slope * len(path.coefficients) / float(path.duration), 1.0
        way = velocity
    else:
        table, sign = np.asarray(path.table, float), float(np.asarray(path.legs)[3, 0])
        position, way = table[[0, 6], 0], table[[1, 7], 0]
        velocity = way / np.hypot(*way) * np.sqrt(np.asarray(path.squares, float)[0, 0])
    start = agvjax.Start(heading=float(np.arctan2(sign * way[1], sign * way[0])))
    return agvjax.replace(start, {"position": position, "velocity": velocity})


def drawn(run: agvjax.Trajectory, scenario: agvjax.Scenario) -> agvjax.Trajectory:
    """A trajectory by the coordinates of the map, in double precision on the host: for files and figures."""
    off = origin(scenario)
    if not off.any():
        return run
    places = {name: np.asarray(getattr(run, name), float) + off for name in ("position", "reference_position")}
    beside = run.route
    if beside is not None:
        beside = dataclasses.replace(beside, position=np.asarray(beside.position, float) + off)
    return dataclasses.replace(run, route=beside, **places)


def told(leaves: Mapping[str, np.ndarray], scenario: agvjax.Scenario) -> dict[str, object]:
    """Values of leaves by name as they are in a file, a start by the coordinates of the map."""
    by = {POSITION: origin(scenario)}
    return {name: (np.asarray(value) + by.get(name, 0)).tolist() for name, value in leaves.items()}


def laid(route: agvjax.Route) -> agvjax.Route:
    """A route by the coordinates of its map, for what drives by them."""
    table = np.array(route.table, float)
    table[[0, 6]] += np.asarray(route.origin)[:, None]
    return dataclasses.replace(route, table=table, origin=(0.0, 0.0))


def corners(path: agvjax.Path) -> np.ndarray | None:
    """The points (N, 2) [m] that a path was laid through, by the coordinates of its map; None of any other."""
    if isinstance(path, agvjax.Waypoints):
        return np.asarray(path.points, float)[:, :2]
    if isinstance(path, agvjax.Route) and path.made and "points" in (table := routes.table_of(path)):
        return np.asarray(table["points"], float)[:, :2]
    return None
