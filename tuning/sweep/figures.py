"""What a sweep shows, drawn: maps, differences, cuts, distributions, sensitivities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import CenteredNorm, LogNorm, Normalize
from matplotlib.figure import Figure

from agvjax.metric_table import METRICS

from .design import Axis, Design
from .findings import Index, cut, interval
from .results import Results

MOST_MAPS = 6  # maps of so many metrics
CUTS = 6  # axes shown
WIDE = 8  # ratio from which colours are logarithmic
MAPS = 4  # controllers beside each other in a figure


def every(
    results: Results, bounds: Mapping[str, float], which: np.ndarray, indices: Mapping[str, Mapping[str, list[Index]]]
) -> dict[str, Figure]:
    """All that this design has, by name."""
    drawn: dict[str, Figure] = {}
    first, *_ = metrics = list(results.metrics)
    if len(_mapped(results.design)) == 2:
        drawn |= {f"map_{metric}": maps(results, metric, which) for metric in metrics[:MOST_MAPS]}
        if which.any():
            drawn["map_failures"] = failure_map(results, which)
        others = range(1, len(results.names))
        drawn |= {f"difference_{i}_{first}": difference(results, first, which, i) for i in others}
    if len(_mapped(results.design)) == 1 and results.design.samples > 1:
        drawn["failures"] = failures_along(results, which)
    drawn["cuts"] = cuts(results, metrics[:3], bounds)
    if results.design.sampled:
        drawn["distributions"] = distributions(results, bounds)
    for i, found in enumerate(indices.values()):
        if any(found.values()):
            drawn[f"sensitivity_{i}"] = sensitivity(found, results.design.method)
    return drawn


def label(plan: Design, axis: Axis) -> str:
    """Of an axis: its first leaf and unit, and what moves with it."""
    first, *more = axis.targets
    text = f"{first.name} [{plan.unit(first.leaf)}]"
    return text + "".join(f"\nwith {target.name}" for target in more)


def scale(plan: Design, axis: Axis, places: Any = None) -> tuple[np.ndarray, float]:
    """Values along an axis, of its first leaf (its first element), and the nominal one."""
    target = axis.targets[0]
    values = plan.value(target, axis.places if places is None else places)
    return values.reshape(len(values), -1)[:, 0], float(np.ravel(plan.nominal_of(target))[0])


def _on_map(results: Results, values: np.ndarray, how: Any) -> np.ndarray:
    """Values (N,) on the two axes of a map, over all else."""
    plan = results.design
    whole = np.moveaxis(values.reshape(*plan.shape, plan.samples), _mapped(plan), (0, 1))
    return how(whole.reshape(*whole.shape[:2], -1), axis=-1)


def _mapped(plan: Design) -> tuple[int, ...]:
    """The first two axes of the grid with more than one point, or fewer."""
    return tuple(i for i, axis in enumerate(plan.grid) if axis.points > 1)[:2]


def _panel(axes: Any, results: Results, picture: np.ndarray, bad: np.ndarray, norm: Any, colours: str) -> Any:
    """One map: the picture, where something fails, and nominal."""
    plan = results.design
    first, second = (plan.grid[i] for i in _mapped(plan))
    (x, x0), (y, y0) = scale(plan, first), scale(plan, second)
    shown = np.where(np.isfinite(picture), picture, np.nan)
    drawn = axes.pcolormesh(x, y, shown.T, shading="nearest", norm=norm, cmap=colours, rasterized=True)
    axes.set_facecolor("0.25")  # where every run diverged
    if bad.any() and not bad.all():
        axes.contour(x, y, bad.T.astype(float), levels=[0.5], colors="red", linewidths=1.5)
    axes.plot(x0, y0, "*", ms=12, mfc="white", mec="black")
    axes.set(xlabel=label(plan, first), ylabel=label(plan, second))
    return drawn


def maps(results: Results, metric: str, which: np.ndarray) -> Figure:
    """Mean of a metric over the samples, on the first two axes; red: beyond it some run fails; star: nominal."""
    pictures = [_on_map(results, values, _finite_mean) for values in results.metrics[metric][:MAPS]]
    finite = np.concatenate([p[np.isfinite(p)] for p in pictures])
    low, high = (finite.min(), np.quantile(finite, 0.98)) if finite.size else (0.0, 1.0)
    high = max(high, low + 1e-3 * abs(low) + 1e-12)  # also of a metric that is the same everywhere
    norm = LogNorm(low, high) if high > WIDE * low > 0 else Normalize(low, high)
    figure = Figure(figsize=(4.6 * len(pictures) + 1, 4.2), layout="constrained")
    panels = np.ravel(figure.subplots(1, len(pictures), squeeze=False))
    for i, (axes, picture) in enumerate(zip(panels, pictures, strict=True)):
        bad = _on_map(results, which[i], np.any)
        _panel(axes, results, picture, bad, norm, "viridis")
        some = ": everywhere a run fails" if bad.all() else "" if bad.any() else ": nothing fails"
        axes.set_title(results.names[i] + some, fontsize=10)
    figure.colorbar(
        ScalarMappable(norm, "viridis"), ax=panels, label=f"{metric} [{METRICS[metric].unit}]", extend="max"
    )
    return figure


def failure_map(results: Results, which: np.ndarray) -> Figure:
    """Share of the runs that fail, on the first two axes."""
    figure = Figure(figsize=(4.6 * len(which[:MAPS]) + 1, 4.2), layout="constrained")
    panels = np.ravel(figure.subplots(1, len(which[:MAPS]), squeeze=False))
    for i, axes in enumerate(panels):
        share = _on_map(results, which[i], np.mean)
        _panel(axes, results, share, share > 0, Normalize(0, 1), "magma")
        axes.set_title(results.names[i], fontsize=10)
    figure.colorbar(ScalarMappable(Normalize(0, 1), "magma"), ax=panels, label="share of runs that fail")
    return figure


def failures_along(results: Results, which: np.ndarray) -> Figure:
    """Probability of failure along the one axis of a grid, over its samples, with the 95 % interval of each point."""
    plan = results.design
    axis = plan.grid[_mapped(plan)[0]]
    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.subplots()
    for i, (name, bad) in enumerate(zip(results.names, which, strict=True)):
        each = np.moveaxis(bad.reshape(*plan.shape, plan.samples), _mapped(plan)[0], 0).reshape(axis.points, -1)
        ends = np.array([interval(int(row.sum()), row.size) for row in each])
        axes.fill_between(scale(plan, axis)[0], ends[:, 0], ends[:, 1], color=f"C{i % 10}", alpha=0.25, lw=0)
        axes.plot(scale(plan, axis)[0], each.mean(axis=1), color=f"C{i % 10}", label=name)
    axes.axvline(scale(plan, axis)[1], color="0.6", lw=0.8)
    axes.set(xlabel=label(plan, axis), ylabel="share that fails, 95 % interval")
    axes.legend(fontsize=8)
    axes.grid(alpha=0.25)
    return figure


def difference(results: Results, metric: str, which: np.ndarray, other: int) -> Figure:
    """Change of a metric from the first controller to another, where neither diverges."""
    first, second = (_on_map(results, results.metrics[metric][i], _finite_mean) for i in (0, other))
    with np.errstate(invalid="ignore"):
        change = 100 * (second / first - 1)
    figure = Figure(figsize=(5.8, 4.2), layout="constrained")
    axes = figure.subplots()
    bad = _on_map(results, which[0] | which[other], np.any)
    finite = np.abs(change[np.isfinite(change)])
    reach = max(float(np.quantile(finite, 0.98)), 1e-9) if finite.size else 1.0
    drawn = _panel(axes, results, change, bad, CenteredNorm(0.0, reach), "RdBu_r")
    figure.colorbar(drawn, ax=axes, label=f"change of {metric} [%]", extend="both")
    axes.set_title(f"{results.names[other]} against {results.names[0]}", fontsize=10)
    return figure


def _finite_mean(values: np.ndarray, axis: int) -> np.ndarray:
    """Mean of the runs that have a value; infinite where none has."""
    fine = np.isfinite(values)
    count = fine.sum(axis)
    return np.where(count > 0, np.where(fine, values, 0.0).sum(axis) / np.maximum(count, 1), np.inf)


def cuts(results: Results, metrics: Sequence[str], bounds: Mapping[str, float]) -> Figure:
    """Metrics along every axis: median, the band of 90 % and the worst over all else."""
    plan, colours = results.design, [f"C{i}" for i in range(10)]
    shares = plan.shares(0, plan.size)
    every = _telling(results, metrics[0], shares)
    figure = Figure(figsize=(max(3.6 * len(every) + 0.6, 6.4), 2.9 * len(metrics) + 0.5), layout="constrained")
    panels = figure.subplots(len(metrics), len(every), squeeze=False)
    for row, metric in zip(panels, metrics, strict=True):
        for axes, (place, axis) in zip(row, every, strict=True):
            axes.axvline(scale(plan, axis)[1], color="0.6", lw=0.8, zorder=0)
            for i, name in enumerate(results.names):
                at, found = cut(results, results.metrics[metric][i], place, shares)
                found = np.where(np.isfinite(found), found, np.nan)
                x, _ = scale(plan, axis, at)
                axes.fill_between(x, found[:, 0], found[:, 2], color=colours[i % 10], alpha=0.2, lw=0)
                axes.plot(x, found[:, 1], color=colours[i % 10], lw=1.4, label=name)
                axes.plot(x, found[:, 3], color=colours[i % 10], lw=0.8, ls=":")
            if metric in bounds:
                axes.axhline(bounds[metric], color="red", lw=0.8)
            axes.grid(alpha=0.25)
            axes.set_xlabel(label(plan, axis), fontsize=8)
        row[0].set_ylabel(f"{metric} [{METRICS[metric].unit}]", fontsize=9)
    panels[0][0].legend(fontsize=7)
    figure.suptitle("median, 90 % band and worst (dotted) over all else; grey: nominal; red: failure", fontsize=9)
    return figure


def _telling(results: Results, metric: str, shares: np.ndarray) -> list[tuple[int, Axis]]:
    """The axes to show, each with its place: those of the grid, then the sampled ones that move the median most."""
    plan = results.design

    def swing(place: int) -> float:
        middle = cut(results, results.metrics[metric][0], place, shares)[1][:, 1]
        return -float(np.ptp(middle)) if np.all(np.isfinite(middle)) else -np.inf

    first, every = range(len(plan.grid)), (*plan.grid, *plan.sampled)
    rest = sorted(range(len(plan.grid), len(every)), key=swing)
    return [(place, every[place]) for place in (*first, *rest)][:CUTS]


def distributions(results: Results, bounds: Mapping[str, float]) -> Figure:
    """Share of the runs beyond a value, for every metric and controller."""
    metrics = list(results.metrics)
    figure = Figure(figsize=(3.6 * min(3, len(metrics)) + 0.4, 2.8 * -(-len(metrics) // 3)), layout="constrained")
    panels = np.ravel(figure.subplots(-(-len(metrics) // 3), min(3, len(metrics)), squeeze=False))
    for axes, metric in zip(panels, metrics, strict=False):
        for i, name in enumerate(results.names):
            values = np.sort(results.metrics[metric][i])
            shown = np.unique(np.linspace(0, values.size - 1, 2000).astype(int))
            beyond = 1 - shown / values.size
            finite = np.isfinite(values[shown])
            axes.semilogy(values[shown][finite], beyond[finite], lw=1.3, color=f"C{i % 10}", label=name)
        if metric in bounds:
            axes.axvline(bounds[metric], color="red", lw=0.8)
        axes.set(xlabel=f"{metric} [{METRICS[metric].unit}]")
        axes.grid(alpha=0.25)
    for axes in panels[len(metrics) :]:
        axes.set_visible(False)
    panels[0].legend(fontsize=7)
    panels[0].set_ylabel("share of runs beyond")
    return figure


def sensitivity(found: Mapping[str, list[Index]], method: str) -> Figure:
    """Indices of every metric: bars of first and total order, or mean and spread of the elementary effects."""
    names = {"saltelli": ("first order", "total"), "morris": ("mean |effect|", "its standard deviation")}[method]
    rows = [(metric, indices) for metric, indices in found.items() if indices]
    count = max(len(indices) for _, indices in rows)
    figure = Figure(figsize=(4.0 * len(rows), 0.32 * count + 1.3), layout="constrained")
    panels = np.ravel(figure.subplots(1, len(rows), squeeze=False, sharey=True))
    for axes, (metric, indices) in zip(panels, rows, strict=True):
        place = np.arange(len(indices))
        axes.barh(place + 0.2, [x.first for x in indices], 0.38, xerr=[x.first_error for x in indices], label=names[0])
        errors = None if method == "morris" else [x.total_error for x in indices]
        axes.barh(place - 0.2, [x.total for x in indices], 0.38, xerr=errors, label=names[1])
        axes.set_yticks(place, [x.axis for x in indices], fontsize=7)
        axes.set_title(metric if method == "saltelli" else f"{metric} [{METRICS[metric].unit}]", fontsize=9)
        axes.grid(alpha=0.25, axis="x")
    panels[0].legend(fontsize=7)
    return figure
