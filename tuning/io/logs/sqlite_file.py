"""What is left of a bag of ROS 2 in SQLite that was cut off, which the database itself refuses to open."""

from __future__ import annotations

import contextlib
import functools
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from pathlib import Path

from .recording import Sent


def messages(path: Path, lost: list[str]) -> Iterator[Sent]:
    """Messages as far as the file goes.

    A copy is filled up with zeros to the length that its head tells, and read row by row without its index, until a
    page is met that is missing.

    Args:
        path: the .db3 file.
        lost: told what is missing.

    Raises:
        ValueError: nothing of it can be read.
    """
    from rosbags.typesys import Stores, get_typestore

    count, store = 0, get_typestore(Stores.ROS2_HUMBLE)
    with tempfile.TemporaryDirectory() as folder:
        try:
            with contextlib.closing(sqlite3.connect(_filled(path, Path(folder) / "whole.db3"))) as data:
                topics = {i: (name, kind) for i, name, kind in data.execute("SELECT id, name, type FROM topics")}
                for topic, stamp, raw in data.execute("SELECT topic_id, timestamp, data FROM messages NOT INDEXED"):
                    count += 1
                    name, kind = topics[topic]
                    yield name, kind, stamp, functools.partial(store.deserialize_cdr, raw, kind)
        except (sqlite3.DatabaseError, KeyError, OSError, TypeError) as error:
            if not count:
                raise ValueError(f"no bag of ROS that can be read ({path.name}: {error})") from error
    lost.append(f"{path.name} ends too early: {count} messages were read")


def _filled(path: Path, copy: Path) -> Path:
    """A copy as long as the head of the file says that it was."""
    with path.open("rb") as file:
        head = file.read(32)
    page, pages = int.from_bytes(head[16:18], "big"), int.from_bytes(head[28:32], "big")
    shutil.copyfile(path, copy)
    with copy.open("r+b") as file:
        file.truncate(max(pages * (65536 if page == 1 else page), path.stat().st_size))
    return copy
