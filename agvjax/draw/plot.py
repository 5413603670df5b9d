"""Figures of trajectories. They are made and not shown; the first one made imports matplotlib."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jax.typing import ArrayLike

from ..metrics import tracking_error
from ..paths.route import Route
from ..protocols import Path, Plant

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CHANNELS = ("x", "y", "heading")
ERRORS = ("$e_x$ [m]", "$e_y$ [m]", r"$e_\psi$ [rad]")
COMMANDS = (r"$\bar u_x$ [m/s$^2$]", r"$\bar u_y$ [m/s$^2$]", r"$\bar\omega$ [rad/s]")
ALONE = ({"color": "tab:blue", "lw": 1.4},)
STYLES = (
    {"color": "0.55", "lw": 1.2, "ls": "--"},
    {"color": "tab:blue", "lw": 1.4},
    {"color": "tab:orange", "lw": 1.2, "ls": ":"},
)

FAR = 1e100  # beyond it the arithmetic of axes overflows
LEFT_OUT = "not drawn: what is not finite or beyond 1e100"

Runs = Mapping[str, Any]  # label -> trajectory, drawn in this order


def shown(values: ArrayLike) -> np.ndarray:
    """The numbers that a figure can show; NaN, a gap in a line, for those that are not finite or beyond `FAR`."""
    plain = np.asarray(values, float)
    return np.where(np.abs(plain) <= FAR, plain, np.nan)


def sheet(size: tuple[float, float], layout: Literal["constrained"] | None = "constrained") -> Figure:
    """An empty figure of `size` [inch]: every figure of this project is begun here."""
    from matplotlib.figure import Figure  # late: half a second that a run without figures does not need

    return Figure(figsize=size, layout=layout)


def path(runs: Runs, points: ArrayLike | None = None, way: Path | None = None) -> Figure:
    """The reference path and what the reference point of the vehicle did, in the plane.

    Args:
        runs: label -> trajectory.
        points: (N, 2) [m] that the path was laid through.
        way: the path; a route is drawn whole, with its stops, however far a run came.
    """
    figure = sheet((5.2, 5.2))
    draw_path(figure.add_subplot(), runs, points, way)
    return complete(figure)


def draw_path(axes: Any, runs: Runs, points: ArrayLike | None = None, way: Path | None = None) -> None:
    """The same on given axes."""
    if points is not None:
        axes.plot(*shown(points).T[:2], "+", color="tab:red", ms=7, label="waypoints")
    first, stops = next(iter(runs.values())), None
    course = first.reference_position
    if isinstance(way, Route):
        course, stops = outline(way)
    axes.plot(*shown(course).T, color="k", lw=0.8, label="path")
    if stops is not None and len(stops):
        axes.plot(*stops.T, "s", color="k", ms=6, fillstyle="none", label="stop")
    for (label, run), style in zip(runs.items(), _styles(runs), strict=False):
        axes.plot(*shown(run.position).T, label=label, **style)
    axes.plot(*shown(first.position[0]), "o", color="k", ms=4, label="start")
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    axes.legend(fontsize=8)


def outline(route: Route) -> tuple[np.ndarray, np.ndarray]:
    """A route by the coordinates of its map: where (n, 2) [m] its pieces begin and end, and where (m, 2) it stops."""
    table, legs = np.asarray(route.table, float), np.asarray(route.legs)
    x, y = table[:6], table[6:]  # by powers of the share of a piece
    points = np.c_[np.append(x[0], x[:, -1].sum()), np.append(y[0], y[:, -1].sum())] + route.origin
    begins, dwell = legs[2].astype(int), legs[4]
    return points, points[begins[1:][dwell[:-1] > 0]]


def errors(runs: Runs) -> Figure:
    """The errors in time."""
    return _rows(runs, lambda run: shown(tracking_error(run)), ERRORS, "symlog", 1e-2)


def asked(plant: Plant) -> tuple[str, ...]:
    """What a law asks a plant for, by channel, with units."""
    units = plant.command_units
    if units == Plant.command_units:
        return COMMANDS
    names = ("speed", "yaw rate") if len(units) == 2 else CHANNELS
    return tuple(f"{name} asked for [{unit}]" for name, unit in zip(names, units, strict=False))


def commands(runs: Runs, labels: Sequence[str] = COMMANDS) -> Figure:
    """The commands in time, before the actuators; `labels` as from `asked`."""
    scale = ("symlog", 1.0) if tuple(labels) == COMMANDS else ("linear", None)
    return _rows(runs, lambda run: shown(run.command), labels, *scale)


def route(run: Any) -> Figure:
    """How a route was followed in time: distance from it, with its corridor, heading error, and speed."""
    ride, t = run.route, np.asarray(run.t)
    figure = sheet((7.5, 6))
    across, turned, fast = figure.subplots(3, 1, sharex=True)
    across.plot(t, 1e3 * np.asarray(ride.cross_track), **ALONE[0])
    if ride.room is not None:
        left, right = (1e3 * np.asarray(side) for side in ride.room)
        across.plot(t, left, color="0.4", lw=0.8, ls="--", label="corridor")
        across.plot(t, -right, color="0.4", lw=0.8, ls="--")
        across.legend(fontsize=8)
    turned.plot(t, np.degrees(np.asarray(ride.heading_error)), **ALONE[0])
    fast.plot(t, np.asarray(ride.wanted), color="0.55", lw=1.2, ls="--", label="profile")
    fast.plot(t, np.asarray(ride.speed), label="driven", **ALONE[0])
    fast.legend(fontsize=8)
    for axes, label in ((across, "to the left [mm]"), (turned, "heading error [deg]"), (fast, "speed [m/s]")):
        axes.set(ylabel=label)
        axes.grid(alpha=0.3)
    fast.set(xlabel="time [s]")
    return complete(figure)


def inputs(run: Any, names: Sequence[str]) -> Figure:
    """What each actuator was asked for and what it delivered; grey where something was at its limit."""
    figure = sheet((7.5, 2.2 * len(names)))
    rows = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    t, limited = np.asarray(run.t), np.asarray(run.limited, float)
    for i, (axes, name) in enumerate(zip(rows, names, strict=True)):
        asked, delivered = shown(run.inputs)[:, i], shown(run.delivered)[:, i]
        axes.plot(t, asked, color="0.6", lw=0.8, ls="--", label="asked")
        axes.plot(t, delivered, color="tab:blue", lw=1.2, label="delivered")
        held = np.repeat(t, 2)[1:], np.repeat(limited, 2)[:-1]  # from each sample to the next
        axes.fill_between(held[0], 0, held[1], transform=axes.get_xaxis_transform(), color="0.9", lw=0)
        room = 1.3 * max(float(np.max(np.abs(np.nan_to_num(delivered)))), 1e-9)
        axes.set(ylabel=name.replace("_", " "), ylim=(-room, room))
        axes.grid(alpha=0.3)
    rows[0].legend(fontsize=8, ncols=2)
    rows[-1].set(xlabel="time [s]")
    return complete(figure)


def _styles(runs: Runs) -> tuple[dict[str, Any], ...]:
    return ALONE if len(runs) == 1 else STYLES


def _rows(runs: Runs, values: Any, labels: Sequence[str], scale: str, linear: float | None) -> Figure:
    channels = values(next(iter(runs.values()))).shape[1]  # two where the heading is not commanded
    figure = sheet((7.5, 2 * channels))
    rows = figure.subplots(channels, 1, sharex=True, squeeze=False)[:, 0]
    for channel, (axes, label) in enumerate(zip(rows, labels, strict=False)):
        for (name, run), style in zip(runs.items(), _styles(runs), strict=False):
            axes.plot(np.asarray(run.t), values(run)[:, channel], label=name, **style)
        if linear is not None:
            axes.set_yscale(scale, linthresh=linear)
            axes.axhspan(-linear, linear, color="0.95", lw=0, zorder=0)
        axes.set(ylabel=label)
        axes.grid(alpha=0.3)
    rows[-1].set(xlabel="time [s]")
    if linear is not None:
        rows[0].set_title("linear in the shaded band, logarithmic beyond", fontsize=8, color="0.25", loc="right")
    if len(runs) > 1:
        rows[0].legend(fontsize=8, ncols=len(runs))
    return complete(figure)


def complete(figure: Figure) -> Figure:
    """The same figure, which says so where a line has gaps."""
    lines = [line.get_xydata() for axes in figure.axes for line in axes.lines]
    if not all(np.isfinite(line).all() for line in lines):
        figure.supxlabel(LEFT_OUT, fontsize=7, color="0.25", x=0.01, ha="left")
    return figure
