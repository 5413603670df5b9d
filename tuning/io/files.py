"""Writers of files: a crash leaves the whole old file or the whole new one, never a part."""

from __future__ import annotations

import contextlib
import csv
import errno
import io
import json
import os
import stat
import tempfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from .marks import LOCK, lives, mark, silent

if TYPE_CHECKING:
    from jaxtyping import ArrayLike  # which imports JAX, and readers of logs do without

NO_WAIT = 0 if os.name == "nt" else os.O_NONBLOCK
Json = dict[str, Any]  # a table of a JSON file


LARGEST = 10_000_000  # bytes of a file that is read as settings


def content(path: Path, most: int = LARGEST) -> bytes:
    """All bytes of a file.

    Raises:
        OSError: it cannot be read, or is no regular file: a pipe or a device may never end.
        ValueError: it has more than `most` bytes.
    """
    number = os.open(path, os.O_RDONLY | NO_WAIT)  # a pipe would wait for a writer
    mode = os.fstat(number).st_mode
    if not stat.S_ISREG(mode):
        os.close(number)
        raise OSError(errno.EINVAL, "it is a folder" if stat.S_ISDIR(mode) else "it is no regular file", str(path))
    with open(number, "rb") as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise ValueError(f"it has more than {most} bytes: {path}")
    return data


def text(path: Path, most: int = LARGEST) -> str:
    """The text of a file in UTF-8, with or without a byte order mark, its line ends as Python has them.

    Raises:
        OSError: as `content`.
        ValueError: as `content`, or it is no text.
    """
    return io.TextIOWrapper(io.BytesIO(content(path, most)), encoding="utf-8-sig").read()


def write(path: Path, data: str | bytes) -> None:
    """Write text or bytes."""
    part = path.with_name(f".{path.name}.{mark()}.part")  # others may write the same file
    try:
        with part.open("wb") as file:
            file.write(data.encode() if isinstance(data, str) else data)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    except BaseException:  # Ctrl-C too
        part.unlink(missing_ok=True)
        raise


def sweep_up(folder: Path) -> None:
    """Remove what was half written by processes that are gone, or of which nothing was heard for long."""
    for part in folder.glob(".*.part"):
        with contextlib.suppress(OSError):
            if _writer_lives(part) is False or silent(part):
                part.unlink(missing_ok=True)


def empty(folder: Path) -> bool:
    """Whether a folder holds nothing but its lock and what was half written by processes that may be gone."""
    there = (path for path in folder.iterdir() if path.name != LOCK)
    return all(path.match(".*.part") and path.is_file() and not _writer_lives(path) for path in there)


def probe(folder: Path) -> None:
    """Write a file in a folder, and let it go.

    Raises:
        OSError: there is no such folder, or nothing can be written in it.
    """
    tempfile.TemporaryFile(dir=folder, suffix=".part").close()


def bare(folder: Path) -> bool:
    """Whether a folder holds no more than a run that has only begun: settings, its lock, what was half written."""
    return all(path.name in ("config.toml", LOCK) or path.suffix == ".part" for path in folder.iterdir())


def _writer_lives(part: Path) -> bool | None:
    return lives(part.name.removesuffix(".part").rpartition(".")[2])


def write_by(path: Path, save: Callable[[BinaryIO], object]) -> None:
    """Write what `save` puts into the binary file that it is called with."""
    buffer = io.BytesIO()
    save(buffer)
    write(path, buffer.getvalue())


def write_npz(path: Path, arrays: Mapping[str, ArrayLike]) -> None:
    """Write arrays under their names, without pickle."""
    write(path, npz(arrays))


def npz(arrays: Mapping[str, ArrayLike]) -> bytes:
    """The bytes of a file of arrays under their names, without pickle; the same for the same arrays."""
    plain: dict[str, Any] = {name: np.asarray(value) for name, value in arrays.items()}
    if pickled := [name for name, value in plain.items() if value.dtype.hasobject]:
        raise TypeError(f"no arrays of plain numbers or text: {pickled}")
    buffer = io.BytesIO()
    np.savez(buffer, **plain)  # `allow_pickle` is an array's name to NumPy 2.0
    return buffer.getvalue()


def read_npz(path: Path) -> dict[str, np.ndarray]:
    """The arrays of a file by name, every byte of it checked.

    Raises:
        OSError: it cannot be read.
        ValueError: it is cut short or damaged, or holds what only pickle reads.
    """
    data = path.read_bytes()
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            return {str(name): file[name] for name in file}  # zip knows a checksum of each
    except Exception as error:  # NumPy and zipfile raise half a dozen kinds for a damaged file
        raise ValueError(f"{path} is cut short or damaged ({type(error).__name__}: {error})") from error


def write_json(path: Path, data: object) -> None:
    """Write JSON; infinities and NaN become null."""
    write(path, as_json(data))


def as_json(data: object) -> str:
    """The text of a JSON file; infinities and NaN become null."""
    return json.dumps(finite(data), indent=2) + "\n"


def finite(data: Any) -> Any:
    """Plain data with None for infinities and NaN, which JSON and Python literals cannot say."""
    if isinstance(data, dict):
        return {key: finite(value) for key, value in data.items()}
    if isinstance(data, (list, tuple)):
        return [finite(value) for value in data]
    return None if isinstance(data, float) and not np.isfinite(data) else data


def write_csv(path: Path, header: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    """Write a table with a header; numbers in full precision."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([repr(float(x)) if isinstance(x, float) else x for x in row] for row in rows)
    write(path, buffer.getvalue())
