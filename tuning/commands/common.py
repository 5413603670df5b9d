"""What the commands share: settings, run folders, messages, interruptions."""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import threading
import time
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import jax

import agvjax
from agvjax import InputError

from .. import config as configuration
from .. import distributed, runs, startup
from ..optimise import SEQUENTIAL, mode
from ..reader import flat
from ..settings import Config, steps_of


class RunFailed(Exception):
    """The input was good and the run was not."""


def ticker(bar: Any) -> Any:
    """Progress by name: one part done, and which."""

    def tick(name: str) -> None:
        bar.set_postfix_str(name, refresh=False)
        bar.update()

    return tick


def overrides(arguments: argparse.Namespace) -> list[str]:
    """Settings from the command line as `key=value`."""
    given = list(arguments.set)
    given += [] if arguments.seed is None else [f"seed={arguments.seed}"]
    return given + ([] if arguments.precision is None else [f"precision={arguments.precision}"])


def configure(arguments: argparse.Namespace, more: Mapping[str, Any] | None = None) -> Config:
    """Settings from files, options and `more` by dotted key, JAX made ready for them."""
    config = configuration.load(arguments.config, overrides(arguments), arguments.command, more)
    jax.config.update("jax_enable_x64", config.precision == 64)
    startup.keep_compiled()
    way = mode(config.tune.gradient, len(config.tune.gains)) if config.tune.optimizer != SEQUENTIAL else "forward"
    met = getattr(arguments, "coordinator", None) is not None
    said = agvjax.tune_xla(reverse=arguments.command in ("tune", "pareto") and way == "reverse")
    if met:
        _meet(arguments)
    if not said.startswith("fast"):
        say(arguments, f"note: {said}")
    return config


def _meet(arguments: argparse.Namespace) -> None:
    """Join the processes that tune together; all but the first fall silent."""
    place = rank_and_count(arguments)
    if place is None and arguments.coordinator != "auto":
        rule = "given with --coordinator HOST:PORT, and --process-id too"
        raise InputError([agvjax.Problem("--num-processes", "none", rule)])
    rank, count = place or (None, None)
    try:
        distributed.join(arguments.coordinator, count, rank)
    except (RuntimeError, ValueError) as error:
        raise RunFailed(f"the processes did not meet at {arguments.coordinator}: {error}") from error
    arguments.quiet = arguments.quiet or not distributed.chief()


def rank_and_count(arguments: argparse.Namespace) -> tuple[int, int] | None:
    """Which of how many processes this is, if the options say so."""
    rank, count = arguments.process_id, arguments.num_processes
    if rank is None and count is None:
        return None
    if rank is None or count is None:
        missing = "--num-processes" if count is None else "--process-id"
        raise InputError([agvjax.Problem(missing, "none", "given where the other of the two numbers is")])
    if not 0 <= rank < count:
        rule = f"from 0 to {count - 1}, one less than --num-processes"
        raise InputError([agvjax.Problem("--process-id", rank, rule)])
    return rank, count


def unasked(config: Config) -> None:
    """Refuse choices where only one problem is looked at."""
    if config.tune.choices:
        rule = "absent: only `agvjax tune` tries them; set one of each in [controller]"
        raise InputError([agvjax.Problem("tune.choices", list(config.tune.choices), rule)])


def warn(arguments: argparse.Namespace, config: Config, *sections: str) -> None:
    """Say of a step that is allowed and not advisable, and of a path that the vehicle cannot follow."""
    for name in sections:
        section = getattr(config, name)
        for note in agvjax.step_warnings(config.controller, section.dt, agvjax.INTEGRATORS[section.integrator]):
            say(arguments, f"note: {name}.{note}")
    for note in agvjax.path_problems(config.scenario, config.simulate.horizon):
        say(arguments, f"note: the path cannot be followed exactly: {note}")


def say(arguments: argparse.Namespace, *lines: str) -> None:
    """Print, unless told to be quiet."""
    if not arguments.quiet:
        print(*lines, sep="\n", flush=True)


def new_folder(arguments: argparse.Namespace) -> Path:
    """The folder to write to, which must be new or empty."""
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


def leave_folder(out: Path) -> None:
    """Nothing stays of a run whose input turned out to be wrong after its folder was made."""
    (out / "config.toml").unlink(missing_ok=True)
    with contextlib.suppress(OSError):  # something else was put there
        out.rmdir()


def same_folder(arguments: argparse.Namespace, config: Config) -> Path:
    """The folder of the run to go on with; its settings must be these."""
    out = Path(arguments.out or os.devnull)
    try:
        before = (out / "config.toml").read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        rule = "used with --out, the folder of a run: there is no config.toml in it"
        raise InputError([agvjax.Problem("--resume", arguments.out, rule)]) from error
    changed = difference(before, configuration.dump(config))
    if before and changed:
        rule = f"the run that these settings began; changed: {changed}"
        raise InputError([agvjax.Problem("--resume", str(out), rule)])
    return out


def difference(old: str, new: str) -> str:
    """What differs between two configurations in TOML, in words."""
    before, now = (dict(flat(tomllib.loads(text), ())) for text in (old, new))
    keys = [key for key in dict.fromkeys((*before, *now)) if before.get(key) != now.get(key)]
    told = [("was", before, key) for key in keys] + [("is", now, key) for key in keys]
    return "; ".join(f"{verb} `{key} = {table[key]}`" for verb, table, key in told if key in table)


def trajectory_of(config: Config, controller: Any, scenario: Any) -> agvjax.Trajectory:
    """A run with the timing of `simulate`."""
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


@contextlib.contextmanager
def interrupts() -> Iterator[list[int]]:
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


def as_arrays(tree: Any) -> Any:
    """Leaves as arrays of one kind, so that gains before and after, nominal and drawn scenes share a compilation."""
    return agvjax.check(tree)
