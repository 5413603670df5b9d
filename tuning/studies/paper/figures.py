"""Figures 3 to 16 with the paper's content, and those that the paper does not have; readable in print and in grey."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

import agvjax
from agvjax.draw import plot

from ...io.panels import panels
from ...io.pictures import Drawing
from . import cases
from . import proof as theory
from .bounds import Report
from .cases import LABELS, Judged
from .published import CHANNELS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REFERENCE = {"color": "0.6", "lw": 2.4, "ls": "-", "zorder": 1}
STYLES = (  # told apart by dashes alone, and from dark to light
    {"color": "#0b2559", "lw": 1.5, "ls": "-"},
    {"color": "#c03a2b", "lw": 1.3, "ls": (0, (5, 2))},
    {"color": "#2b8a6e", "lw": 1.3, "ls": (0, (1, 1.2))},
    {"color": "#d98d00", "lw": 1.3, "ls": (0, (6, 2, 1, 2))},
    {"color": "#8a5bb0", "lw": 1.3, "ls": (0, (3, 1, 1, 1, 1, 1))},
)
ACTUATED, UNPREPARED = ("proposed", "osfc", "asmc"), ("dfc", "ftsmc")  # whom Figs. 3-7 and 12-16 show
CHANNEL_AXES = ("x [m]", "y [m]", r"$\psi$ [rad]")
Values = Callable[[Any], Any]  # of a trajectory the columns that are drawn
Trajectories = Mapping[str, agvjax.Trajectory]


def paper(runs: Trajectories) -> dict[str, Drawing]:
    """Figures 3 to 16 by name, not yet drawn; `runs` are trajectories by controller."""
    drawn: dict[str, Drawing] = {}
    for first, who in ((3, ACTUATED), (12, UNPREPARED)):
        shown = {LABELS[name]: runs[name] for name in who}
        drawn[f"fig{first:02}"] = partial(
            in_time, shown, lambda r: r.position, CHANNEL_AXES[:2], lambda r: r.reference_position
        )
        drawn[f"fig{first + 1:02}"] = partial(
            in_time, shown, lambda r: r.heading[:, None], CHANNEL_AXES[2:], lambda r: r.reference_heading[:, None]
        )
        drawn[f"fig{first + 2:02}"] = partial(in_time, shown, lambda r: _errors(r)[:, :2], plot.ERRORS[:2], _zeros)
        drawn[f"fig{first + 3:02}"] = partial(in_time, shown, lambda r: _errors(r)[:, 2:], plot.ERRORS[2:], _zeros)
        drawn[f"fig{first + 4:02}"] = partial(in_plane, shown)
    proposed = {LABELS["proposed"]: runs["proposed"]}
    drawn["fig08"] = partial(in_time, proposed, lambda r: r.command[:, :2], plot.COMMANDS[:2], transient=0.3)
    drawn["fig09"] = partial(in_time, proposed, lambda r: r.command[:, 2:], plot.COMMANDS[2:], transient=0.3)
    norms = (r"$\hat\varphi$ [-]", r"$\hat\varphi_\psi$ [-]")
    drawn["fig10"] = partial(in_time, proposed, lambda r: r.weight_norm[:, :1], norms[:1])
    drawn["fig11"] = partial(in_time, proposed, lambda r: r.weight_norm[:, 1:], norms[1:])
    return drawn


def _errors(run: agvjax.Trajectory) -> np.ndarray:
    return plot.shown(agvjax.tracking_error(run))


def _zeros(run: agvjax.Trajectory) -> np.ndarray:
    return np.zeros((np.size(run.t), 2))


def in_time(
    shown: Trajectories,
    values: Values,
    labels: Sequence[str],
    reference: Values | None = None,
    transient: float | None = None,
) -> Figure:
    """One row of axes for each label against time; with `transient`, the first so many seconds beside the whole."""
    columns = 1 if transient is None else 2
    figure, grid = panels(len(labels), columns, (7, 1.1 + 1.9 * len(labels)), sharex="col")
    for (row, column), axes in np.ndenumerate(grid):
        for (name, run), style in zip(shown.items(), STYLES, strict=False):
            t, y = np.asarray(run.t), plot.shown(values(run))[:, row]
            keep = t <= (transient if column == 1 and transient else np.inf)
            if columns == 2 and column == 0:
                axes.set_ylim(*_around(y[t > (transient or 0.0)], 0.1))
            axes.plot(t[keep], y[keep], label=name, **style)
        if reference is not None:
            run = next(iter(shown.values()))
            axes.plot(np.asarray(run.t), np.asarray(reference(run))[:, row], label="desired", **REFERENCE)
    for axes, label in zip(grid[:, 0], labels, strict=True):
        axes.set(ylabel=label)
    for axes in grid[-1]:
        axes.set(xlabel="time [s]")
    if columns == 2:
        grid[0, 0].set_title("whole lap, without the transient's peak", fontsize=8)
        grid[0, 1].set_title(f"first {transient} s", fontsize=8)
    if len(shown) > 1 or reference is not None:
        lines, names = grid[0][0].get_legend_handles_labels()
        figure.legend(lines, names, fontsize=8, ncols=4, loc="outside upper right")
    return figure


def _around(values: np.ndarray, room: float) -> tuple[float, float]:
    """Ends of an axis that shows all values, with so much room at either end, as a share of their range."""
    finite = plot.shown(values)
    finite = finite[np.isfinite(finite)] if np.isfinite(finite).any() else np.zeros(1)
    more = room * np.ptp(finite) + 1e-9 * (1 + np.max(np.abs(finite)))
    return float(finite.min() - more), float(finite.max() + more)


def in_plane(shown: Trajectories) -> Figure:
    """The path and the vehicles in the plane."""
    figure, ((axes,),) = panels(1, 1, (6, 5.6))
    first = next(iter(shown.values()))
    axes.plot(*plot.shown(first.reference_position).T, label="desired", **REFERENCE)
    for (name, run), style in zip(shown.items(), STYLES, strict=False):
        axes.plot(*plot.shown(run.position).T, label=name, **style)
    axes.plot(*plot.shown(first.position)[0], "ko", ms=4, label="start")
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    axes.legend(fontsize=8)
    return figure


def b1(rows: Sequence[Mapping[str, float]], k2: float) -> Figure:
    """`rows` of facts.network: RMSE by channel, and the largest network gain, against b1."""
    figure, ((error, gain),) = panels(1, 2, (7.5, 3.6), "both")
    for known, style, word in ((False, STYLES[0], "assumed 1"), (True, STYLES[1], "known slopes")):
        chosen = [row for row in rows if row["known_slopes"] == known and row["b1"] is not None]
        x = [row["b1"] for row in chosen]
        gain.loglog(x, [row["gain_position"] for row in chosen], marker="o", ms=3, label=word, **style)
        for channel, mark, color in zip(CHANNELS if not known else (), "osv", STYLES, strict=False):
            error.semilogx(x, [r[f"rmse_{channel}"] for r in chosen], marker=mark, ms=3, label=channel, **color)
    gain.axhline(k2, color="k", lw=0.8, ls=":")
    gain.text(gain.get_xlim()[0] * 1.1, k2 * 1.15, "k2", fontsize=8)
    error.set(xlabel="b1 = b2", ylabel="RMSE [m, m, rad]")
    gain.set(xlabel="b1 = b2", ylabel="largest network gain, position [1/s]")
    for axes in (error, gain):
        axes.legend(fontsize=8)
    return figure


def bandwidth(judged: Judged) -> Figure:
    """RMSE over the lap and after 4 s by channel, all five laws."""
    from matplotlib.ticker import NullFormatter

    figure, grid = panels(2, 3, (9, 5.4), "both", sharex=True)
    for style, law in zip(STYLES, ("proposed", "osfc", "asmc", "dfc", "ftsmc"), strict=True):
        runs = [judged[f"{law} p={p:g}"].judged for p in cases.BANDWIDTHS]
        for row, (metric, word) in enumerate((("rmse", "RMSE"), ("rmse_late", "RMSE after 4 s"))):
            for i, unit in enumerate(CHANNEL_AXES):
                y = [float(getattr(m, metric)[i]) for m in runs]
                grid[row][i].loglog(cases.BANDWIDTHS, y, label=LABELS[law], **style)
                grid[row][i].set_ylabel(f"{word}, {unit}", fontsize=8)
    for axes in grid[-1]:
        axes.set_xticks((5, 10, 20, 40), ("5", "10", "20", "40"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set(xlabel="bandwidth p [1/s]")
    grid[0][0].legend(fontsize=7)
    return figure


def readings(runs: Trajectories) -> Figure:
    """Errors of every reading beside the default's, one row each."""
    names = [name for name in runs if name != "default"]
    figure, grid = panels(len(names), 3, (9, 1.25 * len(names) + 0.8), sharex=True)
    base = _errors(runs["default"])
    for row, name in enumerate(names):
        errors, t = _errors(runs[name]), np.asarray(runs[name].t)
        for i in range(3):
            axes = grid[row][i]
            axes.plot(t, base[:, i], label="default", **REFERENCE)
            axes.plot(t, errors[:, i], label="this reading", **STYLES[0])
            axes.set_ylim(*_around(np.concatenate([errors[t > 0.5, i], base[t > 0.5, i]]), 0.15))
            axes.tick_params(labelsize=7)
        grid[row][0].set_ylabel(name.replace(" ", "\n", 1), fontsize=7)
    for axes, title in zip(grid[0], plot.ERRORS, strict=True):
        axes.set_title(f"{title}, scaled to t > 0.5 s", fontsize=8)
    for axes in grid[-1]:
        axes.set_xlabel("time [s]", fontsize=8)
    grid[0][0].legend(fontsize=7)
    return figure


