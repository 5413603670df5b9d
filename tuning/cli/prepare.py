"""From the options of a command to a checked configuration, with JAX ready for it."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence

import jax
import numpy as np

import agvjax
from agvjax import Fault, InputError

from .. import config as configuration
from ..compute import compiled, processes
from ..config import ends, whereabouts
from ..config.codecs import Toml
from ..config.ends import Moving
from ..config.rules import Rules, faults
from ..config.settings import Config
from ..tune.gains import names_of
from ..tune.methods import method
from .console import Console, RunFailed

BLUR = 0.01  # of a step, by which times may be rounded without a word


def overrides(arguments: argparse.Namespace) -> list[str]:
    """Settings from the command line as `key=value`."""
    options = {name: getattr(arguments, name) for name in ("seed", "precision")}
    return arguments.set + [f"{name}={value}" for name, value in options.items() if value is not None]


def configure(
    arguments: argparse.Namespace,
    rules: Rules = faults,
    more: Mapping[str, Toml] | None = None,
    moving: Callable[[Config], list[Moving]] = lambda config: [],
) -> tuple[Config, Console]:
    """The configuration of files, options and `more` by dotted key, checked by `rules`; and the console.

    What the command draws and sweeps, `moving`, says where vehicles start.

    JAX is set to its precision, keeps what it compiles, and has joined the other processes of the run.
    """
    old: list[str] = []
    config = configuration.load(arguments.config, overrides(arguments), rules, more, arguments.imports, note=old.append)
    jax.config.update("jax_enable_x64", config.precision == 64)
    compiled.keep_compiled()
    way = method(config.tune.optimizer)
    reverse = arguments.command in ("tune", "pareto", "speed") and not way.forward(config.tune, len(names_of(config)))
    speed = agvjax.tune_xla(reverse=reverse)
    _meet(arguments)
    if wrong := whereabouts.faults(config, moving(config)):
        raise InputError(wrong)
    console = Console(arguments.quiet or not processes.chief())
    compiled.listen(console.note)
    if not speed.startswith("fast"):
        console.note(speed)
    for text in dict.fromkeys(old):
        console.warn(text)
    return config, console


def _meet(arguments: argparse.Namespace) -> None:
    """Join the processes that tune together, if there are several."""
    if arguments.command != "tune":
        return
    place, coordinator = rank_and_count(arguments.process_id, arguments.num_processes), arguments.coordinator
    if coordinator is None:
        if place is not None:
            rule = "given with --coordinator HOST:PORT, where the processes meet"
            raise InputError([Fault("--num-processes", arguments.num_processes, rule)])
        return
    host, _, port = coordinator.rpartition(":")
    usable = host.strip("[]") and port.isascii() and port.isdecimal() and 0 < int(port[:6]) < 65536
    if coordinator != "auto" and not usable:
        raise InputError([Fault("--coordinator", repr(coordinator), "HOST:PORT, of process 0; or auto")])
    if place is None and coordinator != "auto":
        rule = "given with --coordinator HOST:PORT, and --process-id too"
        raise InputError([Fault("--num-processes", "none", rule)])
    rank, count = place or (None, None)
    Console(arguments.quiet).note(f"waiting up to {processes.MEETING} s for the other processes")
    try:
        processes.join(coordinator, count, rank)
    except (RuntimeError, ValueError, OSError) as error:
        raise RunFailed(f"the processes did not meet at {coordinator}: {error}") from error


def rank_and_count(rank: int | None, count: int | None) -> tuple[int, int] | None:
    """Which of how many processes this is, if `--process-id` and `--num-processes` say so."""
    if rank is None and count is None:
        return None
    if rank is None or count is None:
        missing = "--num-processes" if count is None else "--process-id"
        raise InputError([Fault(missing, "none", "given where the other of the two numbers is")])
    if not 0 <= rank < count:
        rule = f"from 0 to {count - 1}, one less than --num-processes"
        raise InputError([Fault("--process-id", rank, rule)])
    return rank, count


def warn(console: Console, config: Config, *sections: str, moving: Sequence[Moving] = ()) -> None:
    """Say of a time step that it is coarse, of a path that the vehicle cannot follow it, and what may not be meant.

    Args:
        console: where to say it.
        config: whose controller and scenario.
        sections: the sections of the configuration whose time steps are used: simulate, tune, sweep.
        moving: what is drawn and swept.
    """
    for name in sections:
        timing = config.timing(name)
        for text in agvjax.step_warnings(config.controller, timing.dt, timing.integrator):
            console.note(f"{name}.{text}")
        if blur := blurred_clock(config, name):
            console.note(blur)
    for text in agvjax.path_warnings(config.scenario, config.simulate.horizon):
        console.note(f"the path cannot be followed exactly: {text}")
    if unchecked := agvjax.path_unchecked(config.scenario, config.simulate.horizon):
        console.note(f"whether the path can be followed was not checked: {unchecked}")
    for text in (*whereabouts.notes(config, moving), *ends.elsewhere(config, moving)):
        console.note(text)


def blurred_clock(config: Config, section: str) -> str:
    """Of a run so long that single precision rounds its time by a part of a step that is felt; empty for others.

    The reference is then late or early by as much at every step, differently, and the commands follow it.
    """
    horizon, dt = config.simulate.horizon, config.timing(section).dt
    if config.precision == 64 or (apart := float(np.spacing(np.float32(horizon)))) < BLUR * dt:
        return ""
    return (
        f"in 32 bits (precision) times are {apart:.2g} s apart at the end of a run of {horizon:g} s (simulate.horizon),"
        f" {apart / dt:.0%} of {section}.dt: chatter and variation come out too large; --precision 64 has no such limit"
    )
