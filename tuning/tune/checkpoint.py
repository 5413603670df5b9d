"""Run folders: every file complete or absent, nothing in them ever executed."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import jax
import numpy as np

from agvjax import Fault, InputError
from agvjax.metric_table import METRICS, OLD_NAMES

from ..config import dump, gains_table
from ..io.files import read_npz, write, write_csv, write_npz
from . import populations
from .methods.method import Progress
from .problem import TuningProblem
from .rounds import COLUMNS, Round, Run, begin
from .screen import Screened
from .tuner import HISTORY

CHECKPOINT, LOG = "checkpoint.npz", "metrics.jsonl"
TURNS = ("tightened", "promises")  # of a run, with a row a turn
COUNTS = ("round", "start", "iteration", "latched", "clipped", "backed_out", "rollouts")


class Recorder:
    """The folder of a run while its search goes on; a crash loses at most what came after the last checkpoint."""

    def __init__(self, folder: Path, problem: TuningProblem):
        self.folder, self.problem, self.names = folder, problem, problem.tuner.gains.names
        self.run = begin(problem)
        if (folder / CHECKPOINT).exists():
            try:
                self.run = load(folder, self.run)
                _suited(self.run, problem, folder / CHECKPOINT)
            except ValueError as error:
                rule = f"a run with a whole checkpoint ({error})"
                raise InputError([Fault("--resume", str(folder), rule)]) from error

    def begin(self) -> None:
        """Write the configuration, and the log as far as the run has come."""
        write(self.folder / "config.toml", dump(self.problem.config))
        write(self.folder / LOG, "".join(_line(self.names, row) for row in self.run.history))

    def record(self, run: Run) -> None:
        """After an iteration: a line of the log, and now and then the checkpoint."""
        before = [len(p.history) for p in self.run.searches] if self.run.round == run.round else []
        self.run = run
        looked = [(i, p) for i, p in enumerate(run.searches) if len(p.history) > (before[i] if i < len(before) else 0)]
        with (self.folder / LOG).open("a", encoding="utf-8") as file:
            file.writelines(_line(self.names, (run.round, i, *p.history[-1])) for i, p in looked)
        if max((p.iteration for _, p in looked), default=1) % self.problem.config.tune.checkpoint_every == 0:
            save(self.folder, run)

    def close(self) -> None:
        """Also after Ctrl-C: checkpoint, history and the best gains so far."""
        if self.run.lead.history:
            save(self.folder, self.run)
            write(self.folder / LOG, "".join(_line(self.names, row) for row in self.run.history))
            rows = [_whole(row) for row in self.run.history]
            write_csv(self.folder / "history.csv", (*COLUMNS, *self.names), rows)
            if np.isfinite(self.run.lead.best[1]):
                write(self.folder / "gains.toml", gains_table(self.problem.tuner.best(self.run.lead)))


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
    if run.screened is not None:
        arrays |= {f"screened/{name}": value for name, value in run.screened._asdict().items()}
    arrays |= {name: rows for name in TURNS if (rows := getattr(run, name)) is not None}
    arrays |= {"first": run.first, "held": run.held}
    arrays["drawn"] = [populations.drawn(p) for p in run.searches]
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
        saved = read_npz(path)
        searches = tuple(_search(saved, i, fresh.searches[0]) for i in range(int(saved["searches"])))
        if not searches or int(saved["round"]) < 0:
            raise ValueError("it holds no search")
        return Run(
            round=int(saved["round"]),
            searches=searches,
            added={name[6:]: value for name, value in saved.items() if name.startswith("added/")},
            rounds=tuple(_round(*row) for row in json.loads(str(saved["rounds"]))),
            past=tuple(tuple(float(x) for x in row) for row in saved["past"]),
            screened=_screened(saved, fresh.searches[0].z.size),
            tightened=saved.get("tightened"),
            promises=saved.get("promises"),
            first=int(saved.get("first", 0)),  # neither in an earlier release
            held=int(saved.get("held", -1)),
        )
    except Exception as error:  # what is in a whole file may be anything, too
        raise ValueError(f"{path} cannot be resumed from: {type(error).__name__}: {error}") from error


def _round(number: int, metric: str, best: float, worst_found: float) -> Round:
    metric = OLD_NAMES.get(metric, metric)
    if metric not in METRICS:
        raise ValueError(f"it holds a metric that nobody knows, {metric!r}")
    return Round(int(number), metric, float(best), float(worst_found))


def _screened(saved: dict[str, Any], gains: int) -> Screened | None:
    """What was seen before the first iteration; None for a run without a screening, or of an earlier release."""
    parts = {name: saved[f"screened/{name}"] for name in Screened._fields if f"screened/{name}" in saved}
    if not parts:
        return None
    looked, lost, rollouts = (int(parts[name]) for name in ("looked", "lost", "rollouts"))
    sizes = [parts["places"].shape[1:], parts["unit"].shape, parts["ranks"].shape]
    if (
        sizes != [(gains,), (gains,), (len(parts["places"]), 2)]
        or min(looked, lost, rollouts) < 0
        or not len(parts["places"])
    ):
        raise ValueError("it holds gain sets of another problem")
    return Screened(parts["places"], parts["ranks"], parts["unit"], looked, lost, rollouts)


def _row(row: np.ndarray, width: int) -> tuple[float, ...]:
    if len(row) != width:
        raise ValueError(f"it holds a row of history with {len(row)} numbers where the problem has {width}")
    return tuple(map(float, row))


def _suited(run: Run, problem: TuningProblem, path: Path) -> None:
    """Refuse history and scenarios that the problem could not have come to."""
    for row in run.past:
        _row(np.asarray(row), len(COLUMNS) + len(problem.tuner.gains.names))
    sizes = {"tightened": len(problem.tuner.objective.limits), "promises": len(problem.tuner.gains.names)}
    for name in TURNS:
        if (rows := getattr(run, name)) is not None and rows.shape[1:] != (sizes[name],):
            raise ValueError(f"{path} holds {name} of another problem")
    batch, places = problem.tuner.batch, problem.tuner.batch.size - problem.config.ensemble.size
    counts = {len(values) if np.ndim(values) else -1 for values in run.added.values()}
    if run.added and (set(run.added) != set(batch.names) or len(counts) > 1 or not 0 < max(counts) <= places):
        raise ValueError(f"{path} holds scenarios of another ensemble")
    for name, values in run.added.items():
        if values.dtype.kind != "f" or values.shape[1:] != np.shape(batch.values[name])[1:]:
            raise ValueError(f"{path} holds values of {name} of shape {values.shape[1:]}, {values.dtype}")


def _search(saved: dict[str, Any], i: int, fresh: Progress) -> Progress:
    saved = {f"{i}/moving": np.ones(fresh.z.size, bool)} | saved  # an earlier release held no gain
    moving = _same(saved[f"{i}/moving"], fresh.moving)
    if "drawn" in saved and saved["drawn"][i]:  # not in an earlier release
        fresh = fresh._replace(optimiser=populations.state(np.asarray(fresh.z)[moving]))
    leaves, treedef = jax.tree.flatten(fresh.optimiser)
    if f"{i}/optimiser/{len(leaves)}" in saved:
        raise ValueError("it is of another optimiser")
    state = [_same(saved[f"{i}/optimiser/{k}"], leaf) for k, leaf in enumerate(leaves)]
    values: dict[str, Any] = {name: saved[f"{i}/{name}"] for name in Progress._fields if name != "optimiser"}
    values["moving"] = moving
    values |= {name: _same(values[name], fresh.z) for name in ("z", "sound_z", "best_z")}
    counts = ("iteration", "best_iteration", "clipped", "backed_out", "rollouts")
    values |= {name: int(values[name]) for name in counts}
    if min(values[name] for name in counts) < 0:
        raise ValueError("it holds a count below 0")
    best, worse = map(float, values["best"])
    values |= {"best": (best, worse), "history": [_row(r, len(HISTORY) + fresh.z.size) for r in values["history"]]}
    return Progress(optimiser=jax.tree.unflatten(treedef, state), **values)


def _same(saved: np.ndarray, like: Any) -> Any:
    if saved.shape != np.shape(like) or saved.dtype != like.dtype:
        raise ValueError(
            f"it holds an array {saved.dtype}{saved.shape} where the problem has {like.dtype}{np.shape(like)}"
        )
    return saved if isinstance(like, np.ndarray) else jax.numpy.asarray(saved)
