"""`agvjax tune`: gains for an ensemble, a report on them, and every step on disk."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Any

import jax
import numpy as np

import agvjax
from agvjax import InputError

from .. import config as configuration
from ..compute import compiled as startup
from ..compute import processes as distributed
from ..config.settings import Config
from ..io import files
from ..io.pages import html
from ..tune import checkpoint, figures
from ..tune import page as report
from ..tune.judge import _both, judged, verdict
from ..tune.problem import Posed, pose
from ..tune.rounds import Outcome, Run, begin, solve
from ..tune.rules import faults
from .console import Console, RunFailed, interrupts
from .folders import new_folder, same_folder
from .prepare import as_arrays, configure, trajectory_of, warn


def run(arguments: argparse.Namespace) -> int:
    """Tune the configured gains over the configured ensemble; write gains, history, report and checkpoint."""
    config, console = configure(arguments, faults)
    posed = pose(config)
    with distributed.folder(lambda: _folder(arguments, config), checkpoint.CHECKPOINT) as out:
        begun = _begun(posed, out)
        warn(console, config, "tune", "simulate")
        found = _tune(console, posed, begun, out)[1]
    if found.over:
        raise RunFailed(" ".join(["limits not met:", "; ".join(found.over) + ".", *found.conflict]))
    return 0


def _folder(arguments: argparse.Namespace, config: Config) -> Path:
    if arguments.resume:
        return same_folder(arguments.out, config)
    return new_folder(arguments.out, arguments.command, config)


def _begun(posed: Posed, out: Path) -> Run:
    """Where to begin: at the start, or at the checkpoint of an earlier run."""
    run = begin(posed)
    if (out / checkpoint.CHECKPOINT).exists():
        try:
            run = checkpoint.load(out, run)
        except ValueError as error:
            raise InputError(
                [agvjax.Fault("--resume", str(out), f"a run with a whole checkpoint ({error})")]
            ) from error
    return run


def _tune(console: Console, posed: Posed, begun: Run, out: Path) -> tuple[Outcome, report.Verdict]:
    """One problem, from its configuration on disk to its report."""
    files.write(out / "config.toml", configuration.dump(posed.config))
    try:
        outcome = _solve(console, compiled(posed), begun, out)
        console.say("judging on tuning and validation scenarios ...")
        return outcome, _conclude(console, outcome, out)
    except jax.errors.JaxRuntimeError as error:
        if not distributed.joined():
            raise
        again = "begin all of them again with --resume, the run goes on from its last checkpoint"
        raise RunFailed(f"another process was lost; {again} ({error})") from error
    except RuntimeError as error:
        raise RunFailed(str(error)) from error


def steered(posed: Posed) -> Posed:
    """The problem with its Jacobian made ready in the background, from disk where it was made ready before."""
    tuner = posed.tuner
    if tuner.forward:
        push = startup.Ahead(tuner.jacobian, *_identity(posed), tuner.scenarios)
        tuner = dataclasses.replace(tuner, prepared=push)
    return posed._replace(tuner=tuner)


def _identity(posed: Posed) -> tuple[str, Any]:
    """All that shapes what is compiled, and where the search starts."""
    settings = configuration.dump(dataclasses.replace(posed.config, seed=0))
    return settings, posed.tuner.free.coordinates(posed.config.controller)


def compiled(posed: Posed) -> Posed:
    """The problem with all that tuning will call made ready, the Jacobian first.

    Not where several processes compute together: they must do the same in the same order.
    """
    if distributed.joined():
        return posed
    posed = steered(posed)
    config, (settings, z), adversary, push = posed.config, _identity(posed), posed.adversary, posed.tuner.prepared
    push = push if isinstance(push, startup.Ahead) else None
    shares, scenarios = adversary.examples()
    climb = startup.Ahead(adversary.climb, settings + "climb", z, jax.numpy.asarray(shares, z.dtype), after=push)
    look = startup.Ahead(adversary.look, settings + "look", z, scenarios, after=push)
    startup.meanwhile(judged, config, config.controller, _both(posed)[0])
    return posed._replace(adversary=dataclasses.replace(adversary, climbing=climb, looking=look))


def _solve(console: Console, posed: Posed, run: Run, out: Path) -> Outcome:
    """Iterate with a bar; save now and then, at the end, and when interrupted."""
    tuner, every = posed.tuner, posed.config.tune.checkpoint_every
    names, latest = tuner.free.names, [run]
    console.say(
        f"tuning {', '.join(names)} on {posed.config.ensemble.size} scenarios; the first start compiles for a minute",
    )
    checkpoint.write_log(out, names, run)
    done = max(p.iteration for p in run.searches)
    bar = console.bar(tuner.iterations, "it", done)

    def each(run: Run) -> None:
        if lost:
            raise KeyboardInterrupt
        latest[0] = run
        last = max(run.searches, key=lambda p: p.iteration)
        row = last.history[-1]
        notes = f"cost {row[1]:.4f} best {run.lead.best[1]:.4f} |grad| {row[5]:.2g} latched {row[4]:.0f}"
        bar.set_postfix_str(f"round {run.round} {notes}" if run.round else notes, refresh=False)
        bar.update()
        checkpoint.log(out, names, run)
        if last.iteration % every == 0:
            checkpoint.save(out, run)

    def searching() -> None:
        if lost:
            raise KeyboardInterrupt
        bar.refresh()
        console.say("\nlooking for the worst scenario ...")

    try:
        with interrupts() as lost:
            outcome = solve(posed, run, each, searching)
            if lost:
                raise KeyboardInterrupt
        latest[0] = outcome.run
        return outcome
    finally:  # also on Ctrl-C: the folder then holds the best gains so far, and --resume goes on
        bar.close()
        if latest[0].lead.history:
            checkpoint.save(out, latest[0])
            checkpoint.write_history(out, names, latest[0])
            if np.isfinite(latest[0].lead.best[1]):
                files.write(out / "gains.toml", configuration.gains_table(tuner.best(latest[0].lead)))


def _conclude(console: Console, outcome: Outcome, out: Path) -> report.Verdict:
    """Judge, draw, and write the report."""
    config, tuned, names = outcome.posed.config, outcome.controller, outcome.posed.tuner.free.names
    found, unseen = verdict(outcome)
    worst = found.after["validation"].worst_index
    scenes = {"nominal": config.scenario, "worst": unseen[worst]}
    titles = {"nominal": "nominal scenario", "worst": "validation scenario with the largest error of the tuned gains"}
    for name, scene in scenes.items():
        old, new = (trajectory_of(config, as_arrays(c), as_arrays(scene)) for c in (config.controller, tuned))
        files.write_figure(out / f"{name}.png", figures.tracking_figure(old, new, titles[name]))
    files.write_figure(out / "history.png", figures.history_figure(names, outcome.run))
    files.write_figure(out / "sensitivity.png", figures.sensitivity_figure(found.findings))
    _write_worst(outcome, out)
    text = report.page(outcome, found)
    files.write(out / "report.md", text)
    files.write(out / "report.html", html(text, out, "Tuned gains"))
    console.say(text, f"gains, report and figures written to {out}; begin with {out}/report.html")
    return found


def _write_worst(outcome: Outcome, out: Path) -> None:
    """`worst.json`: the worst scenario found for each metric, so that it can be looked at again."""
    rows = [
        {"metric": f.metric, "value": f.value, "searches": f.searches, "samples": f.samples, "rollouts": f.rollouts}
        | {"scenario": {name: np.asarray(value).tolist() for name, value in f.scenario.items()}}
        for f in outcome.found
    ]
    files.write_json(out / "worst.json", {"found": rows, "rounds": [r._asdict() for r in outcome.rounds]})
