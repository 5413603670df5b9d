"""Pictures of what a log says."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np

from agvjax import Deadzone
from agvjax.draw import plot

from ..io.csv_file import KINDS
from .excitation import Drive
from .fit import Fit, Task
from .log import Log, columns_of
from .plain import twists
from .predict import Prediction
from .verdict import FitVerdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DRAWN = 300  # deadzones that make a band
ACROSS, SHOWN = 3, 9  # pictures beside each other, and in all: of more logs the worst
PLANE = {"aspect": "equal", "xlabel": "x [m]", "ylabel": "y [m]"}
PARTS = ("slope_right", "slope_left", "threshold_right", "threshold_left")


def fitted(task: Task, verdict: FitVerdict) -> dict[str, list[str]]:
    """By actuator the numbers of its deadzone that were asked for; empty where none were."""
    names = [e.name for e in verdict.estimates]
    parts = {a: [p for p in PARTS if f"deadzone.{a}.{p}" in names] for a in task.model.scenario.plant.actuators}
    return {actuator: of_it for actuator, of_it in parts.items() if of_it}


def deadzones(task: Task, fit: Fit, verdict: FitVerdict, seed: int = 0) -> Figure:
    """What each actuator delivers, with its band, above how often each command came."""
    names, scenario, actuators = [e.name for e in verdict.estimates], task.model.scenario, fitted(task, verdict)
    figure = plot.sheet((4.6 * len(actuators), 4.6))
    axes = np.atleast_2d(figure.subplots(2, len(actuators), height_ratios=(3, 1), sharex="col", squeeze=False))
    rng = np.random.default_rng(seed)
    for column, (actuator, parts) in enumerate(actuators.items()):  # the other parts are as they were assumed
        places, own = [names.index(f"deadzone.{actuator}.{p}") for p in parts], [PARTS.index(p) for p in parts]
        u = _commands(task, actuator)
        assumed = np.array([float(getattr(scenario.deadzone[actuator], part)) for part in PARTS])
        best, drawn = assumed.copy(), np.tile(assumed, (DRAWN, 1))
        best[own] = fit.p[places]
        widest = max(
            4 * float(best[2:].max()), 1.2 * float(np.abs(u).min()), 4e-3
        )  # the deadzone and what is beside it
        grid = np.linspace(max(u.min(), -widest), min(u.max(), widest), 400)
        spread = np.array([verdict.estimates[i].deviation for i in places])
        eased = verdict.correlation[np.ix_(places, places)] * 0.999 + 0.001 * np.eye(len(places))
        moves = rng.standard_normal((DRAWN, len(places))) @ (np.linalg.cholesky(eased).T * spread)
        drawn[:, own] = np.maximum(fit.p[places] + moves, 0)
        curves = np.array([_delivered(row, grid) for row in drawn])
        low, high = np.quantile(curves, [0.025, 0.975], axis=0)
        top, bottom = axes[:, column]
        top.plot(grid, _delivered(assumed, grid), color="0.6", ls="--", label="assumed")
        top.fill_between(grid, low, high, color="C0", alpha=0.3, lw=0, label="95 % band")
        top.plot(grid, _delivered(best, grid), color="C0", label="identified")
        unknown = [part for part, i in zip(parts, places, strict=True) if not verdict.estimates[i].identified]
        lost = f"\nnot identifiable: {', '.join(unknown).replace('_', ' ')}" if unknown else ""
        top.set_title(actuator + lost, fontsize="medium")
        unit = scenario.plant.units.get(actuator)
        unit = f" [{unit}]" if unit else ""
        top.set(ylabel=f"delivered{unit}")
        top.legend(fontsize="small")
        bottom.hist(u, bins=80, range=(grid[0], grid[-1]), color="0.5")
        bottom.set(yscale="log", xlabel=f"command{unit}", ylabel="rows")
    return figure


def _tiles(count: int, height: float) -> tuple[Figure, Sequence[Axes]]:
    """A figure of so many axes, some beside and some below each other, each `height` inch high."""
    columns = min(count, ACROSS)
    rows = -(-count // columns)
    figure = plot.sheet((5.2 * columns, height * rows))
    axes = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
    for axis in axes[count:]:
        axis.remove()
    return figure, axes[:count]


def worst(errors: Sequence[float]) -> list[int]:
    """Which logs are drawn: all, in their order, or of many those with the largest errors, the worst first."""
    if len(errors) <= SHOWN:
        return list(range(len(errors)))
    return np.argsort(-np.asarray(errors), kind="stable")[:SHOWN].tolist()


def _say_which(figure: Figure, picked: Sequence[int], errors: Sequence[float]) -> None:
    """That only some of many logs are drawn."""
    if len(picked) < len(errors):
        figure.suptitle(f"the {len(picked)} of {len(errors)} logs with the largest errors", fontsize="medium")


def _commands(task: Task, actuator: str) -> np.ndarray:
    columns = columns_of(task.model.commands, actuator)
    return np.concatenate([log.inputs[:, columns].ravel() for log in task.logs])


def _delivered(numbers: np.ndarray, u: np.ndarray) -> np.ndarray:
    return np.asarray(Deadzone(**dict(zip(PARTS, numbers, strict=True)))(jnp.asarray(u)))


def coverage(logs: Sequence[Log]) -> Figure:
    """Speed and yaw rate, as the poses of the logs tell them."""
    figure = plot.sheet((5.2, 4.2))
    axis = figure.subplots()
    for log in logs:
        moved = twists(log)
        axis.plot(moved[:, 0], moved[:, 2], ".", ms=2, alpha=0.5)
    axis.axhline(0.0, color="0.7", lw=0.8)
    axis.axvline(0.0, color="0.7", lw=0.8)
    axis.set(xlabel="speed [m/s], negative backwards", ylabel="yaw rate [rad/s], positive to the left")
    return figure


def residuals(fit: Fit, verdict: FitVerdict) -> Figure:
    """What the model leaves unexplained, in standard deviations, over time; and its distribution beside the normal."""
    channels = fit.model.channels
    figure = plot.sheet((10, 1.5 * len(channels) + 0.6))
    axes = figure.subplots(len(channels), 2, width_ratios=(5, 1), sharey=True, squeeze=False)
    kept, t = fit.segments.weight > 0, fit.segments.t
    z = np.linspace(-4, 4, 200)
    for c, name in enumerate(channels):
        counted = kept[..., c]
        left = fit.sums.residual[..., c][counted] / fit.sigma[c]
        axes[c, 0].plot(t[counted], left, ".", ms=1.5, color="C0")
        axes[c, 0].set(ylim=(-5, 5), ylabel=name)
        said = f"1 = {fit.sigma[c]:.2g} {KINDS[name].split()[0]}"
        if name in verdict.left.white:  # of a robot that never moved nothing is said
            said += f", correlation with the next row {verdict.left.white[name]:.2f}"
        box = {"color": "white", "alpha": 0.8, "pad": 1}
        axes[c, 0].text(0.01, 0.86, said, transform=axes[c, 0].transAxes, fontsize="small", bbox=box)
        axes[c, 1].hist(left, bins=40, range=(-5, 5), density=True, orientation="horizontal", color="0.7")
        axes[c, 1].plot(np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi), z, color="C3", lw=1)
        axes[c, 1].set_xticks([])
    axes[-1, 0].set_xlabel("t [s]")
    axes[-1, 1].set_xlabel("normal in red")
    figure.supylabel("measured less predicted, in standard deviations", fontsize="small")
    return figure


def left_of(task: Task, fit: Fit) -> list[float]:
    """What each log's positions leave, the sum of squares [m^2]."""
    places = [fit.model.channels.index(name) for name in ("x", "y")]
    off = np.where(fit.segments.weight[..., places] > 0, fit.sums.residual[..., places], 0.0)
    return [float((off[fit.segments.log == i] ** 2).sum()) for i in range(len(task.logs))]


