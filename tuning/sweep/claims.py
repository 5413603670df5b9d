"""Claims by which the processes of a sweep keep out of each other's way.

A claim only saves work: two that compute the same shard write the same bytes.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

from ..io import files
from ..io.marks import lives, mark, silent

CLAIM = "claim"
BEAT = 20.0  # s between signs of life of a claim


class Claim:
    """The right to compute one shard, or to write the report: a file that a thread touches as long as it is ours.

    Attributes:
        held: the marks of all claims of this process that are taken and not given back.
    """

    held: ClassVar[set[str]] = set()

    def __init__(self, folder: Path, name: str):
        self.path = folder / f"{name}.{CLAIM}"
        self.mark = mark()
        self._done = threading.Event()

    def take(self) -> bool:
        """Whether it is ours now; one that is held by a process that is gone is taken over.

        Raises:
            OSError: it cannot be written, or what lies in its place is no file.
        """
        if self.abandoned():
            self.path.unlink(missing_ok=True)
        try:
            with self.path.open("x") as file:
                file.write(self.mark)
        except FileExistsError:
            return False
        self.held.add(self.mark)
        threading.Thread(target=self._live, daemon=True).start()
        return True

    def release(self) -> None:
        """Give the claim back, unless another has taken it over."""
        self._done.set()
        self.held.discard(self.mark)
        with contextlib.suppress(OSError):
            if self.holder() == self.mark:
                self.path.unlink(missing_ok=True)

    def _live(self) -> None:
        while not self._done.wait(BEAT):
            with contextlib.suppress(OSError):
                if self.holder() == self.mark:
                    os.utime(self.path)

    def holder(self) -> str:
        """The mark that stands in it; anything may stand there."""
        with self.path.open("rb") as file:
            return file.read(100).decode(errors="replace")

    def abandoned(self) -> bool:
        """Whether its holder is gone, or has been silent for long.

        Raises:
            OSError: it is no file, and so nobody's claim.
        """
        try:
            if not stat.S_ISREG(self.path.lstat().st_mode):
                raise OSError(errno.EEXIST, "lies in the place of a claim and is no file: remove it", str(self.path))
            return lives(self.holder(), self.held) is False or silent(self.path)
        except FileNotFoundError:
            return False  # given back just now


@contextlib.contextmanager
def locked(folder: Path, name: str) -> Iterator[bool]:
    """Whether this process has the claim now; it is given back in the end."""
    claim = Claim(folder, name)
    ours = claim.take()
    try:
        yield ours
    finally:
        if ours:
            claim.release()


def sweep_up(folder: Path) -> None:
    """Remove what processes that are gone left lying."""
    files.sweep_up(folder)
    for path in folder.glob(f"*.{CLAIM}"):
        with contextlib.suppress(OSError):
            if Claim(folder, path.stem).abandoned():
                path.unlink(missing_ok=True)