def event(held: agvjax.Trajectory, continuous: agvjax.Trajectory) -> Figure:
    """Held and continuous commands in the first 0.4 s, and when each channel was updated."""
    figure, grid = panels(2, 3, (9, 5.2))
    t, u, free = np.asarray(held.t), np.asarray(held.command), np.asarray(continuous.command)
    for i, label in enumerate(plot.COMMANDS):
        first = t <= 0.4
        grid[0][i].plot(t[first], free[first, i], label="continuous", **REFERENCE)
        grid[0][i].plot(t[first], u[first, i], drawstyle="steps-post", label="held", **{**STYLES[0], "lw": 1.0})
        grid[0][i].set(ylabel=label, xlabel="time [s]")
        moments = t[1:][np.diff(u[:, i]) != 0]
        grid[1][i].semilogy(moments[1:], np.diff(moments), ".", ms=3, color="#0b2559")
        grid[1][i].set(xlabel="time [s]", ylabel="interval [s]", title=f"{moments.size} updates")
        grid[1][i].title.set_fontsize(8)
    grid[0][0].legend(fontsize=8)
    return figure


def fractional(judged: Judged) -> Figure:
    """RMSE over the lap and after 4 s against the order, relative to order 1."""
    figure, (places,) = panels(1, 2, (7.5, 3.4))
    runs = [judged[f"lam={lam:g}"].judged for lam in cases.ORDERS]
    for axes, metric, word in zip(places, ("rmse", "rmse_late"), ("RMSE", "RMSE after 4 s"), strict=True):
        for i, (channel, style) in enumerate(zip(("x", "y", r"$\psi$"), STYLES, strict=False)):
            y = np.array([float(getattr(m, metric)[i]) for m in runs])
            axes.plot(cases.ORDERS, y / y[-1], marker="o", ms=3, label=channel, **style)
        axes.set(xlabel=r"order $\lambda$ of the integral", ylabel=f"{word} / that of $\\lambda$ = 1")
        axes.legend(fontsize=8)
    return figure


