"""Many scenarios at once: which leaves vary, and the metrics of all of them, in blocks."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike, DTypeLike
from jaxtyping import PyTree

from ._pytree import Real, pytree, structure
from .engine.rollout import Rollout
from .engine.xla import warn_if_slow
from .host import looked_at
from .integrate import RK4, Integrator
from .leaves import fits, get, replace, swap
from .metrics import Criteria, Metrics
from .protocols import Law
from .scenario import Scenario
from .timing import DT, N_STEPS, Timing

BLOCK = 128  # scenarios rolled out together: few enough for the cache of a CPU core, enough for its vector units


@pytree
class Batch:
    """A scenario or controller whose leaves `names` have a leading batch axis; see `batch`."""

    scenario: PyTree  # or a law
    names: tuple[str, ...] = structure(())

    @property
    def axes(self) -> PyTree:
        """The scenario's tree with 0 where a leaf varies and None elsewhere, for the `in_axes` of `jax.vmap`."""
        return swap(jax.tree.map(lambda _: None, self.scenario), dict.fromkeys(self.names, 0))

    @property
    def size(self) -> int:
        """Number of scenarios."""
        return int(np.shape(get(self.scenario, self.names[0]))[0])

    @property
    def values(self) -> dict[str, ArrayLike]:
        """The leaves that vary, by dotted name."""
        return {name: get(self.scenario, name) for name in self.names}

    def __getitem__(self, index: PyTree) -> PyTree:
        """The scenario of one index, or the batch of a slice or an array of indices."""
        picked = swap(self.scenario, {name: jnp.asarray(value)[index] for name, value in self.values.items()})
        return (
            picked if np.ndim(index) == 0 and not isinstance(index, slice) else Batch(scenario=picked, names=self.names)
        )


def batch(scenario: PyTree, values: Mapping[str, ArrayLike]) -> Batch:
    """Vary the named leaves of a scenario or a controller; only they get a batch axis, everything else is shared.

    Args:
        scenario: the scenario, or the controller, to vary.
        values: dotted leaf name -> array whose first axis is the batch, the same length for all.

    Raises:
        KeyError: a name is not one of its leaves.
        ValueError: nothing varies, an array has no batch axis, the lengths differ, or a value does not have the shape
            of its leaf.
    """
    if not values:
        raise ValueError("batch needs at least one leaf that varies")
    arrays = {name: value if isinstance(value, jax.Array) else np.asarray(value) for name, value in values.items()}
    lengths = {name: array.shape[0] if array.ndim else None for name, array in arrays.items()}
    if None in lengths.values() or len(set(lengths.values())) != 1:
        raise ValueError(f"batch needs one leading axis of the same length in every array; got {lengths}")
    for name, array in arrays.items():
        if not fits(scenario, name, array.shape[1:]):
            raise ValueError(f"batch needs for each scenario a value of {name}; got an array of shape {array.shape}")
    return Batch(scenario=replace(scenario, arrays), names=tuple(sorted(arrays)))


