"""Our tuner beside an evolution strategy on the digital loop: 50 Hz, 20 ms late, without limits and with them.

Same objective, scenarios, bounds and compiled rollout. The evolution strategy (CMA-ES) gets 1500 evaluations of the
ensemble and restarts, from the configured gains and from others about them.
"""

from __future__ import annotations

import multiprocessing
from pathlib import Path
from typing import Any

from .tuning import contest

LOOPS = {"20 ms late": str(Path(__file__).with_name("delayed.toml")), "and limited": "unicycle"}
EVALUATIONS, SEEDS = 1500, 2


def measure(turns: int) -> list[dict[str, Any]]:
    """Cost that each ends with, relative to the best of the evolution strategy's runs."""
    rows = []
    for loop, file in LOOPS.items():
        with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
            ours = pool.apply(contest, ("sqp", 0, EVALUATIONS, (), (file,)))
            peers = [pool.apply(contest, ("cma", seed, EVALUATIONS, (), (file,))) for seed in range(SEEDS)]
        best = min(run["best"] for run in peers)
        for method, runs in (("sqp", [ours]), ("cma", peers)):
            costs = [run["best"] for run in runs]
            row = {"loop": loop, "method": method, "cost_each": costs, "of_best_cma": min(costs) / best}
            rows.append(row | {"rollouts_each": [run["rollouts"] for run in runs]})
            print(row, flush=True)
    return rows
