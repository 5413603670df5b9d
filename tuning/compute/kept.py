"""Files that save work at the next start: each carries its SHA-256, and lies where nobody else can write."""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Callable
from pathlib import Path

from ..io import files

SIZE = 32  # bytes of the SHA-256 in front


class Kept:
    """A folder of files by name, which are as they were written or are not there.

    What is in it is executed: a folder that another user owns or can write is not used.

    Attributes:
        folder: where they lie; None: nothing is kept.
        note: told what a user should know.
    """

    def __init__(self, folder: Path | None, note: Callable[[str], None]):
        self.folder, self.note = folder, note

    def get(self, name: str) -> bytes | None:
        """What was put under a name; None where there is none, or a damaged one, which is removed."""
        if self.folder is None:
            return None
        path = self.folder / name
        try:
            data = path.read_bytes()
        except OSError:
            return None
        if hashlib.sha256(data[SIZE:]).digest() == data[:SIZE]:
            return data[SIZE:]
        self.note(f"files in {self.folder.parent} were damaged: they are removed and made anew")
        self.drop(name)
        return None

    def put(self, name: str, data: bytes) -> None:
        """Keep this under a name, whatever was there; where that fails the next start does without."""
        if self.folder is None:
            return
        try:
            files.write(self.folder / name, hashlib.sha256(data).digest() + data)
        except OSError as error:
            self.note(f"nothing more can be kept in {self.folder} ({error.strerror}): the next start compiles again")
            self.folder = None

    def drop(self, name: str) -> None:
        """Remove what is kept under a name."""
        if self.folder is not None:
            try:
                (self.folder / name).unlink(missing_ok=True)
            except OSError as error:
                self.note(f"a file that is of no use cannot be removed from {self.folder} ({error.strerror})")


def private(root: Path, name: str) -> str:
    """Make the folder `name` under `root`, which this user alone can write; empty, or why it cannot be used."""
    folder = root / name
    try:
        root.parent.mkdir(parents=True, exist_ok=True)
        for place in (root, folder):
            place.mkdir(exist_ok=True, mode=0o700)
        files.write(folder / "probe", b"")
        (folder / "probe").unlink(missing_ok=True)
        return "" if os.name == "nt" else _shared(root) or _shared(folder) or _replaceable(root)
    except OSError as error:
        return f"{root} cannot be written ({error.strerror})"


def _shared(folder: Path) -> str:
    about = folder.stat()
    if about.st_uid != os.getuid():
        return f"{folder} belongs to another user"
    if about.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return f"other users can write {folder}: remove it, or set XDG_CACHE_HOME"
    return ""


def _replaceable(folder: Path) -> str:
    """Whether anybody can put another folder in its place."""
    mode = folder.parent.stat().st_mode
    return f"anybody can rename {folder}" if mode & stat.S_IWOTH and not mode & stat.S_ISVTX else ""
