"""Figures of the highest speed: the curve of speed against error, and where on the route it binds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np

from agvjax.draw import plot

from ...config.settings import Config
from ...io.panels import panels
from .place import Place
from .study import late
from .tried import Answer, Tried

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DOTS = 1500  # along a run, coloured by distance


def tolerance(config: Config) -> float | None:
    """What a distance [m] must not exceed; None for a corridor whose width is not one number."""
    if config.speed.within:
        return config.speed.within
    path: Any = config.scenario.path
    widths = np.asarray(path.half_widths)
    return float(widths[0, 0]) if not np.ptp(widths[[0, 2]]) else None


def curve(tried: list[Tried], found: Answer, config: Config) -> Figure:
    """Distances, and the speed that is driven, against the speed that is asked for."""
    drawn, ((off, driven),) = panels(1, 2, (10.5, 4.2))
    speeds, within = np.array([t.speed for t in tried]), config.speed.within
    lines = {"largest of all vehicles, tuned": "worst", "mean of the vehicles, tuned": "mean"}
    for (label, name), color in zip(lines.items(), ("tab:blue", "0.55"), strict=True):
        values = 1e3 * plot.shown(np.array([t._asdict()[name] for t in tried]))
        off.plot(speeds, values, "-", lw=1.3, color=color, label=label)
    start = 1e3 * plot.shown(np.array([t.start for t in tried]))
    off.plot(speeds, start, ":", lw=1.1, color="tab:orange", label="largest of all vehicles, configured gains")
    for t in tried:
        face = "tab:blue" if t.holds(within) else "white"
        off.plot(t.speed, 1e3 * plot.shown(t.worst), "o", ms=6, mfc=face, mec="tab:blue", zorder=3)
    bound = tolerance(config)
    if bound is not None:
        off.axhline(1e3 * bound, color="tab:red", lw=1, label=f"limit: {1e3 * bound:g} mm")
        low, high = off.get_ylim()
        tuned = [1e3 * t.worst for t in tried if np.isfinite(t.worst)]
        off.set_ylim(0, min(high, 2.5 * max([*tuned, 1e3 * bound])))
    off.plot([], [], "o", mfc="white", mec="tab:blue", label="does not hold")
    driven.plot(speeds, speeds, "--", lw=0.9, color="0.6", label="as asked")
    driven.plot(
        speeds,
        [np.nan if t.why else t.driven for t in tried],
        "o-",
        ms=4,
        lw=1.2,
        color="tab:blue",
        label="driven, mean",
    )
    if found.best is not None and found.above is not None:
        for axes in (off, driven):
            axes.axvspan(found.best.speed, found.above.speed, color="tab:green", alpha=0.2, lw=0, zorder=0)
    off.set(xlabel="highest speed of the profile [m/s]", ylabel="largest distance after the start [mm]")
    driven.set(xlabel="highest speed of the profile [m/s]", ylabel="mean speed along the route [m/s]")
    off.legend(fontsize=8)
    driven.legend(fontsize=8)
    return drawn


def places(found: list[Place], config: Config) -> Figure:
    """The route, coloured by how far the worst vehicle is off it, and the place at which that is most."""
    drawn, (row,) = panels(1, len(found), (5.6 * len(found), 4.6))
    for axes, place in zip(row, found, strict=True):
        _place(drawn, axes, place, config)
    return drawn


def _place(drawn: Figure, axes: Any, place: Place, config: Config) -> None:
    beside = cast(Any, place.run.route)
    counts = np.asarray(place.run.t) >= late(config, place.tried.factor)
    path = np.asarray(beside.position)
    axes.plot(*plot.outline(cast(Any, config.scenario.path))[0].T, color="0.75", lw=5, solid_capstyle="round", zorder=1)
    keep = np.flatnonzero(counts)[:: max(1, int(counts.sum()) // DOTS)]
    off = 1e3 * np.abs(np.asarray(beside.cross_track))
    dots = axes.scatter(*path[keep].T, c=off[keep], s=5, cmap="viridis", vmin=0, zorder=2)
    axes.plot(*np.asarray(place.run.position[0]), "o", color="k", ms=4, label="start", zorder=3)
    x, y = place.position
    axes.plot(x, y, "X", ms=11, color="tab:red", mec="white", label=f"{1e3 * abs(place.across):.1f} mm", zorder=4)
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    holds = "holds" if place.tried.holds(config.speed.within) else "does not hold"
    axes.set_title(f"{place.tried.speed:.3g} m/s, {holds}: vehicle {place.tried.vehicle}, the farthest off", fontsize=9)
    axes.margins(0.12)
    axes.legend(fontsize=8)
    drawn.colorbar(dots, ax=axes, label="distance to the route [mm]", shrink=0.8)