def paths(task: Task, fit: Fit) -> Figure:
    """Where the vehicle was, and where the model has it in every stretch."""
    x, y = (fit.model.channels.index(name) for name in ("x", "y"))
    errors = left_of(task, fit)
    picked = worst(errors)
    figure, axes = _tiles(len(picked), 4.8)
    _say_which(figure, picked, errors)
    for i, axis in zip(picked, axes, strict=True):
        log = task.logs[i]
        axis.plot(log.measured["x"], log.measured["y"], ".", ms=2, color="0.7", label="measured")
        of_log = fit.segments.log == i
        live = (fit.segments.live > 0) & (fit.segments.rows >= 0)
        predicted = fit.segments.seen - fit.sums.residual
        for k, (row, drawn) in enumerate(zip(predicted[of_log], live[of_log], strict=True)):
            axis.plot(row[drawn, x], row[drawn, y], color="C0" if k % 2 else "C1", lw=1.2)
        axis.set_title(f"{log.name}: stretches of the model in colour", fontsize="medium")
        axis.set(**PLANE)
    return figure


def predictions(logs: Sequence[Prediction]) -> Figure:
    """How the error of predictions grows."""
    errors = [prediction.rms for prediction in logs]
    picked = worst(errors)
    figure, axes = _tiles(len(picked), 3.4)
    _say_which(figure, picked, errors)
    for prediction, axis in zip([logs[i] for i in picked], axes, strict=True):
        for t, error in zip(prediction.t, prediction.errors, strict=True):
            there = np.isfinite(error)  # a line goes on over rows in which nothing was measured
            axis.plot(t[there], 1e3 * error[there], color="C0", lw=0.5, alpha=0.6)
        axis.set_title(f"{prediction.log}: {prediction.windows} windows", fontsize="medium")
        axis.set(xlabel="s since the prediction began", ylabel="recorded to predicted [mm]")
        axis.set(xlim=(0, prediction.horizon), ylim=(0, None))
    return figure


def drive(suggested: Drive) -> Figure:
    """Commands of a suggested drive and where it leads."""
    figure = plot.sheet((11, 4))
    left, right = figure.subplots(1, 2, width_ratios=(2, 1))
    for name, u in zip(suggested.commands, suggested.inputs.T, strict=True):
        left.plot(suggested.t, u, lw=0.8, label=name)
    left.set(xlabel="t [s]", ylabel="command")
    left.legend(fontsize="small")
    right.plot(*suggested.path.T, lw=1)
    right.plot(*suggested.path[0], "o", color="C2", label="start")
    right.plot(*suggested.path[-1], "s", color="C3", label="end")
    right.set(**PLANE)
    right.legend(fontsize="small")
    return figure
