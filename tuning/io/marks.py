"""What processes leave in a folder, so that others see whose it is: marks in names of files half written, a lock."""

from __future__ import annotations

import functools
import hashlib
import os
import platform
import re
import secrets
import sys
import time
import uuid
from pathlib import Path

LOCK = ".lock"  # an empty file that stays: removing it would let two in
STALE = 120.0  # s of silence after which what a process that cannot be asked for left lying is nobody's


def mark() -> str:
    """A mark that no other call returns, anywhere: where this process's number counts, the number, a random part."""
    return f"{_place()}-{os.getpid()}-{secrets.token_hex(4)}"


def lives(text: str) -> bool | None:
    """Whether the process of a mark lives; None where that cannot be told from here, or the text is no mark.

    A number of a process says nothing on another machine, after a restart, or in a container that counts its own.
    """
    parts = re.fullmatch(r"([0-9a-f]{12})-(\d{1,9})-[0-9a-f]{8}", text)
    if parts is None or parts[1] != _place():
        return None
    try:
        os.kill(int(parts[2]), 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def _age(path: Path) -> float:
    """Seconds since a file was touched, by the clock of its file system, which may not be ours; < 0: in the future.

    Raises:
        OSError: the file is gone, or nothing can be written beside it.
    """
    touched, probe = path.lstat().st_mtime, path.with_name(f".{mark()}.part")
    with probe.open("xb") as file:
        now = os.fstat(file.fileno()).st_mtime
    probe.unlink(missing_ok=True)
    return now - touched


def silent(path: Path) -> bool:
    """Whether nobody has touched a file for long, or it is dated far in the future: clocks were set."""
    if abs(time.time() - path.lstat().st_mtime) < STALE / 2:
        return False
    return abs(_age(path)) > STALE


@functools.cache
def _place() -> str:
    """Where a number of a process means the same as here: this start of this kernel, this count of processes."""
    try:
        facts = [Path("/proc/sys/kernel/random/boot_id").read_text(), os.readlink("/proc/self/ns/pid")]
    except OSError:  # no Linux: one count a machine; a Linux that does not say is alone
        facts = [secrets.token_hex()] if sys.platform == "linux" else [platform.node(), str(uuid.getnode())]
    return hashlib.sha256("\n".join(facts).encode()).hexdigest()[:12]
