"""`agvjax simulate`: one vehicle, rolled out."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Any

import jax
import numpy as np

import agvjax
from agvjax import InputError, Problem, plot

from .. import config as configuration
from .. import runs
from ..settings import Config
from ..sweep import results, shards
from ..sweep.design import scene
from .common import RunFailed, configure, new_folder, say, trajectory_of, warn


def run(arguments: argparse.Namespace) -> int:
    """Roll the configured vehicle out; write trajectory, metrics, figures and the resolved configuration."""
    config = configure(arguments)
    if (arguments.sweep, arguments.index, arguments.controller) != (None, None, None):
        config = _of_sweep(arguments, config)
    out = new_folder(arguments)
    warn(arguments, config, "simulate")
    trajectory = jax.block_until_ready(trajectory_of(config, config.controller, config.scenario))
    metrics = agvjax.measure(trajectory)
    fields = ("t", "position", "velocity", "heading", "reference_position", "reference_heading", "command", "delivered")
    arrays = {name: getattr(trajectory, name) for name in fields}
    if trajectory.weight_norm is not None:
        arrays["weight_norm"] = trajectory.weight_norm
    runs.write(out / "config.toml", configuration.dump(config))
    runs.write_npz(out / "trajectory.npz", arrays)
    runs.write_json(out / "metrics.json", _spoken(metrics))
    drawn = {"run": trajectory}
    for name, figure in (
        ("path", plot.path(drawn)),
        ("errors", plot.errors(drawn)),
        ("commands", plot.commands(drawn)),
    ):
        runs.write_figure(out / f"{name}.png", figure)
    say(arguments, _metrics_table(metrics), f"written to {out}")
    if not trajectory.ok:
        raise RunFailed(
            f"the run diverged: the vehicle's state passed {config.scenario.limit:g} and was held there ({out})"
        )
    return 0


def _of_sweep(arguments: argparse.Namespace, config: Config) -> Config:
    """A scenario of a sweep and one of its controllers; timing as configured here."""
    others = [text for text in arguments.set if not text.startswith("simulate.")]
    others += [f"--config {name}" for name in arguments.config] + ["--seed"] * (arguments.seed is not None)
    if others:
        rule = "left out with --from, which brings scenario and controller; --set simulate.KEY=VALUE is fine"
        raise InputError([Problem("--from", text, rule) for text in others])
    if arguments.sweep is None:
        raise InputError([Problem("--from", "none", "the folder of a sweep, with --index and --controller")])
    try:
        made = shards.read_manifest(Path(arguments.sweep))
    except ValueError as error:
        raise InputError([Problem("--from", arguments.sweep, f"the folder of a sweep ({error})")]) from error
    if arguments.index is None or not 0 <= arguments.index < made.size:
        shown = "none" if arguments.index is None else arguments.index
        raise InputError([Problem("--index", shown, f"from 0 to {made.size - 1}, the scenarios of the sweep")])
    name = arguments.controller or made.names[0]
    if name not in made.names:
        raise InputError([Problem("--controller", name, f"one of the sweep's: {', '.join(made.names)}")])
    law, scenario = scene(results.opened(made), arguments.index)
    controller = agvjax.replace(results.controller_of(made, made.names.index(name)), law)
    own = any(text.startswith("simulate.horizon") for text in arguments.set)
    horizon = config.simulate.horizon if own else results.config_of(made).simulate.horizon
    timing = dataclasses.replace(config.simulate, horizon=horizon)
    return dataclasses.replace(config, controller=controller, scenario=scenario, simulate=timing)


def _spoken(metrics: agvjax.Metrics) -> dict[str, Any]:
    """Metrics for `metrics.json`: a channel that has not settled says so and gives no number."""
    spoken: dict[str, Any] = {"ok": bool(metrics.ok)}
    for field in dataclasses.fields(metrics):
        if field.name in ("ok", "settled", "settling_smooth"):
            continue
        values = np.asarray(getattr(metrics, field.name)).tolist()
        if field.name == "settling_time":
            values = [
                v if s else "not settled" for v, s in zip(values, np.asarray(metrics.settled).tolist(), strict=True)
            ]
        spoken[field.name] = dict(zip(plot.CHANNELS, values, strict=True))
    names = ("total_rmse", "effort", "peak_position", "peak_heading", "total_chatter")
    return spoken | {name: float(getattr(metrics, name)) for name in names}


def _metrics_table(metrics: agvjax.Metrics) -> str:
    spoken = _spoken(metrics)
    rows = ["| metric | x | y | heading |", "|---|---|---|---|"]
    for name, values in spoken.items():
        if isinstance(values, dict):
            cells = [v if isinstance(v, str) else f"{v:.5g}" for v in values.values()]
            rows.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(rows)