def lyapunov(
    trajectory: agvjax.Trajectory, constants: theory.Constants, functions: theory.Functions, report: Report
) -> Figure:
    """L2 and L4 with their printed bounds, and the errors with the printed and the corrected ultimate bounds."""
    t = np.asarray(trajectory.t)
    errors = _errors(trajectory)
    figure, grid = panels(2, 2, (9, 5.4), sharex=True)
    pairs = (("L2", constants.a1, constants.a2), ("L4", constants.a5, constants.a6))
    sizes = (np.linalg.norm(errors[:, :2], axis=1), np.abs(errors[:, 2]))
    words = ("|Z1| [m]", "|Z3| [rad]")
    for i, (name, rate, drive) in enumerate(pairs):
        value = np.asarray(getattr(functions, name))
        bound = np.asarray(theory.exponential_bound(t, value[0], float(rate), float(drive)))
        grid[0][i].semilogy(t, value, label=f"{name} along the run", **STYLES[0])
        grid[0][i].semilogy(t, bound, label=f"printed bound, {'(49)' if i == 0 else '(71)'}", **STYLES[1])
        grid[0][i].set(ylabel=name)
        grid[1][i].semilogy(t, np.maximum(sizes[i], 1e-6), label="observed", **{**STYLES[0], "lw": 0.9})
        grid[1][i].axhline(report.printed[i], label=f"printed, {'(50)' if i == 0 else '(72)'}", **STYLES[1])
        grid[1][i].axhline(report.corrected[i], label="corrected", **STYLES[2])
        grid[1][i].set(ylabel=words[i], xlabel="time [s]")
    for axes in grid.flat:
        axes.legend(fontsize=8)
    return figure


def vacuity(reports: Sequence[Report]) -> Figure:
    """Histograms of bound over observed error, printed and corrected."""
    figure = plot.sheet((8.5, 3.4))
    for i, (axes, word) in enumerate(zip(figure.subplots(1, 2), ("position, |Z1|", "heading, |Z3|"), strict=True)):
        printed, corrected = ([getattr(r, n)[i] / r.observed[i] for r in reports] for n in ("printed", "corrected"))
        edges = np.geomspace(1, 2 * max(*printed, *corrected), 40)
        axes.hist(np.clip(corrected, 1, None), edges, label="corrected", color="#2b8a6e", hatch="//", edgecolor="w")
        axes.hist(printed, edges, label="printed", color="#0b2559")
        axes.axvline(10, color="k", lw=1, ls=":", label="vacuous beyond")
        axes.set(xscale="log", xlabel=f"bound / observed, {word}", ylabel="scenarios")
        axes.legend(fontsize=8)
    return figure
