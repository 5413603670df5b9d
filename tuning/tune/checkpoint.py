"""Run folders: every file complete or absent, nothing in them ever executed."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import jax
import numpy as np

from agvjax.metric_table import OLD_NAMES

from ..io.files import write, write_csv, write_npz
from .rounds import COLUMNS, Round, Run
from .tuner import Progress

CHECKPOINT, LOG = "checkpoint.npz", "metrics.jsonl"
COUNTS = ("round", "start", "iteration", "latched", "clipped", "backed_out", "rollouts")


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
            rounds=tuple(_round(*row) for row in json.loads(str(saved["rounds"]))),
            past=tuple(tuple(float(x) for x in row) for row in saved["past"]),
        )
    except Exception as error:  # NumPy and zipfile raise half a dozen kinds for a damaged file
        raise ValueError(f"{path} cannot be resumed from: {type(error).__name__}: {error}") from error


def _round(number: int, metric: str, best: float, worst_found: float) -> Round:
    return Round(number, OLD_NAMES.get(metric, metric), best, worst_found)


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
