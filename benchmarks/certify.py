"""How much of what a search cannot break is proved: `agvjax certify` beside its search, and runs inside what is proved.

A side is shared out around its nominal value; `proved` and `found` are shares of the same box, and `ratio` their ratio.
"""

from __future__ import annotations

import dataclasses
import json
import time
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import agvjax
from tuning.config import load
from tuning.studies.certify import certify, checker
from tuning.studies.certify.found import Seeker, late_errors, scenarios
from tuning.studies.certify.rules import faults

TUNED = {  # by `agvjax tune`, seed 0
    "k1": 36.06579871266203,
    "k2": 10.885388600895494,
    "k3": 11.911863118456631,
    "Lam": 43.00573455237846,
    "Lam_psi": 75.48847083614142,
    "omega_n": 125.11318620774838,
    "zeta": 0.7895186739018151,
}
GAINS = {"paper": {}, "tuned": TUNED}
KINDS = {
    "slopes": {f"deadzone.{a}.slope_{s}": (0.2, 1.8) for a in ("position", "heading") for s in ("right", "left")},
    "thresholds": {
        f"deadzone.{a}.threshold_{s}": (0.0, 2.0) for a in ("position", "heading") for s in ("right", "left")
    },
    "amplitude": {"disturbance.amplitude": (0.0, 2.0)},
    "all, and starts": {},  # the tuning box
}
CASES = (  # gains, sides, bounds [m, rad], parts of a box
    *(("paper", kind, (0.02, 0.2), 4) for kind in reversed(KINDS)),
    *(("tuned", kind, (0.03, 0.12), 4) for kind in reversed(KINDS)),
)
BLOCK, SAMPLES, SEARCHES, STARTS = 4000, 100_000, 32, 32


def measure(samples: int = SAMPLES, searches: int = SEARCHES) -> list[dict[str, Any]]:
    """A row a case; where starts vary, too, `samples` runs and `searches` times `STARTS` ascents in the proved box."""
    jax.config.update("jax_enable_x64", True)
    rows = []
    for case in CASES:
        rows.append(_case(*case, samples, searches if case[1] == "all, and starts" else 0))
        print(json.dumps(rows[-1]), flush=True)
    return rows


def _case(
    gains: str, kind: str, within: tuple[float, float], boxes: int, samples: int, searches: int
) -> dict[str, Any]:
    over = [{name: {"times": list(span)}} for name, span in KINDS[kind].items()]
    settings = {"certify.over": over, "certify.within": within[0], "certify.within_heading": within[1]}
    settings |= {"certify.boxes": boxes, **{f"controller.{name}": value for name, value in GAINS[gains].items()}}
    config = load([], ["certify.halvings=3"], faults, settings)
    begin = time.perf_counter()
    found = certify(config)
    row = {
        "gains": gains,
        "sides": kind,
        "within m": within[0],
        "within rad": within[1],
        "proved": found.share,
        "found": found.found,
        "ratio": found.share / found.found if found.found else 0.0,
        "parts": found.boxes,
        "s": time.perf_counter() - begin,
    }
    if found.certificate:
        begin = time.perf_counter()
        checker.check(json.loads(json.dumps(found.certificate)))
        row["check s"] = time.perf_counter() - begin
    if searches and found.certificate:
        row |= _inside(config, found, samples, searches)
    return row


def _inside(config: Any, found: Any, samples: int, searches: int) -> dict[str, Any]:
    """Violations among random runs in the proved box, half of whose unknowns are at an end, and among ascents."""
    law, limits = agvjax.check(config.controller), np.array(found.bounds)[:, None]
    timing = config.timing("sweep")

    @jax.jit
    def errors(values: Any) -> Any:
        moved = scenarios(config.scenario, values)
        return late_errors(law, config.scenario, moved, config.criteria.late, **timing)

    violations, largest, rng = 0, np.zeros(3), np.random.default_rng(config.seed)
    for _ in range(samples // BLOCK):
        values = {}
        for name, (low, high) in found.box.items():
            share = rng.uniform(size=BLOCK)
            values[name] = jnp.asarray(
                low + np.where(rng.uniform(size=BLOCK) < 0.5, np.round(share), share) * (high - low)
            )
        worst, ok = (np.asarray(x) for x in errors(values))
        violations += int(np.sum(np.any(worst > limits, axis=0) | ~ok))
        largest = np.maximum(largest, worst.max(axis=1))
    search = dataclasses.replace(config.tune.search, starts=STARTS)
    seeker = Seeker.of(dataclasses.replace(config, tune=dataclasses.replace(config.tune, search=search)))
    ascents = [seeker.worst(found.share, round_)[0] for round_ in range(searches)]
    return {
        "samples": samples // BLOCK * BLOCK,
        "ascents": searches * STARTS,
        "violations": violations + sum(not value <= 1 for value in ascents),
        "largest / proved": [float(x) for x in largest / limits[:, 0]],
    }
