"""`agvjax tune`: gains for an ensemble, a report on them, and every step on disk."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator
from pathlib import Path

import jax

from ..compute import processes
from ..config import Config
from ..tune import page, populations
from ..tune.checkpoint import CHECKPOINT, Recorder
from ..tune.judge import judge
from ..tune.problem import pose
from ..tune.ready import readied
from ..tune.rounds import Outcome, Run, solve
from ..tune.rules import faults, moving
from .console import Console, RunFailed, failing, interrupts
from .folders import new_folder, same_folder
from .nav2_file import ParameterFile
from .prepare import configure, warn


def run(arguments: argparse.Namespace) -> int:
    """Tune the configured gains over the configured ensemble; write gains, history, report and checkpoint."""
    params = ParameterFile.given(arguments)
    config, console = configure(arguments, faults, params.settings() if params else None, moving)
    problem = pose(config)
    with processes.folder(lambda: _folder(arguments, config), CHECKPOINT) as out:
        recorder = Recorder(out, problem)
        warn(console, config, "tune", "simulate", moving=moving(config))
        for line in params.lines() if params else []:
            console.note(line)
        recorder.begin()
        with failing(), _together():
            outcome = _solve(console, recorder)
            console.say("judging on tuning and validation scenarios ...")
            verdict = judge(outcome)
            appendix = params.write(outcome.controller, config, out) if params else ""
            text = page.write(outcome, verdict, out, appendix)
        console.say(text, f"gains, report and figures written to {out}; begin with {out}/report.html")
    if verdict.failure:
        raise RunFailed(verdict.failure)
    return 0


def _folder(arguments: argparse.Namespace, config: Config) -> Path:
    if arguments.resume:
        return same_folder(arguments.out, arguments.command, config)
    return new_folder(arguments.out, arguments.command, config)


@contextlib.contextmanager
def _together() -> Iterator[None]:
    """What happens where another of several processes is lost."""
    try:
        yield
    except jax.errors.JaxRuntimeError as error:
        if not processes.joined():
            raise
        again = "begin all of them again with --resume, the run goes on from its last checkpoint"
        raise RunFailed(f"another process was lost; {again} ({error})") from error


def _solve(console: Console, recorder: Recorder) -> Outcome:
    """Iterate with a bar; save now and then, at the end, and when interrupted."""
    problem, first = recorder.problem, recorder.run
    size, iterations = problem.config.ensemble.size, problem.config.tune.iterations
    console.say(f"tuning {', '.join(recorder.names)} on {size} scenarios; the first start compiles for a minute")
    bar = console.bar(iterations, "it", max(p.iteration for p in first.searches))

    def each(run: Run) -> None:
        if signals:
            raise KeyboardInterrupt
        last = next(p for p in reversed(run.searches) if p.history)
        row, best = last.history[-1], f"best {run.lead.best[1]:.4f}"
        plain = f"cost {row[1]:.4f} {best} |grad| {row[5]:.2g} latched {row[4]:.0f}"
        notes = f"generation {populations.generation(run.searches)}, {best}" if populations.drawn(last) else plain
        bar.set_postfix_str(f"round {run.round} {notes}" if run.round else notes, refresh=False)
        bar.update()
        recorder.record(run)

    def looking(runs: int, sets: int) -> None:
        if signals:
            raise KeyboardInterrupt
        bar.set_postfix_str(f"looking at {sets} gain sets", refresh=False)
        bar.refresh()

    def searching() -> None:
        if signals:
            raise KeyboardInterrupt
        bar.refresh()
        console.say("\nlooking for the worst scenario ...")

    try:
        with interrupts() as signals:
            outcome = solve(readied(problem), first, each, searching, looking)
            if signals:
                raise KeyboardInterrupt
        recorder.run = outcome.run
        return outcome
    finally:
        bar.close()
        recorder.close()
