"""The report of a sweep, in Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from agvjax.metric_table import METRICS

from ..io.pages import grid
from .design import SENSITIVITY
from .findings import worst
from .results import Results
from .verdict import SweepVerdict

WORST = 10  # scenarios listed


def page(results: Results, judged: SweepVerdict, figures: Sequence[str], folder: str) -> str:
    """The whole report."""
    plan = results.design
    lines = ["# Sweep", "", _what(results), "", "## Does it fail?", "", _failures(results, judged), ""]
    lines += ["## How far may it drift?", ""]
    lines += [*_radii(results, judged), ""] if judged.radii else []
    lines += [judged.unmoved, ""] if judged.unmoved else []
    lines += ["## What it looks like", ""]
    for name in figures:
        lines += [f"![{name.removesuffix('.png')}]({name})", ""]
    lines += ["## The metrics", "", _metrics(results, judged), ""]
    if any(any(rows.values()) for rows in judged.indices.values()):
        lines += ["## What they hang on", "", *_sensitivity(results, judged), ""]
    elif plan.method in SENSITIVITY:
        lines += ["No sensitivities: runs diverged or did not settle, and an infinite metric has none.", ""]
    lines += ["## The worst scenarios", "", *_worst(results, judged, folder)]
    return "\n".join(lines) + "\n"


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
    drawn = bool(results.design.sampled) and not results.design.grid and results.design.method not in SENSITIVITY
    rows = []
    for name, f in zip(results.names, judged.failures, strict=True):
        share = f"{f.share:.4%}"
        rows.append([name, f.failed, f.runs, f.diverged, share, *([f"{f.low:.4%} to {f.high:.4%}"] if drawn else [])])
    header = [
        "controller",
        "failed",
        "of",
        "diverged",
        "share",
        *(["95 % interval of the probability"] if drawn else []),
    ]
    rule = ", or ".join(f"{name} passes {bound:.5g} {METRICS[name].unit}" for name, bound in judged.bounds.items())
    relative = " (multiples are of the nominal run with the first controller)" if rule else ""
    note = f"\n\nA run fails if it diverges{', or if ' + rule if rule else ''}{relative}."
    if drawn and results.design.method != "random":
        note += " The interval is that of independent draws; evenly spread ones are surer."
    if not drawn:
        note += " The share is that of this design, not a probability."
    return grid(header, rows) + note


def _radii(results: Results, judged: SweepVerdict) -> list[str]:
    lines = []
    for name, r in zip(results.names, judged.radii, strict=True):
        if r.radius >= 1:
            said = "nothing was found to fail anywhere in the axes' ranges"
        elif r.failure == 0:
            said = "the nominal run itself fails"
        else:
            near = ", ".join(f"{leaf} = {_shown(value)}" for leaf, value in r.scenario.items())
            said = (
                f"no failure was found up to {r.radius:.3g} of the way to the ends; one lies at {r.failure:.3g}: {near}"
            )
        lines.append(f"* {name}: {said} ({r.searches} searches, {r.samples} samples).")
    targets = list(judged.radii[0].ends)
    rows = [
        [target, *(f"{r.ends[target][0]:.4g} to {r.ends[target][1]:.4g}" for r in judged.radii)] for target in targets
    ]
    return [*lines, "", "The box in which nothing was found to fail:", "", grid(["leaf", *results.names], rows)]


def _metrics(results: Results, judged: SweepVerdict) -> str:
    rows = []
    for metric, values in results.metrics.items():
        for i, name in enumerate(results.names):
            low, middle, high = np.quantile(values[i], (0.05, 0.5, 0.95), method="nearest")
            fine = values[i][np.isfinite(values[i])]
            mean = float(fine.mean()) if fine.size else np.inf
            missing = values[i].size - fine.size
            nominal = judged.nominal[i][metric]
            unit = METRICS[metric].unit
            rows.append([metric, unit, name, nominal, mean, low, middle, high, float(values[i].max()), missing])
    return grid(
        [
            "metric",
            "unit",
            "controller",
            "nominal",
            "mean of those with a value",
            "5 %",
            "median",
            "95 %",
            "worst",
            "without a value (not in the mean)",
        ],
        [[float(x) if isinstance(x, np.floating) else x for x in row] for row in rows],
    )


def _sensitivity(results: Results, judged: SweepVerdict) -> list[str]:
    saltelli = results.design.method == "saltelli"
    names = ("first order", "±", "total", "±") if saltelli else ("mean of |effect|", "±", "standard deviation")
    lines = []
    for controller, rows in judged.indices.items():
        for metric, indices in rows.items():
            if not indices:
                lines += [f"{controller}, {metric}: none, since some runs have no finite value.", ""]
                continue
            table = [[x.axis, x.first, x.first_error, x.total, *([x.total_error] if saltelli else [])] for x in indices]
            lines += [f"{controller}, {metric}:", "", grid(["axis", *names], table), ""]
    return lines


def _worst(results: Results, judged: SweepVerdict, folder: str) -> list[str]:
    metric = next(iter(judged.bounds), next(iter(results.metrics)))
    lines, leaves = [], list(results.leaves)
    for i, name in enumerate(results.names):
        values = results.metrics[metric][i]
        rows = [
            [
                int(n),
                float(values[n]),
                "yes" if judged.which[i, n] else "no",
                *(_shown(results.leaves[x][n]) for x in leaves),
            ]
            for n in worst(values, WORST)
        ]
        lines += [f"{name}, by {metric}:", "", grid(["index", metric, "failed", *leaves], rows), ""]
    number = int(worst(results.metrics[metric][0], 1)[0])
    return [*lines, f"`agvjax simulate --from {folder} --index {number}` rolls one out again."]


def _shown(value: Any) -> str:
    return ", ".join(f"{x:.4g}" for x in np.ravel(value))


def as_json(results: Results, judged: SweepVerdict) -> dict[str, Any]:
    """`findings.json`."""
    metric = next(iter(judged.bounds), next(iter(results.metrics)))
    return {
        name: {
            "nominal": judged.nominal[i],
            "bounds": judged.bounds,
            **judged.failures[i]._asdict(),
            "worst": [int(n) for n in worst(results.metrics[metric][i], WORST)],
            "radius": _plain(judged.radii[i]._asdict()) if judged.radii else None,
            "indices": {m: [x._asdict() for x in rows] for m, rows in judged.indices.get(name, {}).items()},
        }
        for i, name in enumerate(results.names)
    }


def _plain(table: Mapping[str, Any]) -> dict[str, Any]:
    scenario = {name: np.asarray(value).tolist() for name, value in table["scenario"].items()}
    return {**table, "scenario": scenario}
