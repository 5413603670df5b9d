"""What a sweep shows, drawn: maps, differences, cuts, distributions, sensitivities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from agvjax.draw import plot
from agvjax.metric_units import units_in

from ..io.pictures import Drawing
from .design import Axis, Design
from .findings import Index, cut, interval
from .results import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_MAPS = 6  # maps of so many metrics
CUTS = 6  # axes shown
WIDE = 8  # ratio from which colours are logarithmic
MAPS = 4  # controllers beside each other in a figure


def every(
    results: Results, bounds: Mapping[str, float], which: np.ndarray, indices: Mapping[str, Mapping[str, list[Index]]]
) -> dict[str, Drawing]:
    """All figures that this design has, by name, not yet drawn."""
    figures: dict[str, Drawing] = {}
    plan, mapped = results.design, len(_mapped(results.design))
    first, *_ = metrics = list(results.metrics)
    if mapped == 2:
        figures |= {f"map_{metric}": partial(maps, results, metric, which) for metric in metrics[:MOST_MAPS]}
        if which.any():
            figures["map_failures"] = partial(failure_map, results, which)
        others = range(1, len(results.names))
        figures |= {f"difference_{i}_{first}": partial(difference, results, first, which, i) for i in others}
    if mapped == 1 and plan.samples > 1:
        figures["failures"] = partial(failures_along, results, which)
    figures["cuts"] = partial(cuts, results, metrics[:3], bounds)
    if plan.sampled:
        figures["distributions"] = partial(distributions, results, bounds)
    for i, of_metric in enumerate(indices.values()):
        if any(of_metric.values()):
            figures[f"sensitivity_{i}"] = partial(
                sensitivity, of_metric, plan.method, units_in(results.config.scenario)
            )
    return figures


def _with_unit(results: Results, metric: str) -> str:
    return f"{metric} [{units_in(results.config.scenario)[metric]}]"


def label(plan: Design, axis: Axis) -> str:
    """What is written along an axis: its first leaf and unit, and what moves with it."""
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
    whole = np.moveaxis(results.design.whole(values), _mapped(results.design), (0, 1))
    return how(whole.reshape(*whole.shape[:2], -1), axis=-1)


def _mapped(plan: Design) -> tuple[int, ...]:
    """The first two axes of the grid with more than one point, or fewer."""
    return tuple(i for i, axis in enumerate(plan.grid) if axis.points > 1)[:2]


def _panel(axes: Axes, results: Results, picture: np.ndarray, bad: np.ndarray, norm: Any, colours: str) -> None:
    """One map: the picture, where something fails, and nominal."""
    plan = results.design
    first, second = (plan.grid[i] for i in _mapped(plan))
    (x, x0), (y, y0) = scale(plan, first), scale(plan, second)
    axes.pcolormesh(x, y, plot.shown(picture).T, shading="nearest", norm=norm, cmap=colours, rasterized=True)
    axes.set_facecolor("0.25")  # where every run diverged, or came to more than a figure can show
    if bad.any() and not bad.all():
        axes.contour(x, y, bad.T.astype(float), levels=[0.5], colors="red", linewidths=1.5)
    axes.plot(x0, y0, "*", ms=12, mfc="white", mec="black")
    axes.set(xlabel=label(plan, first), ylabel=label(plan, second))


def _maps(
    results: Results, maps: Mapping[str, tuple[np.ndarray, np.ndarray]], norm: Any, colours: str, **bar: Any
) -> Figure:
    """Maps beside each other with one colour bar: of each, by its title, the picture and where something fails."""
    from matplotlib.cm import ScalarMappable

    figure = plot.sheet((4.6 * len(maps) + 1, 4.2))
    panels = np.ravel(figure.subplots(1, len(maps), squeeze=False))
    for axes, (title, (picture, bad)) in zip(panels, maps.items(), strict=True):
        _panel(axes, results, picture, bad, norm, colours)
        axes.set_title(title, fontsize=10)
    figure.colorbar(ScalarMappable(norm, colours), ax=panels, **bar)
    return figure


def maps(results: Results, metric: str, which: np.ndarray) -> Figure:
    """Mean of a metric over the samples, on the first two axes; red: beyond it some run fails; star: nominal."""
    from matplotlib.colors import LogNorm, Normalize

    pictures = {}
    for name, values, failed in zip(results.names[:MAPS], results.metrics[metric], which, strict=False):
        bad = _on_map(results, failed, np.any)
        some = ": everywhere a run fails" if bad.all() else "" if bad.any() else ": nothing fails"
        pictures[name + some] = _on_map(results, values, _finite_mean), bad
    finite = np.concatenate([picture[np.isfinite(plot.shown(picture))] for picture, _ in pictures.values()])
    low, high = (finite.min(), np.quantile(finite, 0.98)) if finite.size else (0.0, 1.0)
    high = max(high, low + 1e-3 * abs(low) + 1e-12)  # also of a metric that is the same everywhere
    norm = LogNorm(low, high) if high > WIDE * low > 0 else Normalize(low, high)
    return _maps(results, pictures, norm, "viridis", label=_with_unit(results, metric), extend="max")


def failure_map(results: Results, which: np.ndarray) -> Figure:
    """Share of the runs that fail, on the first two axes."""
    from matplotlib.colors import Normalize

    shares = {name: _on_map(results, bad, np.mean) for name, bad in zip(results.names[:MAPS], which, strict=False)}
    pictures = {name: (share, share > 0) for name, share in shares.items()}
    return _maps(results, pictures, Normalize(0, 1), "magma", label="share of runs that fail")


def failures_along(results: Results, which: np.ndarray) -> Figure:
    """Probability of failure along the one axis of a grid, over its samples, with the 95 % interval of each point."""
    plan = results.design
    (place,) = _mapped(plan)
    axis = plan.grid[place]
    x, nominal = scale(plan, axis)
    figure = plot.sheet((6.4, 3.6))
    axes = figure.subplots()
    for i, (name, bad) in enumerate(zip(results.names, which, strict=True)):
        each = np.moveaxis(plan.whole(bad), place, 0).reshape(axis.points, -1)
        ends = np.array([interval(int(row.sum()), row.size) for row in each])
        axes.fill_between(x, ends[:, 0], ends[:, 1], color=f"C{i}", alpha=0.25, lw=0)
        axes.plot(x, each.mean(axis=1), color=f"C{i}", label=name)
    axes.axvline(nominal, color="0.6", lw=0.8)
    axes.set(xlabel=label(plan, axis), ylabel="share that fails, 95 % interval")
    axes.legend(fontsize=8)
    axes.grid(alpha=0.25)
    return figure


def difference(results: Results, metric: str, which: np.ndarray, other: int) -> Figure:
    """Change of a metric from the first controller to another, where neither diverges."""
    from matplotlib.colors import CenteredNorm

    first, second = (_on_map(results, results.metrics[metric][i], _finite_mean) for i in (0, other))
    with np.errstate(invalid="ignore"):
        change = 100 * (second / first - 1)
    finite = np.abs(change[np.isfinite(plot.shown(change))])
    reach = max(float(np.quantile(finite, 0.98)), 1e-9) if finite.size else 1.0
    title = f"{results.names[other]} against {results.names[0]}"
    pictures = {title: (change, _on_map(results, which[0] | which[other], np.any))}
    norm = CenteredNorm(0.0, reach)
    return _maps(results, pictures, norm, "RdBu_r", label=f"change of {metric} [%]", extend="both")


def _finite_mean(values: np.ndarray, axis: int) -> np.ndarray:
    """Mean of the runs that have a value; infinite where none has."""
    fine = np.isfinite(values)
    count = fine.sum(axis)
    return np.where(count > 0, np.where(fine, values, 0.0).sum(axis) / np.maximum(count, 1), np.inf)


def cuts(results: Results, metrics: Sequence[str], bounds: Mapping[str, float]) -> Figure:
    """Metrics along every axis: median, the band of 90 % and the worst over all else."""
    plan = results.design
    shares = plan.shares(0, plan.size)
    every = _telling(results, metrics[0], shares)
    figure = plot.sheet((max(3.6 * len(every) + 0.6, 6.4), 2.9 * len(metrics) + 0.5))
    panels = figure.subplots(len(metrics), len(every), squeeze=False)
    for row, metric in zip(panels, metrics, strict=True):
        for axes, (place, axis) in zip(row, every, strict=True):
            for i, name in enumerate(results.names):
                at, statistics = cut(results, results.metrics[metric][i], place, shares)
                low, median, high, largest = plot.shown(statistics).T
                x, _ = scale(plan, axis, at)
                axes.fill_between(x, low, high, color=f"C{i}", alpha=0.2, lw=0)
                axes.plot(x, median, color=f"C{i}", lw=1.4, label=name)
                axes.plot(x, largest, color=f"C{i}", lw=0.8, ls=":")
            axes.axvline(scale(plan, axis)[1], color="0.6", lw=0.8, zorder=0)
            if np.isfinite(plot.shown(bounds.get(metric, np.nan))):
                axes.axhline(bounds[metric], color="red", lw=0.8)
            axes.grid(alpha=0.25)
            axes.set_xlabel(label(plan, axis), fontsize=8)
        row[0].set_ylabel(_with_unit(results, metric), fontsize=9)
    panels[0][0].legend(fontsize=7)
    figure.suptitle(
        "median, 90 % band and largest (dotted) over all other axes; grey: nominal; red: failure", fontsize=9
    )
    return figure


def _telling(results: Results, metric: str, shares: np.ndarray) -> list[tuple[int, Axis]]:
    """The axes to show, each with its place: those of the grid, then the sampled ones that move the median most."""
    plan = results.design

    def swing(place: int) -> float:
        middle = cut(results, results.metrics[metric][0], place, shares)[1][:, 1]
        return -float(np.ptp(middle)) if np.all(np.isfinite(middle)) else -np.inf

    axes = list(enumerate((*plan.grid, *plan.sampled)))
    count = len(plan.grid)
    return [*axes[:count], *sorted(axes[count:], key=lambda numbered: swing(numbered[0]))][:CUTS]


def distributions(results: Results, bounds: Mapping[str, float]) -> Figure:
    """Share of the runs beyond a value, for every metric and controller."""
    columns, rows = min(3, len(results.metrics)), -(-len(results.metrics) // 3)
    figure = plot.sheet((3.6 * columns + 0.4, 2.8 * rows))
    panels = np.ravel(figure.subplots(rows, columns, squeeze=False))
    for axes, (metric, of_each) in zip(panels, results.metrics.items(), strict=False):
        for name, values in zip(results.names, np.sort(of_each), strict=True):
            places = np.unique(np.linspace(0, values.size - 1, 2000).astype(int))
            places = places[np.isfinite(plot.shown(values[places]))]
            axes.semilogy(values[places], 1 - places / values.size, lw=1.3, label=name)
        if np.isfinite(plot.shown(bounds.get(metric, np.nan))):
            axes.axvline(bounds[metric], color="red", lw=0.8)
        axes.set(xlabel=_with_unit(results, metric))
        axes.grid(alpha=0.25)
    for axes in panels[len(results.metrics) :]:
        axes.set_visible(False)
    panels[0].legend(fontsize=7)
    panels[0].set_ylabel("share of runs beyond")
    return figure


def sensitivity(of_metric: Mapping[str, list[Index]], method: str, units: Mapping[str, str]) -> Figure:
    """Indices of every metric: bars of first and total order, or mean and spread of the elementary effects."""
    names = {"saltelli": ("first order", "total"), "morris": ("mean |effect|", "its standard deviation")}[method]
    rows = [(metric, indices) for metric, indices in of_metric.items() if indices]
    count = max(len(indices) for _, indices in rows)
    figure = plot.sheet((4.0 * len(rows), 0.32 * count + 1.3))
    panels = np.ravel(figure.subplots(1, len(rows), squeeze=False, sharey=True))
    for axes, (metric, indices) in zip(panels, rows, strict=True):
        place = np.arange(len(indices))
        axes.barh(place + 0.2, [x.first for x in indices], 0.38, xerr=[x.first_error for x in indices], label=names[0])
        errors = None if method == "morris" else [x.total_error for x in indices]
        axes.barh(place - 0.2, [x.total for x in indices], 0.38, xerr=errors, label=names[1])
        axes.set_yticks(place, [x.axis for x in indices], fontsize=7)
        axes.set_title(metric if method == "saltelli" else f"{metric} [{units[metric]}]", fontsize=9)
        axes.grid(alpha=0.25, axis="x")
    panels[0].legend(fontsize=7)
    return figure
