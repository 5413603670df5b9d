"""Run folders: new ones, and those of a run to go on with."""

from __future__ import annotations

import argparse
import itertools
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from agvjax import Fault, InputError

from ..config import Config, dump
from ..config.old import difference
from ..io import files


def new_folder(name: str | None, command: str, config: Config | None = None) -> Path:
    """Make the folder to write to, which must be new or empty, and try to write there.

    What a process that was killed has half written does not count.

    Args:
        name: of the folder; None for one under `runs` named by command and time.
        command: that writes there.
        config: written as `config.toml`; without it the folder stays empty.
    """
    try:
        out = _by_time(command) if name is None else Path(name)
        out.mkdir(parents=True, exist_ok=True)
        taken = not files.empty(out)
        if not taken:
            files.probe(out)
            files.sweep_up(out)
    except (OSError, ValueError) as error:
        raise _unwritable(name, error) from error
    if taken:
        raise not_empty(out, command)
    if config is not None:
        files.write(out / "config.toml", dump(config))
    return out


@contextmanager
def begun_in(name: str | None, command: str) -> Iterator[Path]:
    """A new folder as of `new_folder`, which goes again where the command ends before anything stands in it.

    A folder that was there before, empty, stays.
    """
    before = name is not None and os.path.isdir(name)
    out = new_folder(name, command)
    try:
        yield out
    except BaseException:  # an interrupt too
        if not before and not any(out.iterdir()):
            out.rmdir()
        raise


def usable(name: str | None, command: str) -> None:
    """Refuse what `new_folder` would refuse and make nothing, for a command that has long work before it writes.

    Args:
        name: of the folder; None for one under `runs`.
        command: that writes there.
    """
    out = Path(name or "runs")
    try:
        there = next(path for path in (out, *out.parents) if path.exists())
        files.probe(there)
        taken = name is not None and there == out and not files.empty(out)
    except (OSError, ValueError) as error:
        raise _unwritable(name, error) from error
    if taken:
        raise not_empty(out, command)


def _unwritable(name: str | None, error: Exception) -> InputError:
    return InputError([Fault("--out", name or "runs", f"a folder that can be written ({error})")])


def not_empty(out: Path, command: str) -> InputError:
    """What is said of a folder that a command cannot begin in."""
    rule = "a new or empty folder: this one is not empty; choose another"
    rule += ", or add --resume to continue the run in it" if command in ("tune", "speed", "compare", "pareto") else ""
    return InputError([Fault("--out", str(out), rule)])


def _by_time(command: str) -> Path:
    """A folder under `runs` that nobody else has made: two commands may begin in one second."""
    name, more = f"runs/{command}-{time.strftime('%Y%m%d-%H%M%S')}", ""
    for i in itertools.count(2):
        try:
            Path(name + more).mkdir(parents=True)
            break
        except FileExistsError:
            more = f"-{i}"
    return Path(name + more)


def begin(arguments: argparse.Namespace, config: Config) -> Path:
    """The folder of a command that has `--resume`: a new one, or with it that of the run to go on with."""
    make = same_folder if arguments.resume else new_folder
    return make(arguments.out, arguments.command, config)


def same_folder(name: str | None, command: str, config: Config) -> Path:
    """The folder of a run to go on with; its settings must be those of `config`.

    One that is there and empty is that of a run that was killed before it wrote anything: it begins.
    """
    out = Path(name or os.devnull)
    try:
        if files.empty(out):
            return new_folder(name, command, config)
    except OSError as error:
        raise _no_run(name, error) from error
    same_settings(out, config)
    files.sweep_up(out)
    return out


def same_settings(out: Path, config: Config, key: str = "--resume") -> None:
    """Refuse a folder whose settings are not those of `config`; `key` is the option that names it."""
    try:
        before = files.text(out / "config.toml")
    except (OSError, ValueError) as error:
        raise _no_run(str(out), error, key) from error
    try:
        changed = difference(before, dump(config))
    except ValueError as error:
        rule = f"a run whose config.toml is whole; {out / 'config.toml'} is damaged ({error})"
        raise InputError([Fault(key, str(out), rule)]) from error
    if changed:
        raise InputError([Fault(key, str(out), f"the run that these settings began; changed: {changed}")])


def _no_run(name: str | None, error: Exception, key: str = "--resume") -> InputError:
    rule = "used with --out, the folder of a run: there is no config.toml in it that can be read"
    return InputError([Fault(key, name or "without --out", f"{rule} ({error})")])


def of_run(name: str, file: str) -> str:
    """A file by its name, or of a run by the name of its folder."""
    return str(Path(name) / file) if Path(name).is_dir() else name
