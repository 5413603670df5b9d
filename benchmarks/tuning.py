"""Our tuner beside what people use instead, for the paper's goal: same objective, ensemble and compiled rollout.

Nothing is screened: every method begins where it is told.

Cost is goal plus penalty of the exceeded limits, in rollouts of the ensemble (a gradient counts 1 + its tangents) and
in seconds of processor time on one core, compilation left out. Every method starts at the same gains: seed 0 at the
paper's, the others at random ones about them. Those that need a box get a factor of 10 about the start, either way.
"""

from __future__ import annotations

import multiprocessing
import statistics
import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

OURS = ("sqp", "adam")
PEERS = ("cma", "tpe", "random", "nelder-mead", "l-bfgs-b")
SEEDS, BUDGET, NEAR = 5, 3600, 0.01  # starts of each, rollouts of a peer, and how near to the best counts as there
TPE_BUDGET = 600  # its own arithmetic grows with the square of the trials
BOX, SPREAD = np.log(10.0), np.log(1.5)


class Spent(Exception):
    """The budget is used up."""


class Recorder:
    """Counts rollouts and seconds, and keeps every new best cost."""

    def __init__(self, budget: int):
        self.budget, self.rollouts, self.best, self.curve = budget, 0, np.inf, []
        self.begin = time.process_time()

    def saw(self, cost: float, rollouts: int) -> None:
        """One more look."""
        self.rollouts += rollouts
        if cost < self.best:
            self.best = cost
            self.curve.append((self.rollouts, time.process_time() - self.begin, cost))
        if self.rollouts >= self.budget:
            raise Spent


def contest(
    method: str, seed: int, budget: int, settings: tuple[str, ...] = (), files: tuple[str, ...] = ("paper-goal",)
) -> dict[str, Any]:
    """One method from one start."""
    import agvjax

    agvjax.tune_xla(devices=1)
    import jax

    jax.config.update("jax_enable_x64", True)
    from tuning import config as configuration
    from tuning.tune.problem import pose

    optimizer = f"tune.optimizer={method if method in OURS else 'sqp'}"
    tuner = pose(configuration.load(list(files), [optimizer, *settings])).tuner
    middle = tuner.gains.coordinates(tuner.controller)
    shift = np.random.default_rng(seed).uniform(-SPREAD, SPREAD, middle.size) if seed else np.zeros(middle.size)
    start = np.asarray(middle) + shift
    _ = tuner.baseline
    if method in OURS:
        tuner.advance(tuner.begin(start))  # compiles
        recorder, progress = Recorder(10**9), tuner.begin(start)
        while not tuner.finished(progress):
            before, progress = progress.rollouts, tuner.advance(progress)
            recorder.saw(progress.history[-1][1], progress.rollouts - before)
    else:
        judge = jax.jit(lambda z: tuner.cost_of(*tuner.values(z, tuner.scenarios()))[0])
        judge(start).block_until_ready()
        recorder = Recorder(min(budget, TPE_BUDGET) if method == "tpe" else budget)

        def cost(z: Any) -> float:
            value = float(judge(np.asarray(z, float)))
            recorder.saw(value, 1)
            return value

        try:
            search(method, cost, start, seed)
        except Spent:
            pass
    return {
        "method": method,
        "seed": seed,
        "best": recorder.best,
        "rollouts": recorder.rollouts,
        "curve": recorder.curve,
    }


def search(method: str, cost: Callable[[Any], float], start: np.ndarray, seed: int, elsewhere: bool = False) -> None:
    """Look until the budget is spent; a method that ends by itself begins again, CMA-ES `elsewhere` only if told."""
    random, first = np.random.default_rng(1000 + seed), start
    if method == "cma":
        import cma

        popsize = None
        while True:
            options = {"seed": seed + 1, "verbose": -9} | ({"popsize": popsize} if popsize else {})
            strategy = cma.CMAEvolutionStrategy(start, 0.3, options)
            while not strategy.stop():
                points = strategy.ask()
                strategy.tell(points, [cost(z) for z in points])
            popsize = 2 * strategy.popsize  # restarts of growing size (IPOP)
            start = first + random.uniform(-BOX, BOX, first.size) if elsewhere else first
    if method == "tpe":
        import optuna

        optuna.logging.set_verbosity(optuna.logging.ERROR)
        study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=seed))
        study.enqueue_trial({str(i): float(x) for i, x in enumerate(start)})
        while True:
            study.optimize(
                lambda t: cost([t.suggest_float(str(i), x - BOX, x + BOX) for i, x in enumerate(start)]), n_trials=50
            )
    if method == "random":
        cost(start)
        while True:
            cost(start + random.uniform(-BOX, BOX, start.size))
    from scipy.optimize import minimize

    warnings.simplefilter("ignore")
    z = start
    while True:
        if method == "nelder-mead":
            minimize(cost, z, method="Nelder-Mead", options={"adaptive": True, "maxfev": 10**6, "maxiter": 10**6})
        else:
            bounds = [(x - BOX, x + BOX) for x in start]
            minimize(cost, z, method="L-BFGS-B", bounds=bounds, options={"maxfun": 10**6, "maxiter": 10**6})
        z = start + random.uniform(-SPREAD, SPREAD, start.size)


def measure(turns: int, budget: int = BUDGET) -> list[dict[str, Any]]:
    """Every method from every start: what it took to come within 1 % of the best that any method found."""
    runs = []
    with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        for seed in range(SEEDS):
            for method in (*OURS, *PEERS):
                runs.append(pool.apply(contest, (method, seed, budget)))
                print(f"{method} from start {seed}: best {runs[-1]['best']:.4f}", flush=True)
    best = min(run["best"] for run in runs)
    rows = []
    for method in (*OURS, *PEERS):
        own = [run for run in runs if run["method"] == method]
        reached = [_reached(run, best * (1 + NEAR)) for run in own]
        row: dict[str, Any] = {"method": method, "best_of_all": best}
        for i, name in enumerate(("rollouts", "seconds")):
            values = [r[i] if r else np.inf for r in reached]
            row |= {
                f"{name}_to_1_percent": _finite(statistics.median(values)),
                f"{name}_each": [_finite(v) for v in values],
            }
        row |= {"arrived": sum(r is not None for r in reached), "best_each": [run["best"] for run in own]}
        row["curves"] = [thinned(run["curve"]) for run in own]
        rows.append(row)
    return rows


def thinned(curve: list[Any], most: int = 60) -> list[Any]:
    """As many points of a curve as a plot needs."""
    keep = sorted({round(i) for i in np.linspace(0, len(curve) - 1, min(most, len(curve)))})
    return [[int(curve[i][0]), round(curve[i][1], 3), round(curve[i][2], 5)] for i in keep]


def _finite(x: float) -> float | None:
    return float(x) if np.isfinite(x) else None


def _reached(run: dict[str, Any], cost: float) -> tuple[int, float] | None:
    return next(((n, s) for n, s, c in run["curve"] if c <= cost), None)
