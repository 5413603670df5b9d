"""`agvjax new`: a problem to tune, of what is known of a vehicle."""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path

from agvjax import Fault, InputError

from ..config import begun
from ..config.load import load
from ..io import files
from ..tune.rules import faults
from .answers import answer, chosen, numbers_of, unfit
from .console import Console
from .questions import BY_CLOCK, KINDS


def run(arguments: argparse.Namespace) -> int:
    """Ask for what was not given, write the problem, and say how to go on."""
    console, out = Console(arguments.quiet), Path(arguments.out)
    if out.exists() or not out.parent.is_dir():
        raise InputError([Fault("--out", str(out), "a new file in a folder that is there")])
    asks = not arguments.quiet and interactive()
    kind = arguments.vehicle or chosen(asks, "--vehicle", "Which vehicle?", KINDS)
    unfit(arguments, kind)
    numbers = numbers_of(arguments, kind, asks, console)
    text = begun.by_clock(kind, numbers) if kind in BY_CLOCK else _followed(arguments, kind, numbers, asks, console)
    notes = _written(out, text)
    for note in [*notes, *(f"assumed: {line}" for line in ([] if kind in BY_CLOCK else begun.assumed(kind, numbers)))]:
        console.note(note)
    lines = sum(bool(line) and not line.startswith("#") for line in text.splitlines())
    console.say(
        f"{out} written, {lines} lines besides its comments. Continue with",
        f"  agvjax tune --config {out} --out tuned",
        "  agvjax simulate --config tuned/gains.toml --out run",
        "  agvjax export tuned/gains.toml --format c --out controller",
    )
    return 0


def interactive() -> bool:
    """Whether somebody can be asked."""
    return sys.stdin.isatty() and sys.stdout.isatty()


def _followed(arguments: argparse.Namespace, kind: str, numbers: dict[str, float], asks: bool, console: Console) -> str:
    """The problem of a vehicle that follows a path by where it is."""
    file = arguments.path
    if file is None and asks:
        file = answer("CSV file of its path, columns x and y (none: a rectangle of 10 x 5 m): ") or None
    if file is None:
        console.note("--path not given: a rectangle of 10 x 5 m")
        return begun.problem(kind, numbers, arguments.law or "path_pid", None, arguments.within)
    path = begun.points(file)
    closed = arguments.closed or path.closed
    if not closed and asks:
        closed = answer("Does it continue from its last point to its first? [y/N] ").lower().startswith("y")
    if not closed:
        console.note(f"{file}: open, ends at its last point (--closed: continues to its first)")
    path = dataclasses.replace(path, closed=closed)
    return begun.problem(kind, numbers, arguments.law or "path_pid", path, arguments.within)


def _written(out: Path, text: str) -> list[str]:
    """Write the file once `agvjax tune` would take it; what a person should know of it."""
    part = out.with_name(f".{out.name}.new")
    notes: list[str] = []
    try:
        files.write(part, text)
        load([str(part)], (), faults, note=notes.append)
        files.write(out, text)
    except OSError as error:
        raise InputError([Fault("--out", str(out), f"a file that can be written ({error})")]) from error
    finally:
        part.unlink(missing_ok=True)
    return notes
