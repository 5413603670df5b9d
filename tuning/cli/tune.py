"""`agvjax tune`: gains for an ensemble, a report on them, and every step on disk."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator

import jax

from ..compute import processes
from ..compute.compiled import meanwhile
from ..io import viewers
from ..tune import page, populations
from ..tune.checkpoint import CHECKPOINT, Recorder
from ..tune.judge import judge
from ..tune.problem import pose
from ..tune.ready import readied
from ..tune.rounds import Outcome, Run, solve
from ..tune.rules import faults, moving
from .console import Console, RunFailed, failing, interrupts
from .folders import begin
from .nav2_file import ParameterFile
from .prepare import configure, warn


def run(arguments: argparse.Namespace) -> int:
    """Tune the configured gains over the configured ensemble; write gains, history, report and checkpoint."""
    recordings = viewers.asked(arguments)
    params = ParameterFile.given(arguments)
    config, console = configure(arguments, faults, params.settings() if params else None, moving)
    problem = pose(config)
    with processes.folder(lambda: begin(arguments, config), CHECKPOINT) as out:
        recorder = Recorder(out, problem)
        warn(console, config, "tune", "simulate", moving=moving(config))
        for line in params.lines() if params else []:
            console.note(line)
        recorder.begin()
        with failing(), _together():
            outcome = _solve(console, recorder)
            with console.phases() as phases:
                phases.begin("judging")
                verdict = judge(outcome)
                phases.begin("drawing")
                appendix = params.write(outcome.controller, config, out) if params else ""
                text = page.write(outcome, verdict, out, appendix, recordings)
        console.conclude(text, f"gains, report and figures written to {out}; begin with {out}/report.html")
    if verdict.failure:
        raise RunFailed(verdict.failure)
    return 0


@contextlib.contextmanager
def _together() -> Iterator[None]:
    """What happens where another of several processes is lost."""
    try:
        yield
    except jax.errors.JaxRuntimeError as error:
        if not processes.joined():
            raise
        again = "start all of them again with --resume: the run continues from its last checkpoint"
        raise RunFailed(f"another process was lost; {again} ({error})") from error


def _solve(console: Console, recorder: Recorder) -> Outcome:
    """Iterate phase by phase; save now and then, at the end, and when interrupted."""
    problem, first = recorder.problem, recorder.run
    size, most = problem.config.ensemble.size, problem.config.tune.iterations
    console.say(f"tuning {', '.join(recorder.names)} on {size} scenarios; the first start takes a minute to compile")

    with console.phases() as phases:

        def each(run: Run) -> None:
            _stop(signals)
            turn = f", round {run.round}" if run.round else ""
            phase = phases.begin(f"tuning{turn}", unit=f"iterations of at most {most} per search")
            last = next(p for p in reversed(run.searches) if p.history)
            step = f"generation {populations.generation(run.searches)}" if populations.drawn(last) else ""
            phase.note(f"{step or f'cost {last.history[-1][1]:.4f}'}, best {run.lead.best[1]:.4f}")
            phase.advance()
            recorder.record(run)

        def looking(runs: int, sets: int) -> None:
            _stop(signals)
            phase = phases.begin("screening gain sets", unit="runs")
            phase.advance(runs)
            phase.note(f"{sets} gain sets left")

        def searching() -> None:
            _stop(signals)
            phases.begin("searching for the worst scenario")
            meanwhile(page.prepare, problem.config)

        try:
            with interrupts() as signals:
                phases.begin("compiling")
                outcome = solve(readied(problem), first, each, searching, looking)
                _stop(signals)
            recorder.run = outcome.run
            return outcome
        finally:
            recorder.close()


def _stop(signals: list[int]) -> None:
    """End where Ctrl-C was swallowed on the way."""
    if signals:
        raise KeyboardInterrupt
