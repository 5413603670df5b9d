"""Run folders: every file complete or absent, nothing in them ever executed."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import jax
import numpy as np

from .optimise import HISTORY, Progress

CHECKPOINT = "checkpoint.npz"


def write(path: Path, data: str | bytes) -> None:
    """Write a file so that a crash leaves the old one or the new one, never a part."""
    part = path.with_name(f".{path.name}.part")
    with part.open("wb") as file:
        file.write(data.encode() if isinstance(data, str) else data)
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)


def write_npz(path: Path, arrays: dict[str, Any]) -> None:
    """Arrays under their names, without pickle."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **{name: np.asarray(value) for name, value in arrays.items()})
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
    writer.writerows([repr(x) if isinstance(x, float) else x for x in row] for row in rows)
    write(path, buffer.getvalue())


def write_figure(path: Path, figure: Any) -> None:
    """A matplotlib figure, as PNG or PDF by the name of the file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format=path.suffix[1:], dpi=130)
    write(path, buffer.getvalue())


def write_history(path: Path, names: tuple[str, ...], progress: Progress) -> None:
    """A row an iteration."""
    header = (*HISTORY, *names)
    whole = [name in ("iteration", "latched", "clipped", "skipped") for name in header]
    rows = [[int(x) if w else x for w, x in zip(whole, row, strict=True)] for row in progress.history]
    write_csv(path, header, rows)


def save(folder: Path, progress: Progress) -> None:
    """The checkpoint: enough to go on to the same result."""
    leaves = jax.tree.leaves(progress.optimiser)
    state = {f"optimiser_{i}": leaf for i, leaf in enumerate(leaves)}
    rest = {k: v for k, v in progress._asdict().items() if k != "optimiser"}
    write_npz(folder / CHECKPOINT, state | rest)


def load(folder: Path, fresh: Progress) -> Progress:
    """The progress saved in a folder; `fresh` gives the structure.

    Raises:
        ValueError: the checkpoint is missing, cut short, or of another problem; the message names the file.
    """
    path = folder / CHECKPOINT
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
            saved = dict(file)
        leaves, treedef = jax.tree.flatten(fresh.optimiser)
        if f"optimiser_{len(leaves)}" in saved:
            raise ValueError("it is of another optimiser")
        state = [_same(saved[f"optimiser_{i}"], leaf) for i, leaf in enumerate(leaves)]
        return Progress(
            iteration=int(saved["iteration"]),
            z=_same(saved["z"], fresh.z),
            optimiser=jax.tree.unflatten(treedef, state),
            best_z=_same(saved["best_z"], fresh.z),
            best=(float(saved["best"][0]), float(saved["best"][1])),
            best_iteration=int(saved["best_iteration"]),
            clipped=int(saved["clipped"]),
            skipped=int(saved["skipped"]),
            history=[tuple(float(x) for x in row) for row in saved["history"]],
        )
    except Exception as error:  # NumPy and zipfile raise half a dozen kinds for a damaged file
        raise ValueError(f"{path} cannot be resumed from: {type(error).__name__}: {error}") from error


def _same(saved: np.ndarray, like: Any) -> Any:
    if saved.shape != np.shape(like) or saved.dtype != like.dtype:
        raise ValueError(
            f"it holds an array {saved.dtype}{saved.shape} where the problem has {like.dtype}{np.shape(like)}"
        )
    return saved if isinstance(like, np.ndarray) else jax.numpy.asarray(saved)
