"""Run folders: every file complete or absent, nothing in them ever executed."""

from __future__ import annotations

import csv
import io
import json
import os
import platform
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import jax
import numpy as np

from .optimise import Progress
from .rounds import COLUMNS, Round, Run

CHECKPOINT, LOG = "checkpoint.npz", "metrics.jsonl"
COUNTS = ("round", "start", "iteration", "latched", "clipped", "backed_out", "rollouts")


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
    from agvjax.animate import write_gif  # late: it draws

    buffer = io.BytesIO()
    write_gif(animation, buffer, tick)
    write(path, buffer.getvalue())


def write_history(folder: Path, names: tuple[str, ...], run: Run) -> None:
    """`history.csv`, a row an iteration and start."""
    write_csv(folder / "history.csv", (*COLUMNS, *names), [_whole(row) for row in run.history])


def write_log(folder: Path, names: tuple[str, ...], run: Run) -> None:
    """`metrics.jsonl` anew, as far as the run has come."""
    write(folder / LOG, "".join(_line(names, row) for row in run.history))


def log(folder: Path, names: tuple[str, ...], run: Run) -> None:
    """Append the rows of the last iteration to `metrics.jsonl`."""
    last = max(p.iteration for p in run.searches) - 1
    rows = [(run.round, i, *p.history[-1]) for i, p in enumerate(run.searches) if p.iteration == last + 1]
    with (folder / LOG).open("a", encoding="utf-8") as file:
        file.writelines(_line(names, row) for row in rows)


def _whole(row: Iterable[float]) -> list[float]:
    return [int(x) if i < len(COLUMNS) and COLUMNS[i] in COUNTS else x for i, x in enumerate(row)]


def _line(names: tuple[str, ...], row: Iterable[float]) -> str:
    plain = [x if np.isfinite(x) else None for x in _whole(row)]
    return json.dumps(dict(zip((*COLUMNS, *names), plain, strict=True))) + "\n"


def save(folder: Path, run: Run) -> None:
    """The checkpoint: enough to go on to the same result."""
    arrays: dict[str, Any] = {"round": run.round, "searches": len(run.searches), "past": run.past}
    arrays |= {f"added/{name}": value for name, value in run.added.items()}
    arrays["rounds"] = json.dumps(run.rounds)
    for i, p in enumerate(run.searches):
        leaves = jax.tree.leaves(p.optimiser)
        arrays |= {f"{i}/optimiser/{k}": leaf for k, leaf in enumerate(leaves)}
        arrays |= {f"{i}/{name}": value for name, value in p._asdict().items() if name != "optimiser"}
    write_npz(folder / CHECKPOINT, arrays)


def load(folder: Path, fresh: Run) -> Run:
    """The run saved in a folder; `fresh` gives the structure.

    Raises:
        ValueError: the checkpoint is missing, cut short, or of another problem; the message names the file.
    """
    path = folder / CHECKPOINT
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
            saved = dict(file)
        searches = tuple(_search(saved, i, fresh.searches[0]) for i in range(int(saved["searches"])))
        return Run(
            round=int(saved["round"]),
            searches=searches,
            added={name[6:]: value for name, value in saved.items() if name.startswith("added/")},
            rounds=tuple(Round(*row) for row in json.loads(str(saved["rounds"]))),
            past=tuple(tuple(float(x) for x in row) for row in saved["past"]),
        )
    except Exception as error:  # NumPy and zipfile raise half a dozen kinds for a damaged file
        raise ValueError(f"{path} cannot be resumed from: {type(error).__name__}: {error}") from error


def _search(saved: dict[str, Any], i: int, fresh: Progress) -> Progress:
    leaves, treedef = jax.tree.flatten(fresh.optimiser)
    if f"{i}/optimiser/{len(leaves)}" in saved:
        raise ValueError("it is of another optimiser")
    state = [_same(saved[f"{i}/optimiser/{k}"], leaf) for k, leaf in enumerate(leaves)]
    counts = {
        name: int(saved[f"{i}/{name}"]) for name in ("iteration", "best_iteration", "clipped", "backed_out", "rollouts")
    }
    points = {name: _same(saved[f"{i}/{name}"], fresh.z) for name in ("z", "sound_z", "best_z")}
    return Progress(
        optimiser=jax.tree.unflatten(treedef, state),
        best=(float(saved[f"{i}/best"][0]), float(saved[f"{i}/best"][1])),
        history=[tuple(float(x) for x in row) for row in saved[f"{i}/history"]],
        **points,
        **counts,
    )


def _same(saved: np.ndarray, like: Any) -> Any:
    if saved.shape != np.shape(like) or saved.dtype != like.dtype:
        raise ValueError(
            f"it holds an array {saved.dtype}{saved.shape} where the problem has {like.dtype}{np.shape(like)}"
        )
    return saved if isinstance(like, np.ndarray) else jax.numpy.asarray(saved)
