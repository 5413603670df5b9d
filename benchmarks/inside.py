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
from agvjax._pytree import number, pytree
from agvjax.engine.loop import Sample
from agvjax.engine.rollout import Meter
from agvjax.metrics import tracking_error
from tuning.config import dump, load
from tuning.config.settings import Config
from tuning.studies.certify import certify, checker
from tuning.studies.certify.found import Seeker, scenarios
from tuning.studies.certify.rules import faults

KEPT = Path(__file__).parents[1] / "build"
BLOCK, EACH = 32_768, 16  # scenarios together; blocks after which the state is kept
SAMPLES, ROUNDS, STARTS = 100_000, 32, 32  # runs; searches of as many ascents


@pytree
class LargestLate(Meter):
    """The largest error of each channel from `late` [s] on."""

    late: float = number(4.0, "s")

    def weights(self, t: jax.Array, left: jax.Array, right: jax.Array, end: jax.Array) -> jax.Array:
        """1 where an instant counts."""
        return (t >= self.late - 1e-9).astype(t.dtype)

    def start(self, sample: Sample) -> jax.Array:
        """Nothing yet."""
        return jnp.zeros_like(tracking_error(sample))

    def update(self, tally: jax.Array, sample: Sample, weights: jax.Array) -> jax.Array:
        """With one more sample."""
        return jnp.maximum(tally, weights * jnp.abs(tracking_error(sample)))

    def finish(self, tally: jax.Array, ok: jax.Array, horizon: jax.Array) -> tuple[jax.Array, jax.Array]:
        """The errors, (3,), and whether the run has gone well."""
        return tally, ok


def largest(config: Config) -> Callable[[dict[str, jax.Array]], tuple[jax.Array, jax.Array]]:
    """The function from unknowns, each (B,), to the largest late errors (B, 3) and whether each run went well (B,)."""
    law, timing = agvjax.check(config.controller), config.timing("sweep")

    @jax.jit
    def errors(values: dict[str, jax.Array]) -> Any:
        batch = agvjax.batch(config.scenario, scenarios(config.scenario, values))
        return agvjax.evaluate(law, batch, criteria=LargestLate(late=config.criteria.late), **timing)

    return errors


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
    state = json.loads(file.read_text()) if file.exists() else {}
    if state.get("of") != dump(config):
        state = _proved(config) | {"of": dump(config)}
    random, limits = largest(config), np.array(state["bounds"])
    while state["blocks"] * BLOCK < samples and time.monotonic() < end:
        for _ in range(min(EACH, -(-samples // BLOCK) - state["blocks"])):
            worst, ok = (np.asarray(x) for x in random(drawn(state["box"], config.seed, state["blocks"])))
            state["violations"] += int(np.sum(np.any(worst > limits, axis=1) | ~ok))
            state["largest"] = np.maximum(state["largest"], worst.max(axis=0)).tolist()
            state["blocks"] += 1
        _keep(file, state)
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


def _keep(file: Path, state: dict[str, Any]) -> None:
    file.parent.mkdir(exist_ok=True)
    part = file.with_suffix(".part")
    part.write_text(json.dumps(state))
    part.replace(file)
