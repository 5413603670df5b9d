"""`agvjax pareto`: the front of error against command."""

from __future__ import annotations

import argparse

import jax
import numpy as np

import agvjax

from .. import config as configuration
from ..io import files
from ..io.kept import Kept
from ..io.pages import grid
from ..io.pictures import write_figures
from ..io.statements import worst_of
from ..tune import pareto
from ..tune.finer import judged, validation
from ..tune.problem import pose
from ..tune.ready import steered
from ..tune.rules import faults, moving
from .console import RunFailed, failing
from .folders import begin
from .prepare import configure, warn


def run(arguments: argparse.Namespace) -> int:
    """Tune for every place of the moved limit; write the front, its figure and the gains of every point."""
    config, console = configure(arguments, faults, moving=moving)
    problem = pose(config)
    out = begin(arguments, config)
    kept = Kept(out / "points", pareto.Reached)
    warn(console, config, "tune", "simulate", moving=moving(config))
    settings, names = config.pareto, problem.tuner.gains.names
    factors = np.geomspace(settings.low, settings.high, settings.points).tolist()
    goal = problem.tuner.objective.goals[0].metric
    with console.phases() as phases, failing():
        phase = phases.begin("tuning", len(factors), "points")

        def done(point: pareto.Point) -> None:
            phase.note(f"{settings.metric} x {point.factor:.3g}: goal {point.goal:.4f}")
            phase.advance()

        points = pareto.front(steered(problem), settings.metric, factors, done, kept)
    unseen = validation(config)
    values = [
        _worth(judged(config, law, unseen), (settings.metric, goal))
        for law in (*(p.controller for p in points), config.controller)
    ]
    uses, errors = np.moveaxis(np.array(values), 1, 0)
    rows = [[p.factor, p.goal, p.met, p.dominated, *uses[i], *errors[i], *p.gains] for i, p in enumerate(points)]
    header = ["limit", "goal", "met", "dominated"]
    header += [f"{s} {m}" for m in (settings.metric, goal) for s in ("mean", "worst")] + list(names)
    files.write_csv(out / "pareto.csv", header, rows)
    for i, p in enumerate(points):
        files.write(out / f"gains-{i}.toml", configuration.gains_table(p.controller))
    drawing = {"pareto": lambda: pareto.figure(points, uses, errors, settings.metric, goal)}
    for text in write_figures(out, drawing):
        console.note(text)
    heads = [name.replace("worst", worst_of(config.ensemble.validation_size)) for name in header[4:8]]
    lines = [[r[0], r[1], "yes" if r[2] else "no", *r[4:8]] for r in rows]
    table = grid([f"{settings.metric} at most", "goal", "met", *heads], lines)
    console.conclude(table, f"front, figure and gains written to {out}; begin with {out}/pareto.png")
    if not any(p.met for p in points):
        raise RunFailed("the limits could not be met at any point of the front")
    return 0


def _worth(metrics: agvjax.Metrics, names: tuple[str, ...]) -> list[list[float]]:
    """Mean and worst of metrics over the runs that did not diverge."""
    ok = np.asarray(metrics.ok)
    kept = jax.tree.map(lambda x: x[ok], metrics)
    return [[float(np.mean(v)), float(np.max(v))] for v in (np.asarray(kept[n]) for n in names)]
