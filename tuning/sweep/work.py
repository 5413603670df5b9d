"""Rolling out the shards that nobody has rolled out yet."""

from __future__ import annotations

import dataclasses
import importlib.util
import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Array

import agvjax
from agvjax import Fault, InputError
from agvjax.metric_units import units_in
from agvjax.protocols import Law

from .. import config as configuration
from ..config.settings import Config
from . import claims, results, shards
from .design import SENSITIVITY, Design, Leaves, design
from .results import Results
from .rules import faults
from .shards import Manifest

WAIT = 0.5  # s, after which a process looks again whether the others have finished their shards
INSTALL = "pip install 'agvjax[sweep]'"

Judge = Callable[[Leaves], dict[str, Array]]  # leaves of scenarios (n, ...) -> `ok` and every metric (n,)


def recorded(config: Config) -> tuple[str, ...]:
    """The metrics that are asked for, and those that decide over failure."""
    return tuple(dict.fromkeys((*config.sweep.metrics, *config.sweep.fails)))


def manifest_of(config: Config, plan: Design, laws: Mapping[str, Law]) -> Manifest:
    """The manifest of a sweep; settings that do not change its shards are left out, and may be changed afterwards."""
    sweep = dataclasses.replace(config.sweep, fails={}, radius=True, metrics=recorded(config))
    return shards.manifest(
        configuration.dump(dataclasses.replace(config, sweep=sweep), strict=False),
        config.seed,
        {name: configuration.gains_table(law) for name, law in laws.items()},
        plan.size,
        config.sweep.shard,
        metrics={name: units_in(config.scenario)[name] for name in recorded(config)},
        leaves={name: plan.unit(name) for name in plan.names},
    )


def run_sweep(config: Config, folder: str | Path, laws: Mapping[str, Law] | None = None) -> Results:
    """Roll out what is missing in a folder, and return all of it; laws of one's own are welcome.

    Args:
        config: the scenarios are those of its `sweep`.
        folder: new, or with what an interrupted call left.
        laws: controllers by name, the first also the one whose gains are swept; None for the configured one.

    Raises:
        agvjax.InputError: lists every bad setting.
        ValueError: the folder holds another sweep.
    """
    laws = {"configured": config.controller} if laws is None else dict(laws)
    config = configuration.check(config, faults)
    folder, plan = Path(folder), planned(config)
    manifest = manifest_of(config, plan, laws)
    if (folder / shards.MANIFEST).exists():
        try:
            manifest = shards.taken_up(shards.read_manifest(folder), manifest)
        except ValueError as error:
            raise ValueError(f"{folder} holds another sweep: {error}") from error
    else:
        folder.mkdir(parents=True, exist_ok=True)
        shards.write_manifest(folder, manifest)
    run(folder, manifest, plan, judges(config, plan, list(laws.values()), manifest.block))
    return results.collect(folder, manifest, config, plan)


def planned(config: Config) -> Design:
    """The scenarios of a configuration that has been checked.

    Raises:
        agvjax.InputError: the library that makes its design is not installed.
    """
    if config.sweep.design in SENSITIVITY and importlib.util.find_spec("SALib") is None:
        rule = f"one whose libraries are installed (SALib is not: {INSTALL})"
        raise InputError([Fault("sweep.design", config.sweep.design, rule)])
    return design(config)


def judges(config: Config, plan: Design, laws: Sequence[Law], size: int) -> list[Judge]:
    """For every controller, what makes metrics and `ok` (size,) of the leaves of so many scenarios; compiled."""
    example = _padded(plan.values(0, min(size, plan.size)), size)
    compiled: dict[Hashable, jax.stages.Compiled] = {}

    def judge(law: Law, law_values: Leaves, scenario_values: Leaves) -> dict[str, Array]:
        controller = agvjax.batch(law, law_values) if law_values else law
        batch = agvjax.batch(plan.scenario, scenario_values) if scenario_values else plan.scenario
        criteria = agvjax.Criteria.of(recorded(config), like=config.judged())
        metrics = agvjax.evaluate(controller, batch, criteria=criteria, **config.timing("sweep"))
        return {"ok": metrics.ok, **{name: metrics[name] for name in recorded(config)}}

    def of(law: Law) -> Judge:
        law = agvjax.check(law)
        shape = jax.tree.structure(law), tuple(np.shape(x) for x in jax.tree.leaves(law))
        if shape not in compiled:
            compiled[shape] = jax.jit(judge).lower(law, *plan.split(example)).compile()
        return lambda values: compiled[shape](law, *plan.split(values))

    return [of(law) for law in laws]


# long: claims, looks and claims again, in one order
def run(
    folder: Path,
    manifest: Manifest,
    plan: Design,
    every: Sequence[Judge],
    offset: int = 0,
    tick: Callable[[int], None] = lambda scenarios: None,
) -> int:
    """Compute what is missing until nothing is, together with whoever else does; how many shards this process made.

    Args:
        folder: of the sweep, with its manifest.
        manifest: of the sweep.
        plan: its scenarios.
        every: what judges them, one for each controller.
        offset: the shard to begin with; processes that begin at different ones meet late.
        tick: called with the number of scenarios that are done, whoever did them.
    """
    missing = [i for i in range(manifest.shards) if shards.read_shard(folder, manifest, i, plan.leaf_shapes) is None]
    order = sorted(missing, key=lambda i: (i - offset) % manifest.shards)
    tick(manifest.size - sum(manifest.span(i)[1] for i in order))
    mine, damaged = 0, {i for i in missing if shards.path_of(folder, i).exists()}

    def there(i: int) -> bool:
        return i not in damaged and shards.path_of(folder, i).exists()

    while order:
        left = []
        for i in order:
            if not there(i):
                with claims.locked(folder, f"shard-{i:05d}") as ours:
                    if not ours:
                        left.append(i)
                        continue
                    if not there(i):  # or another process wrote it between the look and the claim
                        _compute(folder, manifest, plan, every, i)
                        mine += 1
            tick(manifest.span(i)[1])
        if left == order:
            time.sleep(WAIT)
        order = left
    return mine


def _compute(folder: Path, manifest: Manifest, plan: Design, every: Sequence[Judge], shard: int) -> None:
    first, count = manifest.span(shard)
    values = plan.values(first, count)
    padded = _padded(values, manifest.block)
    metrics = [{name: np.asarray(x)[:count] for name, x in judge(padded).items()} for judge in every]
    stacked = {name: np.stack([one[name] for one in metrics]) for name in metrics[0]}
    shards.write_shard(folder, manifest, shard, stacked, values)


def _padded(values: Mapping[str, np.ndarray], size: int) -> dict[str, np.ndarray]:
    """Filled up with copies of the first, so that one compilation serves every shard; in the run's dtype."""
    dtype = jax.numpy.result_type(float)
    filled = {name: np.concatenate([x, np.repeat(x[:1], size - len(x), axis=0)]) for name, x in values.items()}
    return {name: x.astype(dtype) for name, x in filled.items()}
