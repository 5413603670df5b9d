"""Files, each whole or absent."""

from __future__ import annotations

import csv
import io
import json
import os
import platform
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np


def write(path: Path, data: str | bytes) -> None:
    """Write a file so that a crash leaves the old one or the new one, never a part."""
    part = path.with_name(f".{path.name}.{platform.node()}-{os.getpid()}.part")  # others may write the same file
    try:
        with part.open("wb") as file:
            file.write(data.encode() if isinstance(data, str) else data)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    except BaseException:  # Ctrl-C too
        part.unlink(missing_ok=True)
        raise


def write_npz(path: Path, arrays: dict[str, Any]) -> None:
    """Arrays under their names, without pickle."""
    buffer = io.BytesIO()
    plain: dict[str, Any] = {name: np.asarray(value) for name, value in arrays.items()}
    if pickled := [name for name, value in plain.items() if value.dtype.hasobject]:
        raise TypeError(f"no arrays of plain numbers or text: {pickled}")
    np.savez(buffer, **plain)  # `allow_pickle` is an array's name to NumPy 2.0
    write(path, buffer.getvalue())


def write_json(path: Path, data: Any) -> None:
    """JSON for people and scripts; infinities and NaN become null, which JSON can say."""

    def plain(x: Any) -> Any:
        if isinstance(x, dict):
            return {key: plain(value) for key, value in x.items()}
        if isinstance(x, (list, tuple)):
            return [plain(value) for value in x]
        if isinstance(x, float):
            return x if np.isfinite(x) else None
        return x

    write(path, json.dumps(plain(data), indent=2) + "\n")


def write_csv(path: Path, header: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    """A table; numbers in full precision."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([repr(float(x)) if isinstance(x, float) else x for x in row] for row in rows)
    write(path, buffer.getvalue())


def write_figure(path: Path, figure: Any) -> None:
    """A matplotlib figure, as PNG or PDF by the name of the file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format=path.suffix[1:], dpi=130)
    write(path, buffer.getvalue())


def write_gif(path: Path, animation: Any, tick: Callable[[], Any] | None = None) -> None:
    """An animation as GIF; `tick` is called every frame."""
    from agvjax.draw.animate import write_gif  # late: it draws

    buffer = io.BytesIO()
    write_gif(animation, buffer, tick)
    write(path, buffer.getvalue())
