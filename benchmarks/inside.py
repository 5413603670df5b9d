"""Runs inside what is proved: `python -m benchmarks inside` draws scenarios of a certified box.

A violation would show that a proof is wrong. Half of the unknowns of each scenario are at an end of their side.
`--samples 100000000` takes hours: `--hours` ends earlier, and the same command goes on from build/inside-NAME.json.
"""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import agvjax
from tuning.config import dump, load
from tuning.config.settings import Config
from tuning.io import files
from tuning.studies.certify import certify, checker
from tuning.studies.certify.found import Seeker, late_errors, scenarios
from tuning.studies.certify.rules import faults

KEPT = Path(__file__).parents[1] / "build"
BLOCK, EACH = 32_768, 16  # scenarios together; blocks after which the state is kept
SAMPLES, ROUNDS, STARTS = 100_000, 32, 32  # runs; searches of as many ascents


def largest(config: Config) -> Callable[[dict[str, jax.Array]], tuple[jax.Array, jax.Array]]:
    """The function from unknowns, each (B,), to the largest late errors (3, B) and whether each run went well (B,)."""
    law, scenario, late = agvjax.check(config.controller), config.scenario, config.criteria.late
    return jax.jit(
        lambda values: late_errors(law, scenario, scenarios(scenario, values), late, **config.timing("sweep"))
    )


def drawn(box: dict[str, tuple[float, float]], seed: int, block: int, size: int = BLOCK) -> dict[str, jax.Array]:
    """A block's scenarios: each unknown uniform in its side, or with the same chance at one of its ends."""
    random, values = np.random.default_rng([seed, block]), {}
    for name, (low, high) in box.items():
        share = random.uniform(size=size)
        share = np.where(random.uniform(size=size) < 0.5, np.round(share), share)
        values[name] = jnp.asarray(low + share * (high - low))
    return values


def posed(
    within: tuple[float, float], boxes: int, kind: dict[str, tuple[float, float]], gains: dict[str, float]
) -> Config:
    """What is to be proved: bounds [m, rad], parts of a box, sides as multiples of the nominal value, and gains."""
    settings: dict[str, Any] = {"certify.over": [{name: {"times": list(span)}} for name, span in kind.items()]}
    settings |= {"certify.within": within[0], "certify.within_heading": within[1], "certify.boxes": boxes}
    settings |= {f"controller.{name}": value for name, value in gains.items()}
    return load([], ["certify.halvings=3"], faults, settings)


def measure(cases: dict[str, Config], samples: int = SAMPLES, hours: float = float("inf")) -> list[dict[str, Any]]:
    """A row of each case: so many runs and `ROUNDS` times `STARTS` ascents inside the box that is proved of it."""
    agvjax.tune_xla()
    jax.config.update("jax_enable_x64", True)
    end = time.monotonic() + 3600 * hours
    return [_case(name, config, samples, end) for name, config in cases.items()]


def _case(name: str, config: Config, samples: int, end: float) -> dict[str, Any]:
    file = KEPT / f"inside-{name}.json"
    state: dict[str, Any] = json.loads(file.read_text()) if file.exists() else {}
    if state.get("of") != dump(config):
        state = _proved(config) | {"of": dump(config)}
    random, limits = largest(config), np.array(state["bounds"])
    while state["blocks"] * BLOCK < samples and time.monotonic() < end:
        for _ in range(min(EACH, -(-samples // BLOCK) - state["blocks"])):
            worst, ok = (np.asarray(x) for x in random(drawn(state["box"], config.seed, state["blocks"])))
            state["violations"] += int(np.sum(np.any(worst > limits[:, None], axis=0) | ~ok))
            state["largest"] = np.maximum(state["largest"], worst.max(axis=1)).tolist()
            state["blocks"] += 1
        KEPT.mkdir(exist_ok=True)
        files.write_json(file, state)
        print(f"{name}: {state['blocks'] * BLOCK} runs, {state['violations']} violations", flush=True)
    return {
        "gains": name,
        "share": state["share"],
        "proved m": state["bounds"][0],
        "proved rad": state["bounds"][2],
        "samples": state["blocks"] * BLOCK,
        "ascents": state["ascents"],
        "violations": state["violations"],
        **dict(zip(("x / proved", "y / proved", "heading / proved"), state["largest"] / limits, strict=True)),
    }


def _proved(config: Config) -> dict[str, Any]:
    """The box, and what ascents find in it."""
    found = certify(config)
    if not found.certificate:
        raise SystemExit("nothing is proved of this case")
    checker.check(json.loads(json.dumps(found.certificate)))
    search = dataclasses.replace(config.tune.search, starts=STARTS)
    seeker = Seeker.of(dataclasses.replace(config, tune=dataclasses.replace(config.tune, search=search)))
    ascents = [seeker.worst(found.share, round_)[0] for round_ in range(ROUNDS)]
    return {
        "box": found.box,
        "bounds": list(found.bounds),
        "share": found.share,
        "ascents": ROUNDS * STARTS,
        "violations": sum(not value <= 1 for value in ascents),
        "blocks": 0,
        "largest": [0.0, 0.0, 0.0],
    }
