"""`agvjax simulate`: one vehicle, rolled out."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

import agvjax
from agvjax import Fault, InputError
from agvjax.draw import plot

from ..compute.memory import too_much
from ..config import mapped, whereabouts
from ..config.rules import checked, faults, timing_faults, vehicle_faults
from ..config.settings import Config
from ..io import files, viewers
from ..io.pictures import Drawing, write_figures
from ..sweep.replay import retimed, vehicle
from .console import Console, RunFailed
from .folders import new_folder
from .measured import arrays, brief, divergence, measured, numbers
from .prepare import configure, warn

NUMBERS = 60  # about so many are kept of one sample, copies among them


def run(arguments: argparse.Namespace) -> int:
    """Roll the configured vehicle out; write trajectory, metrics, figures and the resolved configuration."""
    recordings = viewers.asked(arguments)
    of_sweep = (arguments.sweep, arguments.index, arguments.controller) != (None, None, None)
    config, console = configure(arguments, _settings if of_sweep else _rules)
    if of_sweep:
        config = _of_sweep(arguments, config)
        if wrong := whereabouts.faults(config):
            raise InputError(wrong)
    out = new_folder(arguments.out, arguments.command, config)
    warn(console, config, "simulate")
    save = config.simulate.save_every
    trajectory = agvjax.simulate(config.controller, config.scenario, save_every=save, **config.timing())
    of_metrics = numbers(measured(trajectory, config.judged(delivered=True)), config.scenario)
    trajectory = mapped.drawn(trajectory, config.scenario)
    files.write_npz(out / "trajectory.npz", arrays(trajectory))
    files.write_json(out / "metrics.json", of_metrics)
    for text in write_figures(out, _drawings(trajectory, config.scenario)):
        console.note(text)
    if arguments.animate:
        _animate(console, out, trajectory)
    viewers.write_runs(recordings, {"": trajectory}, config.scenario.plant)
    where = f"written to {out}: every metric in metrics.json, figures, trajectory.npz"
    console.conclude(brief(of_metrics, config.scenario), where)
    if not trajectory.ok:
        raise RunFailed(f"{divergence(trajectory, float(config.scenario.limit))} ({out})")
    return 0


def _rules(config: Config) -> list[Fault]:
    """What is wrong with a configuration that is rolled out and kept."""
    return faults(config) or _kept(config)


def _kept(config: Config) -> list[Fault]:
    """Samples that no memory holds."""
    every = config.simulate.save_every
    kept = config.simulate.horizon / config.simulate.dt / every * NUMBERS * config.precision / 8
    rule = f"larger, or simulate.dt coarser or simulate.horizon shorter: all that is kept takes {too_much(kept)}"
    return [Fault("simulate.save_every", every, rule)] if too_much(kept) else []


def _settings(config: Config) -> list[Fault]:
    """What is wrong with the settings of a run whose scenario and law come of a sweep."""
    return [fault._replace(key=f"simulate.{fault.key}") for fault in agvjax.faults(config.simulate)]


def _of_sweep(arguments: argparse.Namespace, config: Config) -> Config:
    """A scenario of a sweep and one of its controllers, with the sweep's settings but for those of [simulate] here."""
    others = [text for text in arguments.set if not text.startswith("simulate.")]
    others += [f"--config {name}" for name in arguments.config] + ["--seed"] * (arguments.seed is not None)
    if others:
        rule = "left out with --from, which sets scenario and controller; --set simulate.KEY=VALUE is allowed"
        raise InputError([Fault("--from", text, rule) for text in others])
    if arguments.sweep is None:
        raise InputError([Fault("--from", "none", "the folder of a sweep, with --index and --controller")])
    found = vehicle(arguments.sweep, arguments.index, arguments.controller, arguments.imports)
    given = [text.partition("=")[0].partition(".")[2].strip(" \"'") for text in arguments.set]
    simulate = retimed(found.config.simulate, {name: getattr(config.simulate, name) for name in given})
    return checked(dataclasses.replace(found.config, simulate=simulate, precision=config.precision), _vehicle, [])


def _vehicle(config: Config) -> list[Fault]:
    """What is wrong with a vehicle that was drawn, a fraction of a seed too."""
    return vehicle_faults(config) or timing_faults(config, "simulate") or _kept(config)


def _drawings(trajectory: agvjax.Trajectory, scenario: agvjax.Scenario) -> dict[str, Drawing]:
    """The figures by name, not yet drawn."""
    plant, runs, points = scenario.plant, {"run": trajectory}, mapped.corners(scenario.path)
    drawings: dict[str, Drawing] = {"path": lambda: plot.path(runs, points, scenario.path)}
    drawings |= {"errors": lambda: plot.errors(runs), "commands": lambda: plot.commands(runs, plot.asked(plant))}
    if trajectory.route is not None:
        drawings["route"] = lambda: plot.route(trajectory)
    if "position" not in plant.actuators:  # where they are not the commands themselves
        drawings["inputs"] = lambda: plot.inputs(trajectory, plant.actuators)
    return drawings


def _animate(console: Console, out: Path, trajectory: agvjax.Trajectory) -> None:
    from agvjax.draw import animate  # late: few ask for it

    try:
        moving = animate.animation({"run": trajectory})
    except ValueError as error:  # nothing of it is finite
        console.note(f"animation.gif could not be drawn: {error}")
        return
    with console.phases() as phases:
        phase = phases.begin("drawing", moving.frames, "frames")
        files.write_by(out / "animation.gif", lambda file: animate.write_gif(moving, file, phase.advance))
