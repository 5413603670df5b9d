"""What a command says, and how it ends."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from types import FrameType

from agvjax import Fault, InputError

from ..io.terminal import plain
from .phases import Phases


class RunFailed(Exception):
    """The input was good and the run failed all the same: exit code 1."""


@dataclasses.dataclass(frozen=True)
class Console:
    """Where a command prints.

    Attributes:
        quiet: print nothing but errors.
    """

    quiet: bool = False

    def say(self, *lines: str) -> None:
        """Print lines on standard output."""
        if not self.quiet:
            print(*lines, sep="\n", flush=True)

    def note(self, text: str) -> None:
        """Print what the user should know, on standard output."""
        self.say(f"note: {text}")

    def warn(self, text: str) -> None:
        """Print what the user should change one day, on standard error."""
        if not self.quiet:
            print(f"note: {text}", file=sys.stderr, flush=True)

    def conclude(self, text: str, *paths: str) -> None:
        """Print what a report, in Markdown, says in short, and where the whole of it is."""
        self.say("", plain(text), *paths)

    @contextlib.contextmanager
    def phases(self) -> Iterator[Phases]:
        """What the command does, phase by phase, on standard error; the last one ends with the block."""
        phases = Phases(self.quiet)
        try:
            yield phases
        except BaseException:
            phases.end("stopped")
            raise
        phases.end()

    @contextlib.contextmanager
    def parts(
        self, name: str, total: int, unit: str = "parts", failures: tuple[type[Exception], ...] = (RuntimeError,)
    ) -> Iterator[Callable[[str], None]]:
        """A phase of work in named parts: call what it yields with the name of each part that is done.

        Bad input stays an `InputError`; the other `failures` of the work become a `RunFailed`.
        """
        with self.phases() as phases, failing(failures):
            phase = phases.begin(name, total, unit)

            def tick(part: str) -> None:
                phase.note(part)
                phase.advance()

            yield tick


def unreadable(arguments: argparse.Namespace) -> list[Fault]:
    """Options whose value is no text: a file name of other bytes could be written in no file of settings, no report."""
    return [
        Fault(f"--{name}", repr(text), "text in UTF-8")
        for name, value in vars(arguments).items()
        for text in (value if isinstance(value, list) else [value])
        if isinstance(text, str) and (any(map(_surrogate, text)) or "\0" in text)
    ]


def _surrogate(letter: str) -> bool:
    return 0xD800 <= ord(letter) <= 0xDFFF


@contextlib.contextmanager
def failing(failures: tuple[type[Exception], ...] = (RuntimeError,)) -> Iterator[None]:
    """Turn these errors into a `RunFailed` of the same message, but bad input."""
    try:
        yield
    except InputError:
        raise
    except failures as error:
        raise RunFailed(str(error)) from error


@contextlib.contextmanager
def interrupts() -> Iterator[list[int]]:
    """The interrupts (Ctrl-C) so far: compiled code that calls back into Python may swallow the exception itself."""
    signals: list[int] = []

    def interrupt(number: int, frame: FrameType | None) -> None:
        signals.append(number)
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, interrupt) if threading.current_thread() is threading.main_thread() else None
    try:
        yield signals
    finally:
        if before is not None:
            signal.signal(signal.SIGINT, before)
