"""Where the path goes and where the vehicle starts: what cannot be run, and what a person should know before a run.

Paths are looked at by JAX, so that all of this is asked only where its precision has been set.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import agvjax
from agvjax import Fault
from agvjax.engine.loop import RESOLUTION, farthest
from agvjax.leaves import cast

from . import mapped, routes
from .ends import DRAWS, Moving, placed
from .settings import Config

POINTS = 501
START = "start.position"
DRAWN = f"{DRAWS}.{START}"
NEAR, NEAR_SHARE = 1.0, 0.1  # m, and share of the path's extent: a start farther off is worth a word
FAR = 10.0  # m, or the path's extent: where every start that is drawn lies farther off, none follows the path
LAP = 0.9  # of a lap; a shorter horizon is worth a word
BULGE = 0.1  # of the distance of two waypoints, by which the curve may leave the straight line without a word
WINDOW = 20  # waypoints on either side that are looked at for the nearest line


def course(config: Config) -> np.ndarray:
    """Points of the path (n, 2) [m] over the horizon, or to its end."""
    path = cast(config.scenario.path, jnp.result_type(float))
    last = min(config.simulate.horizon, path.end())
    return np.asarray(jax.vmap(path)(jnp.linspace(0.0, last, POINTS)), float)


def _starts(config: Config, moving: Iterable[Moving]) -> np.ndarray:
    """The corners (n, 2) [m] of where vehicles start."""
    corners = [np.asarray(config.scenario.start.position, float)]
    for axis in moving:
        if any(name.startswith(START) for name in axis.spans):
            ends = [placed(config, end).scenario.start.position for end in axis.ends(config)]
            corners = [np.asarray(end, float) for end in ends] + corners[1:]
    return np.stack(corners)


def faults(config: Config, moving: Sequence[Moving] = ()) -> list[Fault]:
    """Positions that the numbers do not resolve, and starts of which none is anywhere near the path."""
    way, starts, off = course(config), _starts(config, moving), mapped.origin(config.scenario)
    wrong, limit = [], farthest(np.float32)
    for what, points in {"the path": way, "a start": starts}.items():
        far = float(np.abs(points).max())
        if config.precision == 32 and far > limit:
            rule = (
                f"64 (--precision 64): {what} lies {far:.6g} m from the origin{_from(config)}, and 32 bits tell places"
            )
            wrong.append(Fault("precision", 32, f"{rule} {RESOLUTION:g} m apart up to {limit:.0f} m only"))
    turned, most = float(config.scenario.start.heading), farthest(f"float{config.precision}")
    if abs(turned) > most:
        rule = f"at most {most:.4g} in size: {config.precision} bits tell none {RESOLUTION:g} rad apart beyond"
        wrong.append(Fault("scenario.start.heading", turned, rule))
    extent = _extent(way)
    nearest = np.clip(way[0], starts.min(axis=0), starts.max(axis=0))
    gap = float(np.linalg.norm(nearest - way[0]))
    drawn = any(axis.key == DRAWS and START in axis.spans for axis in moving)
    if drawn and gap > max(extent, FAR):
        rule = (
            f"nearer to where scenario.path begins, {_point(way[0] + off)}: every drawn start lies {gap:.4g} m or more"
        )
        rule += f" away, and the path goes no farther than {extent:.4g} m"
        wrong.append(Fault(DRAWN, _point(nearest + off), rule))
    return wrong


def notes(config: Config, moving: Sequence[Moving] = ()) -> list[str]:
    """What of the path, the start and the horizon may not be meant."""
    way, path, horizon = course(config), config.scenario.path, config.simulate.horizon
    said = []
    extent, off, starts = _extent(way), mapped.origin(config.scenario), _starts(config, moving)
    nearest = np.clip(way[0], starts.min(axis=0), starts.max(axis=0))
    gap = float(np.linalg.norm(nearest - way[0]))
    if gap > max(NEAR, NEAR_SHARE * extent):
        drawn = any(name.startswith(START) for axis in moving for name in axis.spans)
        where = f"the vehicle starts at {_point(nearest + off)} (scenario.start.position), {gap:.3g} m"
        where = f"every vehicle starts {gap:.3g} m or more ({DRAWN} or sweep.over)" if drawn else where
        said.append(f"{where} from {_point(way[0] + off)}, where scenario.path begins")
    lap = _lap(path)
    if horizon < LAP * lap:
        said.append(f"the run ends after {horizon:.4g} s (simulate.horizon), the path takes {lap:.4g} s")
    if bulge := _bulge(path):
        said.append(bulge)
    return said


def _extent(way: np.ndarray) -> float:
    """How far [m] a path goes from where it begins."""
    return float(np.linalg.norm(way - way[0], axis=1).max())


def _from(config: Config) -> str:
    """Which origin it is, where it is not the map's."""
    off = mapped.origin(config.scenario)
    return f", here {_point(off)} of the map" if off.any() else ""