@looked_at
@functools.partial(jax.jit, static_argnames=("n_steps", "control_every", "integrator", "dtype", "block", "devices"))
def evaluate(  # long: half of it says what each argument is
    controller: Law | Batch,
    batch: Scenario | Batch,
    *,
    dt: Real = DT,
    n_steps: int = N_STEPS,
    control_every: int = 1,
    criteria: Criteria | None = None,
    integrator: Integrator = RK4,
    dtype: DTypeLike | None = None,
    block: int | None = None,
    devices: int | None = None,
) -> Metrics:
    """Metrics of every scenario of a batch, in memory that does not grow with the horizon.

    Args:
        controller: one controller for all scenarios, or a `Batch` of B, one each; `jax.vmap` to cross them.
        batch: a `Batch` of B scenarios, or a single `Scenario`.
        dt: step [s], traced.
        n_steps: number of steps.
        control_every: steps between control instants.
        criteria: how to judge; see `Criteria`.
        integrator: `RK4`, `HEUN` or `EULER`.
        dtype: float32 or float64; None takes JAX's default float.
        block: scenarios rolled out together, the blocks one after the other; None chooses about 128.
        devices: how many of JAX's local devices take a share; None: all, where each gets a block and no mesh is in
            force already. Neither this nor `block` changes more than the rounding. Where `jax.distributed` has joined
            several processes all devices of all of them take part, and every process is given all metrics.

    Returns:
        `Metrics` with a leading axis B, or without for a single scenario. Works under `jax.vmap`, `grad`, `jvp`, `jit`.

    Raises:
        ValueError: `dt` is not above 0, batches of different sizes, or `block` or `devices` out of range.
    """
    warn_if_slow()

    def one(controller: PyTree, scenario: PyTree) -> Metrics:
        rollout = Rollout(
            controller,
            scenario,
            timing=Timing(dt=dt, n_steps=n_steps, control_every=control_every, integrator=integrator),
            dtype=dtype,
            meter=Criteria() if criteria is None else criteria,
        )
        carry = rollout.metered()
        return rollout.meter.finish(carry.meter, carry.ok, rollout.end)

    sizes = {x.size for x in (controller, batch) if isinstance(x, Batch)}
    if len(sizes) > 1:
        raise ValueError(f"a batch of controllers and one of scenarios must have the same size; got {sorted(sizes)}")
    if not sizes:
        return one(controller, batch)
    count = sizes.pop()

    def many(values: PyTree) -> Metrics:
        return jax.vmap(lambda law, scene: one(_filled(controller, law), _filled(batch, scene)))(*values)

    values = jax.tree.map(jnp.asarray, (_varied(controller), _varied(batch)))
    shares = _shares(count, block, devices)
    rows, size = layout(count, block, shares)
    if rows == 1:
        return many(values)
    index = np.minimum(np.arange(rows * size), count - 1).reshape(rows, size)  # the last block repeats one
    blocks = jax.tree.map(lambda value: value[index], values)
    metrics = _shared(lambda part: jax.lax.map(many, part), shares)(blocks)
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:])[:count], metrics)


def _varied(tree: PyTree) -> dict[str, ArrayLike]:
    return tree.values if isinstance(tree, Batch) else {}


def _filled(tree: PyTree, values: Mapping[str, ArrayLike]) -> PyTree:
    return swap(tree.scenario, values) if isinstance(tree, Batch) else tree


def _shares(scenarios: int, block: int | None, devices: int | None) -> int:
    """How many devices share the work."""
    if jax.process_count() > 1:
        if devices is not None:
            raise ValueError(f"devices must be None where several processes are joined; got {devices}")
        return jax.device_count()
    local = jax.local_device_count()
    if devices is None:
        free = jax.sharding.get_abstract_mesh().empty
        return max(1, min(local, scenarios // (block or BLOCK))) if free else 1
    if not 1 <= devices <= local:
        raise ValueError(f"devices must be from 1 to the {local} that JAX has here; got {devices}")
    return devices


def layout(scenarios: int, block: int | None, shares: int) -> tuple[int, int]:
    """Number of blocks, a multiple of `shares`, and their size, of so many scenarios; `block` as of `evaluate`."""
    if block is not None and block < 1:
        raise ValueError(f"block must be at least 1; got {block}")
    each = -(-scenarios // shares)  # scenarios of one device
    rows = max(1, round(each / BLOCK)) if block is None else -(-each // block)
    return shares * rows, block if rows > 1 and block else -(-each // rows)


def _shared(function: Callable[[PyTree], PyTree], shares: int) -> Callable[[PyTree], PyTree]:
    """`function` on each device's part of the leading axis; the devices of several processes tell each other."""
    if shares == 1:
        return function
    joined = jax.process_count() > 1
    mesh = jax.sharding.Mesh(np.array((jax.devices() if joined else jax.local_devices())[:shares]), ("scenarios",))
    split, whole = jax.sharding.PartitionSpec("scenarios"), jax.sharding.PartitionSpec()

    def told(part: PyTree) -> PyTree:
        return jax.tree.map(lambda x: jax.lax.all_gather(x, "scenarios", tiled=True), function(part))

    if joined:
        return jax.shard_map(told, mesh=mesh, in_specs=split, out_specs=whole, check_vma=False)
    return jax.shard_map(function, mesh=mesh, in_specs=split, out_specs=split, check_vma=False)
