"""The report of a sweep, in Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from agvjax.metric_units import units_in

from ..io import statements
from ..io.pages import grid, meanings, picture
from ..tune.meanings import of_metrics
from .design import SENSITIVITY
from .findings import QUANTILES, worst
from .radius import Radius
from .results import Results
from .verdict import SweepVerdict

WORST = 10  # scenarios listed
METRIC_TABLE, LARGEST_TABLE = "Every metric", "The scenarios with the largest values"
CAPTIONS = {  # by how the name of a figure begins
    "map_failures": "Share of runs that fail, over two axes",
    "map_": "Mean {} over two axes",
    "difference_": "Difference between two controllers, over two axes",
    "failures": "Share of runs that fail, along the axis",
    "cuts": "Metrics along every axis: median, 90 % band and largest value over all other axes; failures in red",
    "distributions": "Distributions of the metrics over the scenarios",
    "sensitivity_": "Which axes the metrics depend on",
}


def page(results: Results, judged: SweepVerdict, figures: Sequence[str], folder: str) -> str:
    """The whole report."""
    first, *others = [picture(name, f"{_caption(name)}.") for name in figures]
    blocks = ["# Where do the gains fail?", _what(results), *_radii(results, judged)[:1], _failures(results, judged)]
    blocks += [
        *_words(results, judged),
        first,
        *(["## How far may the parameters deviate?", *further] if (further := _radii(results, judged)[1:]) else []),
    ]
    blocks += [*(["## Further figures", *others] if others else []), f"## {METRIC_TABLE}", _metrics(results, judged)]
    blocks += [meanings(of_metrics(tuple(results.metrics), results.config.criteria))]
    blocks += [*_sensitivity(results, judged), f"## {LARGEST_TABLE}", *_largest(results, judged, folder)]
    return "\n\n".join(blocks) + "\n"


def _caption(file: str) -> str:
    name = file.removesuffix(".png")
    begins = next(begin for begin in CAPTIONS if name.startswith(begin))
    return CAPTIONS[begins].format(name.removeprefix(begins))


def brief(results: Results, judged: SweepVerdict, folder: str) -> str:
    """For a terminal: what fails, how far nothing was found to, and how to look at the largest value."""
    listed, radii = _listed(results, judged)[1], _radii(results, judged)[:1]
    again = f"The largest value: `agvjax simulate --from {folder} --index {listed[0][0]}`."
    return "\n\n".join([_failures(results, judged), *radii, again])


def _what(results: Results) -> str:
    plan = results.design
    axes = [f"{a.name} ({a.points} points)" for a in plan.grid] + [f"{a.name} (sampled)" for a in plan.sampled]
    each = f", {plan.samples} samples ({plan.method}) at every node" if plan.sampled and plan.grid else ""
    drawn = f"; design: {plan.method}" if plan.sampled and not plan.grid else ""
    return (
        f"{plan.size} scenarios{each}{drawn}, seed {plan.seed}, {len(results.names)} controller(s), step"
        f" {results.config.sweep.dt:g} s. Axes: {'; '.join(axes)}."
    )


def _failures(results: Results, judged: SweepVerdict) -> str:
    plan = results.design
    drawn = _drawn(results)
    header = ["controller", "failed", "of", "diverged", "share", f"{statements.INTERVAL} of the probability"]
    rows = [
        [name, f.failed, f.runs, f.diverged, f"{f.share:.4%}", f"{f.low:.4%} to {f.high:.4%}"]
        for name, f in zip(results.names, judged.failures, strict=True)
    ]
    shown, units = slice(None if drawn else -1), units_in(results.config.scenario)
    rule = ", or ".join(f"{name} exceeds {bound:.5g} {units[name]}" for name, bound in judged.bounds.items())
    passed = f", or if {rule} (multiples are of the nominal run with the first controller)" if rule else ""
    note = f"A run fails if it diverges{passed}."
    if drawn and plan.method != "random":
        note += " The interval is that of independent draws; with evenly spread ones it is conservative."
    if not drawn:
        note += " The share is that of this design, not a probability."
    return f"{grid(header[shown], [row[shown] for row in rows])}\n\n{note}"


def _drawn(results: Results) -> bool:
    """Whether the share of failures is that of a probability: nothing stands on a grid."""
    plan = results.design
    return bool(plan.sampled) and not plan.grid and plan.method not in SENSITIVITY


def _random(results: Results) -> bool:
    """Whether all scenarios are independent draws."""
    return _drawn(results) and results.design.method == "random"


def _words(results: Results, judged: SweepVerdict) -> list[str]:
    """What the claims of this report mean."""
    kinds = [statements.of_draws(results.design.size)] if _random(results) else []
    kinds += [statements.of_kind(statements.PROBABLE)] if _drawn(results) else []
    kinds += [statements.of_kind(statements.FOUND)] if judged.radii else []
    return [statements.said(*kinds)] if kinds else []


def _radii(results: Results, judged: SweepVerdict) -> list[str]:
    lines = []
    for name, r in zip(results.names, judged.radii, strict=False):  # none, or one of each controller
        if r.radius >= 1:
            text = "no failure was found anywhere in the axes' ranges"
        elif r.failure == 0:
            text = "the nominal run itself fails, at the step of the sweep (sweep.dt)"
        else:
            near = ", ".join(f"{leaf} = {_shown(value)}" for leaf, value in r.scenario.items())
            text = f"no failure was found up to {r.radius:.3g} of the way to the ends;"
            text += f" one lies at {r.failure:.3g}: {near}"
        lines.append(f"* {name}: {text} ({r.searches} searches, {r.samples} samples).")
    blocks = [judged.unmoved] if judged.unmoved else []
    if not lines:
        return blocks
    ends = [{target: f"{low:.4g} to {high:.4g}" for target, (low, high) in r.ends.items()} for r in judged.radii]
    rows = [[target, *(each[target] for each in ends)] for target in ends[0]]
    box = grid(["leaf", *results.names], rows)
    return ["\n".join(lines), "The box in which no failure was found:", box, *blocks]


def _metrics(results: Results, judged: SweepVerdict) -> str:
    header = ["metric", "unit", "controller", "nominal", "mean of finite values", "5 %", "median", "95 %"]
    header.append(statements.worst_of(results.design.size) if _random(results) else "largest of this design")
    rows, units = [], units_in(results.config.scenario)
    for metric, of_each in results.metrics.items():
        for name, nominal, values in zip(results.names, judged.nominal, of_each, strict=True):
            finite = values[np.isfinite(values)]
            with np.errstate(over="ignore"):  # of numbers near the largest there is: infinite
                mean = finite.mean() if finite.size else np.inf
            numbers = (nominal[metric], mean, *np.quantile(values, QUANTILES, method="nearest"), values.max())
            rows.append([metric, units[metric], name, *map(float, numbers), values.size - finite.size])
    return grid([*header, "not finite (not in the mean)"], rows)


def _sensitivity(results: Results, judged: SweepVerdict) -> list[str]:
    method = results.design.method
    if not any(any(of_metric.values()) for of_metric in judged.indices.values()):
        none = "No sensitivities: runs diverged or did not settle, so some metrics are infinite."
        return [none] if method in SENSITIVITY else []
    names = ["axis", "first order", "±", "total", "±"]
    if method == "morris":
        names = ["axis", "mean of |effect|", "±", "standard deviation"]
    blocks = ["## Sensitivities: which axes the metrics depend on"]
    for controller, of_metric in judged.indices.items():
        for metric, indices in of_metric.items():
            if indices:
                blocks += [f"{controller}, {metric}:", grid(names, [index[: len(names)] for index in indices])]
            else:
                blocks.append(f"{controller}, {metric}: none, since some runs have no finite value.")
    return blocks


def _listed(results: Results, judged: SweepVerdict) -> tuple[str, list[np.ndarray]]:
    """The metric by which scenarios are listed, and by controller the numbers of those where it is largest."""
    metric = next(iter(judged.bounds or results.metrics))
    return metric, [worst(values, WORST) for values in results.metrics[metric]]


def _largest(results: Results, judged: SweepVerdict, folder: str) -> list[str]:
    (metric, listed), blocks = _listed(results, judged), []
    for i, (name, numbers) in enumerate(zip(results.names, listed, strict=True)):
        rows = [
            [n, float(results.metrics[metric][i, n]), "yes" if judged.which[i, n] else "no"]
            + [_shown(value[n]) for value in results.leaves.values()]
            for n in numbers
        ]
        blocks += [f"{name}, by {metric}:", grid(["index", metric, "failed", *results.leaves], rows)]
    return [*blocks, f"`agvjax simulate --from {folder} --index {listed[0][0]}` simulates one of them again."]


def _shown(value: Any) -> str:
    return ", ".join(f"{x:.4g}" for x in np.ravel(value))


def as_json(results: Results, judged: SweepVerdict) -> dict[str, Any]:
    """`findings.json`."""
    listed = _listed(results, judged)[1]
    return {
        name: {
            "nominal": judged.nominal[i],
            "bounds": judged.bounds,
            **judged.failures[i]._asdict(),
            "worst": listed[i].tolist(),
            "radius": _plain(judged.radii[i]) if judged.radii else None,
            "indices": {m: [x._asdict() for x in rows] for m, rows in judged.indices.get(name, {}).items()},
        }
        for i, name in enumerate(results.names)
    }


def _plain(radius: Radius) -> dict[str, Any]:
    return radius._asdict() | {"scenario": {name: np.asarray(x).tolist() for name, x in radius.scenario.items()}}
