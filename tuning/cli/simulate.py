"""`agvjax simulate`: one vehicle, rolled out."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

import agvjax
from agvjax import Fault, InputError
from agvjax.draw import plot

from ..config.settings import Config
from ..io import files
from ..io.pages import grid
from ..sweep import results, shards
from ..sweep.design import scene
from .console import Console, RunFailed
from .folders import new_folder
from .prepare import configure, trajectory_of, warn


def run(arguments: argparse.Namespace) -> int:
    """Roll the configured vehicle out; write trajectory, metrics, figures and the resolved configuration."""
    config, console = configure(arguments)
    if (arguments.sweep, arguments.index, arguments.controller) != (None, None, None):
        config = _of_sweep(arguments, config)
    out = new_folder(arguments.out, arguments.command, config)
    warn(console, config, "simulate")
    trajectory = jax.block_until_ready(trajectory_of(config, config.controller, config.scenario))
    metrics = agvjax.measure(trajectory, agvjax.Criteria(delivered=True))
    names = config.scenario.plant.actuators
    fields = ("t", "position", "velocity", "heading", "reference_position", "reference_heading")
    fields += ("command", "inputs", "delivered", "limited")
    arrays = {name: getattr(trajectory, name) for name in fields}
    if trajectory.weight_norm is not None:
        arrays["weight_norm"] = trajectory.weight_norm
    files.write_npz(out / "trajectory.npz", arrays)
    files.write_json(out / "metrics.json", _spoken(metrics, names))
    drawn = {"run": trajectory}
    for name, figure in (
        ("path", plot.path(drawn)),
        ("errors", plot.errors(drawn)),
        ("commands", plot.commands(drawn)),
    ):
        files.write_figure(out / f"{name}.png", figure)
    if "position" not in names:  # where they are not the commands themselves
        files.write_figure(out / "inputs.png", plot.inputs(trajectory, names))
    if arguments.animate:
        _animate(console, out, drawn)
    console.say(_metrics_table(metrics, names), _delivered_table(metrics, names), f"written to {out}")
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
        raise InputError([Fault("--from", text, rule) for text in others])
    if arguments.sweep is None:
        raise InputError([Fault("--from", "none", "the folder of a sweep, with --index and --controller")])
    try:
        made = shards.read_manifest(Path(arguments.sweep))
    except ValueError as error:
        raise InputError([Fault("--from", arguments.sweep, f"the folder of a sweep ({error})")]) from error
    if arguments.index is None or not 0 <= arguments.index < made.size:
        shown = "none" if arguments.index is None else arguments.index
        raise InputError([Fault("--index", shown, f"from 0 to {made.size - 1}, the scenarios of the sweep")])
    name = arguments.controller or made.names[0]
    if name not in made.names:
        raise InputError([Fault("--controller", name, f"one of the sweep's: {', '.join(made.names)}")])
    law, scenario = scene(results.opened(made), arguments.index)
    controller = agvjax.replace(results.controller_of(made, made.names.index(name)), law)
    own = any(text.startswith("simulate.horizon") for text in arguments.set)
    horizon = config.simulate.horizon if own else results.config_of(made).simulate.horizon
    timing = dataclasses.replace(config.simulate, horizon=horizon)
    return dataclasses.replace(config, controller=controller, scenario=scenario, simulate=timing)


def _animate(console: Console, out: Path, drawn: dict[str, Any]) -> None:
    from agvjax.draw import animate  # late: few ask for it

    moving = animate.animation(drawn)
    with console.bar(moving.frames, "frame") as bar:
        files.write_by(out / "animation.gif", lambda file: animate.write_gif(moving, file, bar.update))


def _spoken(metrics: agvjax.Metrics, actuators: Sequence[str]) -> dict[str, Any]:
    """Metrics for `metrics.json`: a channel that has not settled says so and gives no number."""
    spoken: dict[str, Any] = {"ok": bool(metrics.ok)}
    for field in dataclasses.fields(metrics):
        if field.name in ("ok", "settled", "settling_smooth", "limited"):
            continue
        values = np.asarray(getattr(metrics, field.name)).tolist()
        if field.name == "settling_time":
            values = [
                v if s else "not settled" for v, s in zip(values, np.asarray(metrics.settled).tolist(), strict=True)
            ]
        places = _each(actuators, len(values)) if field.name.endswith("_delivered") else plot.CHANNELS[: len(values)]
        spoken[field.name] = dict(zip(places, values, strict=True))
    names = ("total_rmse", "effort", "peak_position", "peak_heading", "total_chatter", "limited")
    heading = np.size(metrics.rmse) == 3
    return spoken | {n: float(getattr(metrics, n)) for n in names if heading or n != "peak_heading"}


def _each(actuators: Sequence[str], count: int) -> list[str]:
    """A name for each number that the actuators deliver: the position's of the decoupled plant are two."""
    return list(actuators) if len(actuators) == count else ["position_x", "position_y", *actuators[1:]]


def _metrics_table(metrics: agvjax.Metrics, actuators: Sequence[str]) -> str:
    channels = plot.CHANNELS[: np.size(metrics.rmse)]
    spoken = _spoken(metrics, actuators)
    rows = []
    for name, values in spoken.items():
        if isinstance(values, dict) and not name.endswith("_delivered"):
            rows.append([name, *(v if isinstance(v, str) else f"{v:.5g}" for v in values.values())])
    return grid(["metric", *channels], rows)


def _delivered_table(metrics: agvjax.Metrics, actuators: Sequence[str]) -> str:
    parts = {name: np.asarray(getattr(metrics, f"{name}_delivered")) for name in ("rms", "peak", "variation")}
    columns = _each(actuators, parts["rms"].size)
    table = grid(["delivered", *columns], [[name, *(f"{v:.5g}" for v in value)] for name, value in parts.items()])
    return f"\n{table}\nat a limit {float(metrics.limited):.1%} of the time" if metrics.limited else f"\n{table}"
