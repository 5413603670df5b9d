"""Rolling out the shards that nobody has rolled out yet."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

import agvjax
from agvjax.metric_table import METRICS

from .. import config as configuration
from ..config.settings import Config
from . import shards
from .design import Design, design
from .results import Results, collect
from .shards import Manifest

WAIT = 0.5  # s between looks at what others are doing

Judge = Callable[[Any], dict[str, Any]]


def kept(config: Config) -> tuple[str, ...]:
    """The metrics that are asked for, and those that decide over failure."""
    return tuple(dict.fromkeys((*config.sweep.metrics, *config.sweep.fails)))


def manifest_of(config: Config, plan: Design, laws: Mapping[str, Any]) -> Manifest:
    """The manifest of a sweep; what its shards do not hang on is left out, and may be changed afterwards."""
    free: dict[str, Any] = {"fails": {}, "radius": True, "metrics": kept(config)}
    return shards.manifest(
        configuration.dump(dataclasses.replace(config, sweep=dataclasses.replace(config.sweep, **free)), strict=False),
        config.seed,
        {name: configuration.gains_table(law) for name, law in laws.items()},
        plan.size,
        config.sweep.shard,
        metrics={name: METRICS[name].unit for name in kept(config)},
        leaves={name: plan.unit(name) for name in plan.names},
    )


def run_sweep(config: Config, folder: str | Path, laws: Mapping[str, Any] | None = None) -> Results:
    """Roll out what is missing in a folder, and return all of it; laws of one's own are welcome.

    Args:
        config: the scenarios are those of its `sweep`.
        folder: new, or with what an interrupted call left.
        laws: controllers by name, the first also the one whose gains are swept; None for the configured one.

    Raises:
        ValueError: the folder holds another sweep.
    """
    folder, plan = Path(folder), design(config)
    laws = {"configured": config.controller} if laws is None else laws
    made = manifest_of(config, plan, laws)
    if (folder / shards.MANIFEST).exists():
        try:
            made = shards.taken_up(shards.read_manifest(folder), made)
        except ValueError as error:
            raise ValueError(f"{folder} holds another sweep: {error}") from error
    else:
        folder.mkdir(parents=True, exist_ok=True)
        shards.write_manifest(folder, made)
    run(folder, made, plan, judges(config, plan, list(laws.values()), min(made.shard, made.size)))
    return collect(folder, made, config, plan)


def judges(config: Config, plan: Design, laws: Sequence[Any], size: int) -> list[Judge]:
    """For every controller, what makes metrics and `ok` (size,) of the leaves of so many scenarios; compiled."""
    values = plan.values(0, min(size, plan.size))
    example = {name: _padded(value, size) for name, value in values.items()}
    compiled: dict[Any, Any] = {}

    def judge(law: Any, law_values: Any, scenario_values: Any) -> dict[str, Any]:
        controller = agvjax.batch(law, law_values) if law_values else law
        batch = agvjax.batch(plan.scenario, scenario_values) if scenario_values else plan.scenario
        metrics = agvjax.evaluate(
            controller,
            batch,
            criteria=agvjax.Criteria.of(kept(config)),
            **config.timing("sweep"),
        )
        return {"ok": metrics.ok, **{name: metrics[name] for name in kept(config)}}

    def of(law: Any) -> Judge:
        law = agvjax.check(law)
        shape = jax.tree.structure(law), tuple(np.shape(x) for x in jax.tree.leaves(law))
        if shape not in compiled:
            compiled[shape] = jax.jit(judge).lower(law, *plan.split(example)).compile()
        return lambda values: compiled[shape](law, *plan.split(values))

    return [of(law) for law in laws]


def run(
    folder: Path,
    made: Manifest,
    plan: Design,
    every: Sequence[Judge],
    offset: int = 0,
    tick: Callable[[int], None] = lambda scenarios: None,
) -> int:
    """Compute what is missing until nothing is, together with whoever else does; how many shards this process made.

    Args:
        folder: of the sweep, with its manifest.
        made: the manifest.
        plan: its scenarios.
        every: what judges them, one for each controller.
        offset: the shard to begin with; processes that begin at different ones meet late.
        tick: called with the number of scenarios that are done, whoever did them.
    """
    missing = [i for i in range(made.count) if shards.read_shard(folder, made, i) is None]
    order = sorted(missing, key=lambda i: (i - offset) % made.count)
    tick(made.size - sum(made.span(i)[1] for i in order))
    mine, damaged = 0, {i for i in missing if shards.path_of(folder, i).exists()}
    while order:
        left = []
        for i in order:
            if i not in damaged and shards.path_of(folder, i).exists():
                tick(made.span(i)[1])  # another process was here
                continue
            with shards.held(folder, f"shard-{i:05d}") as ours:
                if not ours:
                    left.append(i)
                    continue
                if i not in damaged and shards.path_of(folder, i).exists():  # written between the look and the claim
                    tick(made.span(i)[1])
                    continue
                _compute(folder, made, plan, every, i)
                mine += 1
                tick(made.span(i)[1])
        if left == order:
            time.sleep(WAIT)
        order = left
    return mine


def _compute(folder: Path, made: Manifest, plan: Design, every: Sequence[Judge], shard: int) -> None:
    first, count = made.span(shard)
    values = plan.values(first, count)
    padded = {name: _padded(value, min(made.shard, made.size)) for name, value in values.items()}
    found = [jax.tree.map(lambda x: np.asarray(x)[:count], judge(padded)) for judge in every]
    results = {name: np.stack([one[name] for one in found]) for name in found[0]}
    shards.write_shard(folder, made, shard, results, values)


def _padded(value: np.ndarray, size: int) -> Any:
    """Filled up with copies of the first, so that one compilation serves every shard; in the run's dtype."""
    more = np.repeat(value[:1], size - len(value), axis=0)
    return np.concatenate([value, more]).astype(jax.numpy.result_type(float))