def _point(place: np.ndarray) -> str:
    return f"({place[0]:.6g}, {place[1]:.6g})"


def _lap(path: agvjax.Path) -> float:
    """How long [s] it takes to run the path once; 0: it does not say."""
    if isinstance(path, agvjax.Waypoints):
        return float(path.duration)
    if isinstance(path, agvjax.Route):
        return float(np.asarray(path.instants)[-1])
    omega = agvjax.leaves(path).get("omega", np.inf)
    return 2 * np.pi / float(omega) if np.ndim(omega) == 0 else 0.0


def _bulge(path: Any) -> str:
    """How far a curve through points leaves the straight lines between them, where that is much for their distance."""
    corners = mapped.corners(path)
    if corners is None or (isinstance(path, agvjax.Route) and {"radius", "tolerance"} & set(routes.table_of(path))):
        return ""
    corners, count = corners - path.origin, len(corners)
    corners = np.r_[corners, corners[:1]] if path.closed else corners
    first, line = corners[:-1], np.diff(corners, axis=0)
    length = np.linalg.norm(line, axis=1)
    arc, place = _curve(path, max(2000, 8 * len(corners)))
    along = np.r_[0, np.cumsum(length)] * (arc[-1] / length.sum())
    about = np.clip(np.searchsorted(along, arc) - 1, 0, len(length) - 1)
    best, which = np.full(len(about), np.inf), about.copy()
    for shift in range(-WINDOW, WINDOW + 1):
        k = (about + shift) % len(length) if path.closed else np.clip(about + shift, 0, len(length) - 1)
        away = place - first[k]
        share = np.clip(np.sum(away * line[k], axis=1) / length[k] ** 2, 0, 1)
        gap = np.linalg.norm(away - share[:, None] * line[k], axis=1)
        best, which = np.where(gap < best, gap, best), np.where(gap < best, k, which)
    much = np.where(best > BULGE * length[which], best, 0)
    if not much.any():
        return ""
    i = int(np.argmax(much))
    k = int(which[i])
    return (
        f"scenario.path is a smooth curve through its points and leaves the straight line from number {k + 1} to number"
        f" {(k + 1) % count + 1} by {best[i]:.3g} m, {best[i] / length[k]:.0%} of their distance; more points on the"
        f" line hold it there, and a route with radius or tolerance is of straight lines with rounded corners"
    )


def _curve(path: Any, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Arc lengths (n,) and places (n, 2) along a path through points."""
    if isinstance(path, agvjax.Waypoints):
        way = path.geometry(n)
        return way.arc, way.position
    arc = np.linspace(0, float(path.length), n)
    leg = np.clip(np.searchsorted(np.asarray(path.legs, float)[0], arc, "right") - 1, 0, None)
    path = cast(path, jnp.result_type(float))
    return arc, np.asarray(jax.vmap(path.at)(jnp.asarray(arc), jnp.asarray(leg, arc.dtype)).position, float)
