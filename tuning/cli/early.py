"""Ctrl-C before a command has a handler of its own."""

import os
import signal


def _at_once(number: int, frame: object) -> None:
    """Libraries that are half imported cannot be left by an exception."""
    os.write(2, b"agvjax: interrupted\n")
    os._exit(130)


def end_at_once() -> None:
    """From now on Ctrl-C ends the process."""
    signal.signal(signal.SIGINT, _at_once)
