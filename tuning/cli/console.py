"""What a command says, and how it ends."""

from __future__ import annotations

import argparse
import contextlib
import signal
import threading
from collections.abc import Iterator
from typing import Any


class RunFailed(Exception):
    """The input was good and the run was not."""


def ticker(bar: Any) -> Any:
    """Progress by name: one part done, and which."""

    def tick(name: str) -> None:
        bar.set_postfix_str(name, refresh=False)
        bar.update()

    return tick


def say(arguments: argparse.Namespace, *lines: str) -> None:
    """Print, unless told to be quiet."""
    if not arguments.quiet:
        print(*lines, sep="\n", flush=True)


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
