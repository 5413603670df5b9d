"""How much of what a search cannot break is proved: `agvjax certify` beside its search.

A side is shared out around its nominal value; `proved` and `found` are shares of the same box, and `ratio` their ratio.
"""

from __future__ import annotations

import json
import time
from typing import Any

import jax

from tuning.studies.certify import certify, checker

from . import inside

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


def measure() -> list[dict[str, Any]]:
    """A row a case."""
    jax.config.update("jax_enable_x64", True)
    rows = []
    for case in CASES:
        rows.append(_case(*case))
        print(json.dumps(rows[-1]), flush=True)
    return rows


def measure_inside(samples: int = inside.SAMPLES, hours: float = float("inf")) -> list[dict[str, Any]]:
    """Runs inside the boxes with starts, of the paper's gains and of tuned ones: a row each."""
    cases = {case[0]: case for case in reversed(CASES) if case[1] == "all, and starts"}
    posed = {gains: inside.posed(within, n, KINDS[kind], GAINS[gains]) for gains, kind, within, n in cases.values()}
    return inside.measure(posed, samples, hours)


def _case(gains: str, kind: str, within: tuple[float, float], boxes: int) -> dict[str, Any]:
    config = inside.posed(within, boxes, KINDS[kind], GAINS[gains])
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
    return row
