"""What is rolled out in a sweep: its scenarios, what judges them, and a shard of both."""

from __future__ import annotations

import dataclasses
import importlib.util
from collections.abc import Callable, Hashable, Mapping, Sequence

import jax
import numpy as np
from jaxtyping import Array

import agvjax
from agvjax import Fault, InputError
from agvjax.evaluate import layout
from agvjax.metric_units import units_in
from agvjax.protocols import Law

from .. import config as configuration
from ..config.settings import Config
from . import shards
from .design import SENSITIVITY, Design, Leaves, design
from .shards import Manifest

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


def planned(config: Config) -> Design:
    """The scenarios of a configuration that has been checked.

    Raises:
        agvjax.InputError: the library that makes its design is not installed.
    """
    if config.sweep.design in SENSITIVITY and importlib.util.find_spec("SALib") is None:
        rule = f"one whose libraries are installed (SALib is not: {INSTALL})"
        raise InputError([Fault("sweep.design", config.sweep.design, rule)])
    return design(config)


def judges(config: Config, plan: Design, laws: Sequence[Law], size: int, devices: int | None = None) -> list[Judge]:
    """For every controller, what makes metrics and `ok` (size,) of the leaves of so many scenarios; compiled.

    Blocks are those that one device has, so that results hang on no number of `devices`.
    """
    block = layout(size, None, 1)[1]
    example = _padded(plan.values(0, min(size, plan.size)), size)
    compiled: dict[Hashable, jax.stages.Compiled] = {}

    def judge(law: Law, law_values: Leaves, scenario_values: Leaves) -> dict[str, Array]:
        controller = agvjax.batch(law, law_values) if law_values else law
        batch = agvjax.batch(plan.scenario, scenario_values) if scenario_values else plan.scenario
        criteria = agvjax.Criteria.of(recorded(config), like=config.judged())
        timing = config.timing("sweep")
        metrics = agvjax.evaluate(controller, batch, criteria=criteria, block=block, devices=devices, **timing)
        return {"ok": metrics.ok, **{name: metrics[name] for name in recorded(config)}}

    def of(law: Law) -> Judge:
        law = agvjax.check(law)
        shape = jax.tree.structure(law), tuple(np.shape(x) for x in jax.tree.leaves(law))
        if shape not in compiled:
            compiled[shape] = jax.jit(judge).lower(law, *plan.split(example)).compile()
        return lambda values: compiled[shape](law, *plan.split(values))

    return [of(law) for law in laws]


def shard(manifest: Manifest, plan: Design, every: Sequence[Judge], number: int) -> bytes:
    """The file of one shard."""
    first, count = manifest.span(number)
    values = plan.values(first, count)
    padded = _padded(values, manifest.block)
    metrics = [{name: np.asarray(x)[:count] for name, x in judge(padded).items()} for judge in every]
    stacked = {name: np.stack([one[name] for one in metrics]) for name in metrics[0]}
    return shards.packed(manifest, number, stacked, values)


def _padded(values: Mapping[str, np.ndarray], size: int) -> dict[str, np.ndarray]:
    """Filled up with copies of the first, so that one compilation serves every shard; in the run's dtype."""
    dtype = jax.numpy.result_type(float)
    filled = {name: np.concatenate([x, np.repeat(x[:1], size - len(x), axis=0)]) for name, x in values.items()}
    return {name: x.astype(dtype) for name, x in filled.items()}
