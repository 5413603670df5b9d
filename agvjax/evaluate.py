"""Many scenarios at once: which leaves vary, and the metrics of all of them, in blocks."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ._pytree import pytree, structure
from .integrate import RK4, Integrator
from .leaves import get, replace, swap
from .metrics import Criteria, Metrics
from .simulate import DT, N_STEPS, Rollout

BLOCK = 64  # scenarios rolled out together: what fits the cache of a CPU core


@pytree
class Batch:
    """A scenario of which the leaves `names` carry a leading batch axis; see `batch`."""

    scenario: Any
    names: tuple[str, ...] = structure(())

    @property
    def axes(self) -> Any:
        """The scenario's tree with 0 where a leaf varies and None elsewhere, for the `in_axes` of `jax.vmap`."""
        return swap(jax.tree.map(lambda _: None, self.scenario), dict.fromkeys(self.names, 0))

    @property
    def size(self) -> int:
        """Number of scenarios."""
        return int(np.shape(get(self.scenario, self.names[0]))[0])

    @property
    def values(self) -> dict[str, Any]:
        """The leaves that vary, by dotted name."""
        return {name: get(self.scenario, name) for name in self.names}

    def __getitem__(self, index: Any) -> Any:
        """The scenario of one index, or the batch of a slice or an array of indices."""
        picked = swap(self.scenario, {name: jnp.asarray(value)[index] for name, value in self.values.items()})
        return (
            picked if np.ndim(index) == 0 and not isinstance(index, slice) else Batch(scenario=picked, names=self.names)
        )


def batch(scenario: Any, values: Mapping[str, Any]) -> Batch:
    """Vary the named leaves of a scenario; only they get a batch axis, all else is shared.

    Args:
        scenario: the scenario to vary.
        values: dotted leaf name -> array whose first axis is the batch, the same length for all.

    Raises:
        KeyError: a name is no leaf of the scenario.
        ValueError: nothing varies, an array has no batch axis, or the lengths differ.
    """
    if not values:
        raise ValueError("batch needs at least one leaf that varies")
    lengths = {name: np.shape(value)[0] if np.ndim(value) else None for name, value in values.items()}
    if None in lengths.values() or len(set(lengths.values())) != 1:
        raise ValueError(f"batch needs one leading axis of the same length in every array; got {lengths}")
    return Batch(scenario=replace(scenario, values), names=tuple(sorted(values)))


@functools.partial(jax.jit, static_argnames=("n_steps", "control_every", "integrator", "dtype", "block"))
def evaluate(
    controller: Any,
    batch: Any,
    *,
    dt: Any = DT,
    n_steps: int = N_STEPS,
    control_every: int = 1,
    criteria: Criteria | None = None,
    integrator: Integrator = RK4,
    dtype: Any = None,
    block: int = BLOCK,
) -> Metrics:
    """Metrics of every scenario of a batch, in memory that does not grow with the horizon.

    Args:
        controller: one controller for all scenarios; `jax.vmap` over it for many.
        batch: a `Batch` of B scenarios, or a single `Scenario`.
        dt: step [s], traced.
        n_steps: number of steps.
        control_every: steps between control instants.
        criteria: how to judge; see `Criteria`.
        integrator: `RK4`, `HEUN` or `EULER`.
        dtype: float32 or float64; None takes JAX's default float.
        block: scenarios rolled out together; changes speed and nothing else.

    Returns:
        `Metrics` with a leading axis B, or without for a single scenario. Works under `jax.vmap`, `grad`, `jvp`, `jit`.
    """

    def one(scenario: Any) -> Metrics:
        rollout = Rollout(
            controller,
            scenario,
            dt=dt,
            n_steps=n_steps,
            control_every=control_every,
            integrator=integrator,
            dtype=dtype,
            meter=Criteria() if criteria is None else criteria,
        )
        carry, _, last = rollout.run(None)
        tally = rollout.meter.update(carry.meter, last, rollout.weights(rollout.end))
        return rollout.meter.finish(tally, carry.ok, rollout.end)

    if not isinstance(batch, Batch):
        return one(batch)

    def many(values: Mapping[str, Any]) -> Metrics:
        return jax.vmap(lambda v: one(swap(batch.scenario, v)))(values)

    values = {name: jnp.asarray(value) for name, value in batch.values.items()}
    blocks = -(-batch.size // block)
    if blocks == 1:
        return many(values)
    index = np.minimum(np.arange(blocks * block), batch.size - 1).reshape(blocks, block)  # the last block repeats one
    metrics = jax.lax.map(many, {name: value[index] for name, value in values.items()})
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:])[: batch.size], metrics)
