"""What `agvjax simulate` and `agvjax tune` do, from parsed arguments to a run folder."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np
from tqdm import tqdm

import agvjax
from agvjax import InputError, plot

from . import config as configuration
from . import report, runs, startup
from .ensemble import sample
from .free import Free, default_bounds, stability_bounds
from .objective import Objective
from .optimise import SEQUENTIAL, Progress, Tuner, mode
from .settings import Config, steps_of


class RunFailed(Exception):
    """The input was good and the run was not."""


def simulate(arguments: argparse.Namespace) -> int:
    """Roll the configured vehicle out; write trajectory, metrics, figures and the resolved configuration."""
    config = _configure(arguments)
    out = _new_folder(arguments)
    _warn(arguments, config, "simulate")
    trajectory = jax.block_until_ready(_trajectory(config, config.controller, config.scenario))
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
    _say(arguments, _metrics_table(metrics), f"written to {out}")
    if not trajectory.ok:
        raise RunFailed(
            f"the run diverged: the vehicle's state passed {config.scenario.limit:g} and was held there ({out})"
        )
    return 0


def tune(arguments: argparse.Namespace) -> int:
    """Tune the configured gains over the configured ensemble; write gains, history, report and checkpoint."""
    config = _configure(arguments)
    tuner, stability = _tuner(config)
    out = _same_folder(arguments, config) if arguments.resume else _new_folder(arguments)
    if tuner.forward:
        prepared = startup.traced(tuner.jacobian, configuration.dump(config), tuner.free.coordinates(config.controller))
        tuner = dataclasses.replace(tuner, prepared=prepared)
    progress = tuner.begin()
    if (out / runs.CHECKPOINT).exists():
        try:
            progress = runs.load(out, progress)
        except ValueError as error:
            raise InputError(
                [agvjax.Problem("--resume", str(out), f"a run with a whole checkpoint ({error})")]
            ) from error
    _warn(arguments, config, "tune", "simulate")
    runs.write(out / "config.toml", configuration.dump(config))
    try:
        progress = _optimise(arguments, tuner, progress, out, config.tune.checkpoint_every)
    except RuntimeError as error:
        raise RunFailed(str(error)) from error
    if progress.skipped == progress.iteration:
        raise RunFailed("no gradient was finite: not one step was taken")
    tuned = tuner.best(progress)
    _say(arguments, "judging on tuning and validation scenarios ...")
    return _conclude(arguments, config, tuner, progress, tuned, stability, out)


def reproduce(arguments: argparse.Namespace) -> int:
    """Rebuild the paper; write figures, tables, report."""
    from .paper import reproduce as paper  # late: the other commands do not wait for it

    config = _configure(arguments)
    found = paper.problems(config)
    if found:
        raise InputError(found)
    out = _new_folder(arguments)
    runs.write(out / "config.toml", configuration.dump(config))
    given = [f"--config {name}" for name in arguments.config] + [f"--set {text}" for text in arguments.set]
    command = " ".join(["agvjax reproduce", *given])
    with tqdm(total=paper.steps(config), disable=arguments.quiet, unit="part") as bar:
        progress = _ticker(bar)
        try:
            made = paper.Reproduction(config, progress)
        except RuntimeError as error:
            raise RunFailed(str(error)) from error
        paper.write(made, out, command, arguments.pdf, progress)
    _say(
        arguments,
        paper.page.summary(made),
        f"report, tables and figures written to {out}; begin with {out}/report.html",
    )
    return 0


def compare(arguments: argparse.Namespace) -> int:
    """Tune every law to one command budget; write table, figure and report."""
    from . import compare as comparing

    config = _configure(arguments)
    found = comparing.problems(config.controller, config.scenario)
    if found:
        raise InputError(found)
    out = _new_folder(arguments)
    runs.write(out / "config.toml", configuration.dump(config))
    with tqdm(total=len(comparing.laws(config.controller)) + 1, disable=arguments.quiet, unit="law") as bar:
        try:
            comparison, tuned = comparing.compare(config, _ticker(bar))
        except (RuntimeError, ValueError) as error:
            raise RunFailed(str(error)) from error
    _say(arguments, comparing.write(comparison, tuned, out), f"written to {out}; begin with {out}/report.html")
    return 0


def _ticker(bar: Any) -> Any:
    """Progress by name: one part done, and which."""

    def tick(name: str) -> None:
        bar.set_postfix_str(name, refresh=False)
        bar.update()

    return tick


def _configure(arguments: argparse.Namespace) -> Config:
    """Settings from files and options, JAX made ready for them."""
    overrides = list(arguments.set)
    overrides += [] if arguments.seed is None else [f"seed={arguments.seed}"]
    overrides += [] if arguments.precision is None else [f"precision={arguments.precision}"]
    config = configuration.load(arguments.config, overrides, arguments.command)
    jax.config.update("jax_enable_x64", config.precision == 64)
    startup.keep_compiled()
    way = mode(config.tune.gradient, len(config.tune.gains)) if config.tune.optimizer != SEQUENTIAL else "forward"
    said = agvjax.tune_xla(reverse=arguments.command == "tune" and way == "reverse")
    if not said.startswith("fast"):
        _say(arguments, f"note: {said}")
    return config


def _warn(arguments: argparse.Namespace, config: Config, *sections: str) -> None:
    """Say of a step that is allowed and not advisable."""
    for name in sections:
        section = getattr(config, name)
        for note in agvjax.step_warnings(config.controller, section.dt, agvjax.INTEGRATORS[section.integrator]):
            _say(arguments, f"note: {name}.{note}")


def _say(arguments: argparse.Namespace, *lines: str) -> None:
    if not arguments.quiet:
        print(*lines, sep="\n", flush=True)


def _new_folder(arguments: argparse.Namespace) -> Path:
    name = arguments.out or f"runs/{arguments.command}-{time.strftime('%Y%m%d-%H%M%S')}"
    out = Path(name)
    try:
        out.mkdir(parents=True, exist_ok=True)
        taken = any(out.iterdir())
        if not taken:
            runs.write(out / "config.toml", "")
    except (OSError, ValueError) as error:
        raise InputError([agvjax.Problem("--out", name, f"a folder that can be written ({error})")]) from error
    if taken:
        rule = "a new or empty folder: this one is not empty; choose another"
        rule += ", or add --resume to go on with the run in it" if arguments.command == "tune" else ""
        raise InputError([agvjax.Problem("--out", name, rule)])
    return out


def _same_folder(arguments: argparse.Namespace, config: Config) -> Path:
    """The folder of the run to go on with; its settings must be these."""
    out = Path(arguments.out or os.devnull)
    try:
        before = (out / "config.toml").read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise InputError([agvjax.Problem("--resume", arguments.out, "used with --out, the folder of a run")]) from error
    old, new = before.splitlines(), configuration.dump(config).splitlines()
    if old and old != new:
        changed = [f"was `{line}`" for line in old if line not in new] + [
            f"is `{line}`" for line in new if line not in old
        ]
        rule = f"the run that these settings began; changed: {'; '.join(changed)}"
        raise InputError([agvjax.Problem("--resume", str(out), rule)])
    return out


def _trajectory(config: Config, controller: Any, scenario: Any) -> agvjax.Trajectory:
    timing = config.simulate
    return agvjax.simulate(
        controller,
        scenario,
        dt=timing.dt,
        n_steps=steps_of(timing.horizon, timing.dt),
        save_every=timing.save_every,
        control_every=timing.control_every,
        integrator=agvjax.INTEGRATORS[timing.integrator],
    )


def _tuner(config: Config) -> tuple[Tuner, dict[str, float]]:
    """The tuning problem, checked; and the stability bounds it keeps."""
    settings, method = config.tune, agvjax.INTEGRATORS[config.tune.integrator]
    draws = config.ensemble.draws
    stability = stability_bounds(config.controller, config.scenario, draws)
    bounds = default_bounds(config.controller, settings.gains, stability, settings.dt, method)
    for name, (low, high) in settings.bounds.items():
        if name in bounds:
            bounds[name] = (max(low, bounds[name][0]), min(high, bounds[name][1]))
    lower, upper = (np.array([bounds[name][side] for name in settings.gains]) for side in (0, 1))
    free = Free(settings.gains, lower, upper)
    found = free.problems(config.controller)
    if found:
        raise InputError(found)
    goal, limits = settings.goal, {name: limit for name, limit in settings.limits.items() if np.isfinite(limit)}
    tuner = Tuner(
        controller=config.controller,
        batch=sample(config.scenario, draws, config.ensemble.size, config.seed),
        free=free,
        objective=Objective(goal.metric, goal.mean, goal.worst, limits, settings.penalty),
        dt=settings.dt,
        n_steps=steps_of(config.simulate.horizon, settings.dt),
        integrator=method,
        iterations=settings.iterations,
        optimizer=settings.optimizer,
        learning_rate=settings.learning_rate,
        options=settings.options,
        clip=settings.clip,
        patience=settings.patience,
        gradient=settings.gradient,
    )
    if tuner.sequential:
        return tuner, stability
    try:
        jax.eval_shape(tuner.try_update, free.coordinates(config.controller))
    except Exception as error:  # optax and its optimisers raise whatever they meet
        rule = f"an optimiser of optax that needs no more than a learning rate and these options ({error})"
        raise InputError([agvjax.Problem("tune.optimizer", settings.optimizer, rule)]) from error
    return tuner, stability


def _optimise(arguments: argparse.Namespace, tuner: Tuner, progress: Progress, out: Path, every: int) -> Progress:
    """Iterate with a bar; save now and then, at the end, and when interrupted."""
    names = tuner.free.names
    _say(
        arguments,
        f"tuning {', '.join(names)} on {tuner.batch.size} scenarios; the first start compiles for some seconds",
    )
    bar = tqdm(total=tuner.iterations, initial=progress.iteration, disable=arguments.quiet, unit="it", mininterval=0.5)
    try:
        with _interrupts() as lost:
            while not tuner.finished(progress):
                if lost:
                    raise KeyboardInterrupt
                progress = tuner.advance(progress)
                cost, _, _, latched, gradient = progress.history[-1][1:6]
                notes = f"cost {cost:.4f} best {progress.best[1]:.4f} |grad| {gradient:.2g} latched {latched:.0f}"
                bar.set_postfix_str(notes, refresh=False)
                bar.update()
                if progress.iteration % every == 0:
                    runs.save(out, progress)
    finally:  # also on Ctrl-C: the folder then holds the best gains so far, and --resume goes on
        bar.close()
        if progress.history:
            runs.save(out, progress)
            runs.write_history(out / "history.csv", names, progress)
            runs.write(out / "gains.toml", configuration.gains_table(tuner.best(progress)))
    return progress


@contextlib.contextmanager
def _interrupts() -> Iterator[list[int]]:
    """The interrupts that came: compiled code that is calling back into Python may swallow the exception itself."""
    came: list[int] = []

    def note(number: int, frame: Any) -> None:
        came.append(number)
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, note) if threading.current_thread() is threading.main_thread() else None
    try:
        yield came
    finally:
        if before is not None:
            signal.signal(signal.SIGINT, before)


def _conclude(
    arguments: argparse.Namespace,
    config: Config,
    tuner: Tuner,
    progress: Progress,
    tuned: Any,
    stability: dict[str, float],
    out: Path,
) -> int:
    """Judge the gains before and after on both ensembles, draw, and write the report."""
    draws, sizes = config.ensemble.draws, config.ensemble
    seen, unseen = tuner.batch, sample(config.scenario, draws, sizes.validation_size, config.seed + 1)
    both = agvjax.batch(config.scenario, {n: np.concatenate([seen.values[n], unseen.values[n]]) for n in seen.names})
    timing = config.simulate
    judged = {}
    for label, controller in (("before", config.controller), ("after", tuned)):
        metrics = agvjax.evaluate(
            _as_arrays(controller),
            both,
            dt=timing.dt,
            n_steps=steps_of(timing.horizon, timing.dt),
            control_every=timing.control_every,
            integrator=agvjax.INTEGRATORS[timing.integrator],
        )
        parts = {"tuning": slice(None, sizes.size), "validation": slice(sizes.size, None)}
        judged[label] = {
            k: report.judge(jax.tree.map(lambda x, p=p: np.asarray(x)[p], metrics)) for k, p in parts.items()
        }
    scenes = {"nominal": config.scenario, "worst": unseen[judged["after"]["validation"].worst_index]}
    titles = {"nominal": "nominal scenario", "worst": "validation scenario with the largest error of the tuned gains"}
    for name, scene in scenes.items():
        old, new = (_trajectory(config, _as_arrays(c), _as_arrays(scene)) for c in (config.controller, tuned))
        runs.write_figure(out / f"{name}.png", report.tracking_figure(old, new, titles[name]))
    names = tuner.free.names
    runs.write_figure(out / "history.png", report.history_figure(names, progress.history))
    over = report.unmet(judged["before"]["tuning"], judged["after"]["tuning"], config.tune.limits)
    text = report.page(config, names, tuned, stability, judged, over, progress)
    runs.write(out / "report.md", text)
    _say(arguments, text, f"gains, report and figures written to {out}")
    return 0


def _as_arrays(tree: Any) -> Any:
    """Leaves as arrays of one kind, so that gains before and after, nominal and drawn scenes share a compilation."""
    return agvjax.check(tree)


def _spoken(metrics: agvjax.Metrics) -> dict[str, Any]:
    """Metrics for `metrics.json`: a channel that has not settled says so and gives no number."""
    spoken: dict[str, Any] = {"ok": bool(metrics.ok)}
    for field in dataclasses.fields(metrics):
        if field.name in ("ok", "settled"):
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
