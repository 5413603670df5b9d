"""Problems that others pose, in benchmarks/problems/: `agvjax tune` beside what people use instead.

Same objective, ensemble and compiled rollout for all. Ours screens and then searches, once a seed; CMA-ES is the
reference: it gets `MOST` rollouts, and begins again elsewhere where it has converged; Optuna's TPE, random search and
Nelder-Mead get as many rollouts as ours took in all with the first seed (TPE at most 600). Seeds are those of our
searches: the ensemble stays the same, so all costs of a problem are of one function and the best of anybody is one
number. Every method's best is the set with the least excess over the limits and, of these, the lowest goal, which is
how the tuner compares; peers are asked to minimise goal + 30 x excess. Where every run diverges with the configured
gains, the unit of all costs is that of our screening with the first seed, also for our other seeds. Limits are kept at
the step of tuning by all; ours are kept at the finer step of `simulate` too, and by how much CMA-ES's best exceeds them
there is `cma_over_finer`.

`python -m benchmarks problems --seeds 5 --most 20000 --only agv late`; without options one seed and `MOST`.
`--scheduler local:4` shares the problems among workers. What is done is kept in build/problems/: the same command on
the same commit goes on.
"""

from __future__ import annotations

import dataclasses
import json
import multiprocessing
import statistics
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from . import history
from .tuning import TPE_BUDGET, Recorder, Spent, search

FOLDER = Path(__file__).with_name("problems")
KEPT = Path(__file__).parents[1] / "build" / "problems"
POSED: dict[str, tuple[str, ...]] = {  # presets and files of classes that each is given besides
    "agv": (),
    "pid-unicycle": ("unicycle", "pid.py"),
    "pid-robot": ("robot", "pid.py"),
    "ftsmc": (),
    "asmc": (),
    "dfc": (),
    "ice": ("car",),
    "late": ("unicycle",),
    "noise": (),
    "impossible": (),
    "diverging": (),
    "many": ("pid.py",),
    "everything": (),
    "one": (),
    "two-mass": ("rigs.py",),
    "ball-beam": ("rigs.py",),
    "cart-pole": ("rigs.py",),
}
PEERS = ("cma", "tpe", "random", "nelder-mead")
EXCESS = 30.0  # what a peer pays for an excess
MOST = 1500  # rollouts of CMA-ES, once


def load(name: str, settings: tuple[str, ...] = ()) -> Any:
    """The configuration of a problem."""
    from tuning import config
    from tuning.tune.rules import faults

    given = POSED[name]
    files = [*(g for g in given if not g.endswith(".py")), str(FOLDER / f"{name}.toml")]
    imports = [str(FOLDER / g) for g in given if g.endswith(".py")]
    return config.load(files, list(settings), faults, imports=imports)


class Nobody:
    """Looks for no worst scenario: that comes after tuning, and no peer does it."""

    def search(self, z: Any, round_: int = 0) -> list[Any]:
        """Nothing found."""
        return []


class Best:
    """The best rank that a method saw: sum of excesses, then goal."""

    def __init__(self) -> None:
        self.rank, self.place = (np.inf, np.inf), None

    def saw(self, z: np.ndarray, excess: float, goal: float) -> None:
        """One more look."""
        if np.isfinite(goal) and (excess, goal) < self.rank:
            self.rank, self.place = (excess, goal), np.array(z)


def attempts(name: str, seeds: int, most: int) -> list[dict[str, Any]]:
    """Every method on one problem, ours first and from every seed, the peers from the first."""
    import agvjax

    agvjax.tune_xla(devices=1)
    import jax

    jax.config.update("jax_enable_x64", True)
    from tuning.tune.finer import before_and_after, levels
    from tuning.tune.methods.objective import TOLERANCE
    from tuning.tune.problem import pose

    problem = pose(load(name))._replace(adversary=Nobody())
    jax.block_until_ready(
        problem.tuner.push(problem.tuner.gains.coordinates(problem.config.controller), problem.tuner.scenarios())
    )
    jax.block_until_ready(problem.screen.tuner.roll(*problem.screen.example()))
    ended = [solved(problem._replace(screen=dataclasses.replace(problem.screen, seed=seed))) for seed in range(seeds)]
    tuner = ended[0][1]
    rows = [{"method": "sqp", "seed": i, "gains": len(tuner.gains.names)} | own for i, (own, _, _) in enumerate(ended)]
    try:
        _ = tuner.baseline
    except RuntimeError:
        return rows  # nothing to measure anybody in
    judge = jax.jit(lambda z: tuner.objective.score(*tuner.values(z, tuner.scenarios()), tuner.baseline))
    start = np.asarray(tuner.gains.coordinates(tuner.controller))
    judge(start).cost.block_until_ready()

    def look(z: Any) -> tuple[Any, Any]:
        return tuner.objective.ranks(judge(np.asarray(z, float)))

    for row, (_, _, place) in zip(rows, ended, strict=True):
        if place is not None:  # in the unit of the first
            row["excess"], row["goal"] = (float(x) for x in look(place))
    budget = rows[0]["rollouts"]
    budgets = {"cma": most, "tpe": min(budget, TPE_BUDGET), "random": budget, "nelder-mead": budget}
    peers = [spent(method, look, start, 0, budget) for method, budget in budgets.items()]
    reference, place = peers[0]
    if place is not None:
        metrics = before_and_after(problem, tuner.gains.controller(place, tuner.controller))
        reference["over_finer"] = float(np.maximum(levels(problem, metrics) - 1 - TOLERANCE, 0).sum())
    return rows + [row for row, _ in peers]


