"""What the commands share: settings, run folders, messages, interruptions."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

import jax

import agvjax
from agvjax import InputError

from .. import config as configuration
from ..compute import compiled as startup
from ..compute import processes as distributed
from ..config.rules import Rules, faults
from ..config.settings import Config
from ..tune.tuner import SEQUENTIAL, mode
from .console import RunFailed, say


def overrides(arguments: argparse.Namespace) -> list[str]:
    """Settings from the command line as `key=value`."""
    given = list(arguments.set)
    given += [] if arguments.seed is None else [f"seed={arguments.seed}"]
    return given + ([] if arguments.precision is None else [f"precision={arguments.precision}"])


def configure(arguments: argparse.Namespace, rules: Rules = faults, more: Mapping[str, Any] | None = None) -> Config:
    """Settings from files, options and `more` by dotted key, checked by `rules`, JAX made ready for them."""
    config = configuration.load(arguments.config, overrides(arguments), rules, more)
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
        raise InputError([agvjax.Fault("--num-processes", "none", rule)])
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
        raise InputError([agvjax.Fault(missing, "none", "given where the other of the two numbers is")])
    if not 0 <= rank < count:
        rule = f"from 0 to {count - 1}, one less than --num-processes"
        raise InputError([agvjax.Fault("--process-id", rank, rule)])
    return rank, count


def unasked(config: Config) -> None:
    """Refuse choices where only one problem is looked at."""
    if config.tune.choices:
        rule = "absent: only `agvjax tune` tries them; set one of each in [controller]"
        raise InputError([agvjax.Fault("tune.choices", list(config.tune.choices), rule)])


def warn(arguments: argparse.Namespace, config: Config, *sections: str) -> None:
    """Say of a step that is allowed and not advisable, and of a path that the vehicle cannot follow."""
    for name in sections:
        timing = config.timing(name)
        for note in agvjax.step_warnings(config.controller, timing.dt, timing.integrator):
            say(arguments, f"note: {name}.{note}")
    for note in agvjax.path_warnings(config.scenario, config.simulate.horizon):
        say(arguments, f"note: the path cannot be followed exactly: {note}")


def trajectory_of(config: Config, controller: Any, scenario: Any) -> agvjax.Trajectory:
    """A run with the timing of `simulate`."""
    return agvjax.simulate(controller, scenario, save_every=config.simulate.save_every, **config.timing())


def as_arrays(tree: Any) -> Any:
    """Leaves as arrays of one kind, so that gains before and after, nominal and drawn scenes share a compilation."""
    return agvjax.check(tree)
