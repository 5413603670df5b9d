"""One process at a time in a folder, by a lock of the operating system: whoever is killed has it no longer."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

from agvjax import Fault, InputError

from .marks import LOCK


@contextlib.contextmanager
def alone(folder: Path, key: str = "--out") -> Iterator[None]:
    """Have a folder for this process alone.

    Between machines it holds where their file system passes locks on, as NFS does by default (not with `nolock` or
    `local_lock=flock`, nor Lustre with `localflock`).

    Args:
        folder: which is there.
        key: the option or argument that names it, for the message.

    Raises:
        InputError: another process has it.
        OSError: nothing can be written there.
    """
    from filelock import FileLock, Timeout  # late: few commands need it

    lock = FileLock(folder / LOCK)
    try:
        lock.acquire(timeout=0)
    except Timeout as error:
        rule = "a folder in which no other process is at work: wait until that one ends, or stop it"
        rule += "; workers share the work of one process: --scheduler"
        raise InputError([Fault(key, str(folder), rule)]) from error
    try:
        yield
    finally:
        lock.release()