def spent(
    method: str, look: Any, start: np.ndarray, seed: int, budget: int
) -> tuple[dict[str, Any], np.ndarray | None]:
    """What a peer comes to with so many rollouts, and where."""
    best, recorder = Best(), Recorder(budget)

    def cost(z: Any) -> float:
        excess, goal = (float(x) for x in look(z))
        best.saw(z, excess, goal)
        value = goal + EXCESS * excess
        recorder.saw(value, 1)
        return value if np.isfinite(value) else 1e12

    try:
        search(method, cost, start, seed, elsewhere=True)
    except Spent:
        pass
    seconds = time.process_time() - recorder.begin
    row = {"method": method, "seed": seed, "excess": best.rank[0], "goal": best.rank[1]}
    return row | {"rollouts": recorder.rollouts, "seconds": seconds}, best.place


def solved(problem: Any) -> tuple[dict[str, Any], Any, np.ndarray | None]:
    """What our tuner comes to, its tuner, which knows the unit of costs, and where; one that breaks off says why."""
    from tuning.tune.judge import judge
    from tuning.tune.rounds import solve

    tuner, searched = problem.tuner, []
    begin = time.process_time()
    try:
        outcome = solve(problem, searching=lambda: searched.append(time.process_time() - begin))
        verdict = judge(outcome)
    except RuntimeError as error:
        row = {"excess": np.inf, "goal": np.inf, "rollouts": 1, "seconds": time.process_time() - begin}
        return row | {"exit": 1, "verdict": f"broke off: {error}"}, tuner, None
    excess, goal = outcome.run.lead.best
    after = verdict.after["validation"]
    lines = f"{after.unsettled} of {after.size} unsettled, {after.latched} diverged"
    row = {"excess": excess, "goal": goal, "rollouts": outcome.run.total("rollouts"), "seconds": searched[0]}
    row |= {"exit": int(bool(verdict.failure)), "verdict": verdict.failure or verdict.lines[0], "validation": lines}
    row |= {"looked": outcome.run.screened.rollouts, "iterations": outcome.progress.iteration}
    return row, outcome.problem.tuner, np.asarray(outcome.run.lead.best_z)


def measure(
    seeds: int = 1, most: int = MOST, only: Sequence[str] = (), scheduler: str | None = None
) -> list[dict[str, Any]]:
    """By problem the best of each method, ours relative to the best of anybody's, price and verdict.

    Problem after problem, each in a process of its own; or by workers, `scheduler` as of `agvjax sweep`.
    """
    import agvjax

    if scheduler is not None:  # workers get the compiler's options of this process, others set their own
        agvjax.tune_xla(devices=1)
    import jax

    from tuning.compute import schedule
    from tuning.compute.jobs import Jobs
    from tuning.io import files

    jax.config.update("jax_enable_x64", True)  # as in `attempts`: workers are set as this process is
    names, commit = tuple(only or POSED), history.commit()
    folder = KEPT / f"{commit}-{seeds}-{most}"
    folder.mkdir(parents=True, exist_ok=True)
    jobs = Jobs("problem", lambda number: _apart(names[number], seeds, most), prepare, (names, seeds, most))
    done = set() if commit.endswith("+") else {path.stem for path in folder.glob("*.json")}
    missing = [number for number, name in enumerate(names) if name not in done]
    with schedule.opened(scheduler, print) as engine:
        for number, data in engine.each(jobs, missing):
            files.write(folder / f"{names[number]}.json", data)
            print(compared(names[number], json.loads(data)), flush=True)
    return [compared(name, json.loads(files.text(folder / f"{name}.json"))) for name in names]


def prepare(about: tuple[tuple[str, ...], int, int]) -> Callable[[int], bytes]:
    """What solves the problem of a number, in a worker."""
    names, seeds, most = about
    return lambda number: json.dumps(attempts(names[number], seeds, most)).encode()


def _apart(name: str, seeds: int, most: int) -> bytes:
    """A problem, in a process of its own."""
    with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        return json.dumps(pool.apply(attempts, (name, seeds, most))).encode()


def compared(name: str, runs: list[dict[str, Any]]) -> dict[str, Any]:
    """A row of the table: ours of every seed, each peer's, ratios to the best of anybody's."""
    by = {method: [run for run in runs if run["method"] == method] for method in ("sqp", *PEERS)}
    best = min((run["excess"], run["goal"]) for run in runs)
    ours, ratios = by["sqp"], sorted(_ratio((own["excess"], own["goal"]), best) for own in by["sqp"])
    row: dict[str, Any] = {"problem": name, "gains": ours[0]["gains"], "best": _shown(*best)}
    row |= {"sqp": [_shown(own["excess"], own["goal"]) for own in ours]}
    row |= {run["method"]: _shown(run["excess"], run["goal"]) for run in runs if run["method"] in PEERS}
    row |= {"of_best": statistics.median(ratios), "worst_of_best": ratios[-1]}
    row |= {f"rollouts_{m}": statistics.median(r["rollouts"] for r in by[m]) for m in ("sqp", "cma") if by[m]}
    row |= {f"seconds_{m}": statistics.median(r["seconds"] for r in by[m]) for m in ("sqp", "cma") if by[m]}
    row["cma_over_finer"] = by["cma"][0].get("over_finer") if by["cma"] else None
    row |= {"exit": [run["exit"] for run in ours], "validation": ours[0].get("validation", "")}
    return row | {"verdict": ours[0]["verdict"].split("; ")[0][:160]}


def _ratio(own: tuple[float, float], best: tuple[float, float]) -> float:
    """Goal by goal where both keep the limits; else by how much more the limits are exceeded."""
    return own[1] / best[1] if own[0] == best[0] else (1 + own[0]) / (1 + best[0])


def _shown(excess: float, goal: float) -> str:
    return f"{goal:.4f}" if not excess else f"{goal:.4f} (over by {excess:.3f})"
