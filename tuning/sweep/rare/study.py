"""A search for rare failures in a folder: what was prepared and every chunk of draws are kept, so that it can go on."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

import agvjax

from ... import config as configuration
from ...compute import schedule
from ...compute.jobs import Engine
from ...compute.packages import versions
from ...config.load import said
from ...config.settings import Config
from ...io import files
from ...io.alone import alone
from .. import verdict
from ..design import Design, design
from ..work import recorded
from . import chunks, loop
from .estimate import Drawn, Estimate, estimate
from .prepare import Prepared, prepare
from .problem import Problem, within
from .rules import faults

FOUND = "rare-search"  # the file of what was prepared
SHOWN = 6  # most likely failures that are kept
Said = Callable[[str], None]
Counted = Callable[[int], None]
Opened = Callable[[], AbstractContextManager[Engine]]


def silent(text: str) -> None:
    """Say nothing."""


def uncounted(vehicles: int) -> None:
    """Count nothing."""


HERE: Opened = functools.partial(schedule.opened, None, silent)


class Study(NamedTuple):
    """What is asked: of which vehicles, and what counts as a failure."""

    config: Config
    plan: Design
    bounds: dict[str, float]  # beyond which a run has failed
    judge: loop.Judge
    problem: Problem
    digest: str  # of the configuration, and of the packages that compute


class Point(NamedTuple):
    """A failure, one of the most likely."""

    distance: float  # from the middle of the ensemble, in standard deviations of a normal number
    share: float  # of the estimated probability that lies about it, among the points found
    u: np.ndarray  # (D,)
    leaves: dict[str, np.ndarray]
    metrics: dict[str, float]

    @property
    def importance(self) -> np.ndarray:
        """Squared direction cosines (D,): how much of the way is that of each number; their sum is 1."""
        square = self.u**2
        return square / max(float(square.sum()), np.finfo(float).tiny)


class Outcome(NamedTuple):
    """What a search came to."""

    prepared: Prepared
    draws: Drawn
    estimate: Estimate
    points: list[Point]  # the most likely first
    rollouts: int  # of the search and of the draws


def posed(config: Config, tick: Counted = uncounted) -> Study:
    """Of a configuration found sound.

    Args:
        config: with its `sweep`.
        tick: called with the number of vehicles that were rolled out.

    Raises:
        InputError: a bound is relative to a nominal run that has no value, or the nominal run fails.
    """
    plan = design(config)
    judged = jax.jit(loop.judge(config, plan, agvjax.check(config.controller), recorded(config)))
    bounds = verdict.bounds_of(config, plan, judged, SHOWN)
    text = configuration.dump(config, strict=False) + configuration.gains_table(config.controller)
    digest = hashlib.sha256(json.dumps([text, versions()]).encode()).hexdigest()[:32]
    problem = dataclasses.replace(loop.problem(config, plan, config.controller, bounds), tick=tick)
    return Study(config, plan, bounds, judged, problem, digest)


def begun(folder: Path) -> bool:
    """Whether a search has begun in a folder: it left something, or nothing is there but settings."""
    return (folder / "config.toml").exists() and (_left(folder) or files.bare(folder))


def _left(folder: Path) -> bool:
    """Whether a search has left something in a folder."""
    return any(path for name in (FOUND, chunks.DRAWS) for path in folder.glob(f"{name}*.npz"))


def search(config: Config, folder: str | Path) -> Outcome:
    """Look for rare failures in a folder, as `agvjax sweep --rare` does, without a report.

    Args:
        config: whose `sweep` says what is drawn (`over` without points, `ensemble`), what fails (`fails`), how many
            `rollouts` are made.
        folder: new, or with what an interrupted call left: what is kept there is not done again.

    Returns:
        The `Outcome`: `estimate` with the probability, its bounds and why they are not to be stated (`refused`), and
        `points`, the most likely failures.

    Raises:
        InputError: lists every bad setting; or another process is at work in the folder.
        ValueError: the folder holds something else.
    """
    asked, folder = posed(configuration.check(config, faults)), Path(folder)
    if folder.exists() and not (files.empty(folder) or _left(folder)):
        raise ValueError(f"{folder} holds something else than a search for rare failures")
    folder.mkdir(parents=True, exist_ok=True)
    with alone(folder, "folder"):
        return run(asked, folder, note=said)


def run(
    asked: Study,
    folder: Path,
    say: Said = silent,
    tick: Counted = uncounted,
    opened: Opened = HERE,
    imports: Sequence[str] = (),
    note: Said = silent,
) -> Outcome:
    """Search, draw, estimate; what the folder holds already is not done again.

    Args:
        asked: what.
        folder: where to keep it.
        say: is told what is done.
        tick: called with the number of vehicles that the folder holds already, and of draws that are made.
        opened: who rolls out the draws, called when they begin; the search is this process's.
        imports: files of classes of one's own, for workers.
        note: told what a user should know.

    Raises:
        tuning.compute.jobs.WorkFailed: workers failed; what is kept is whole, and the same call goes on.
    """
    say("looking for where vehicles fail")
    prepared = _prepared(asked, folder / f"{FOUND}.npz", tick, note)
    say("drawing there")
    parcel = chunks.parcel(asked.config, asked.bounds, prepared, _digest(asked.digest, prepared), imports)
    uncounting = dataclasses.replace(asked.problem, tick=uncounted)  # draws are counted when they are kept
    draws = chunks.drawn_in(folder, chunks.jobs(parcel, uncounting), opened, tick, note)
    made = estimate(prepared, draws, asked.problem.tail)
    points = _points(asked, prepared, draws) if made.failures else []
    return Outcome(prepared, draws, made, points, prepared.spent + rolled_out(draws))


def _prepared(asked: Study, path: Path, tick: Counted, note: Said) -> Prepared:
    """What to draw from: of its file, or searched for and kept there."""
    found = chunks.read(path, asked.digest)
    if found is not None:
        prepared = chunks.prepared_of(found)
        tick(prepared.spent)
        return prepared
    if path.exists():
        note(f"{path.name} is damaged, or of other settings or releases of {', '.join(versions())}: made again")
    prepared = prepare(asked.problem, asked.config.sweep.rollouts, asked.config.seed)
    files.write(path, chunks.packed(asked.digest, chunks.arrays(prepared)))
    return prepared


def rolled_out(draws: Drawn) -> int:
    """How many of the draws were simulated."""
    return int(within(draws.u).sum())


def _points(asked: Study, prepared: Prepared, draws: Drawn) -> list[Point]:
    """The failures that the mixture was made about, or those drawn near them that are more likely."""
    near = draws.failed & (draws.weights > 0)
    u, weights = draws.u[near], draws.weights[near]
    of_each = np.exp(prepared.mixture.ratios(u)[2:]) * prepared.mixture.shares[:, None]
    home = np.argmax(of_each, axis=0)
    shares = np.bincount(home, weights, len(prepared.mixture.points)) / weights.sum()
    best = []
    for i, point in enumerate(prepared.mixture.points):
        pool = np.concatenate([point[None][: int(point.any())], u[home == i]])  # the middle stands for none found
        if len(pool):
            best.append((shares[i], min(pool, key=lambda x: float(x @ x))))
    best = sorted(best, key=lambda pair: float(pair[1] @ pair[1]))[:SHOWN]
    filled = [place for _, place in best] + [best[-1][1]] * (SHOWN - len(best))  # one compilation serves any number
    leaves = loop.vehicles(asked.plan, np.array(filled))
    judged = asked.judge(leaves)
    return [
        Point(
            float(np.linalg.norm(place)),
            float(share),
            place,
            {name: np.asarray(x[i]) for name, x in leaves.items()},
            {name: float(x[i]) for name, x in judged.items() if name != "ok"},
        )
        for i, (share, place) in enumerate(best)
    ]


def _digest(digest: str, prepared: Prepared) -> str:
    """Of the draws that belong to what was prepared: on another machine it may be prepared to other digits."""
    return hashlib.sha256(
        digest.encode() + b"".join(np.asarray(x).tobytes() for x in chunks.arrays(prepared).values())
    ).hexdigest()
