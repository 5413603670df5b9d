"""On a GPU: `python -m benchmarks.gpu`. The scan of `evaluate` beside a kernel that keeps the state in registers.

The kernel (Pallas) runs the same rewritten step over the whole horizon for a block of scenarios and returns their
squared tracking error. `--interpret` runs it without a GPU, slowly, to see that both agree.
"""

from __future__ import annotations

import argparse
import functools
import json
import statistics
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend import core

import agvjax
from agvjax.engine.rollout import Rollout
from agvjax.engine.scalarise import scalarise, split_tree
from agvjax.leaves import swap
from agvjax.timing import Timing

from .__main__ import RESULTS, machine, table
from .rollout import ensemble

DT = 1e-3
FLOPS_PER_STEP = 1900  # of one scenario: operations in the compiled step, an exponential counted as 18


def _columns(tree: Any) -> list[Any]:
    """A batched tree as a list of (B,) arrays."""
    return [x[(slice(None), *i)] for x in jax.tree.leaves(tree) for i in np.ndindex(x.shape[1:])]


def in_registers(controller: Any, scenario: Any, values: Any, n_steps: int, block: int, interpret: bool) -> Any:
    """Integral of squared tracking error (B, 3), by one kernel launch for the whole horizon."""
    from jax.experimental import pallas as pl

    criteria, dtype = agvjax.Criteria(), jnp.float32
    timing = Timing(dt=DT, n_steps=n_steps, control_every=1, integrator=agvjax.RK4)

    def rollout(v: Any) -> Rollout:
        return Rollout(controller, swap(scenario, v), meter=criteria, timing=timing, dtype=dtype)

    shared = Rollout(controller, scenario, meter=criteria, timing=timing, dtype=dtype)
    begin = jax.vmap(lambda v: rollout(v).begin())(values)
    rows = shared.table(jnp.array(0), n_steps)
    first = [jax.tree.map(lambda x: x[0], tree) for tree in (begin, rows, values)]
    step, _ = scalarise(lambda carry, row, v: rollout(v).step(carry, row)[0], *first)
    carry, inputs, signals = _columns(begin), _columns(values), _columns(rows)
    kinds = [x.dtype for x in carry]
    size, wanted = inputs[0].shape[0], _positions(begin)
    numbers = [[x[0] for x in columns] for columns in (carry, signals, inputs)]
    closed = jax.make_jaxpr(lambda s, row, v: jax.tree.leaves(step(s, row, v)))(*numbers)
    gains = [jnp.asarray(x) for x in closed.consts]  # what the step closes over: a kernel wants it as an input

    def kernel(gain_ref: Any, signal_ref: Any, carry_ref: Any, input_ref: Any, out_ref: Any) -> None:
        constants = [gain_ref[i].astype(x.dtype) for i, x in enumerate(gains)]
        once = core.jaxpr_as_fun(core.ClosedJaxpr(closed.jaxpr, constants))
        state = [carry_ref[i, :].astype(kind) for i, kind in enumerate(kinds)]
        given = [input_ref[i, :] for i in range(len(inputs))]

        def advance(k: Any, state: list[Any]) -> list[Any]:
            row = [signal_ref[k, i] for i in range(len(signals))]
            row = [x.astype(y.dtype) for x, y in zip(row, signals, strict=True)]
            return jax.vmap(lambda s, v: once(*s, *row, *v))(state, given)

        state = jax.lax.fori_loop(0, n_steps, advance, state)
        for i, place in enumerate(wanted):
            out_ref[i, :] = state[place]

    wide = lambda count: pl.BlockSpec((count, block), lambda b: (0, b))  # noqa: E731
    whole = pl.BlockSpec((n_steps, len(signals)), lambda b: (0, 0))
    call = pl.pallas_call(
        kernel,
        grid=(size // block,),
        in_specs=[pl.BlockSpec((len(gains),), lambda b: (0,)), whole, wide(len(carry)), wide(len(inputs))],
        out_specs=wide(len(wanted)),
        out_shape=jax.ShapeDtypeStruct((len(wanted), size), dtype),
        interpret=interpret,
    )
    stack = lambda parts, axis: jnp.stack([x.astype(dtype) for x in parts], axis)  # noqa: E731
    return call(stack(gains, 0), stack(signals, 1), stack(carry, 0), stack(inputs, 0)).T


def _positions(carry: Any) -> list[int]:
    """Where in the list of numbers the squared errors are."""
    numbers = jax.tree.map(lambda x: x[0], carry)
    names = split_tree(jax.tree.map(lambda x: np.zeros(np.shape(x)), numbers))
    marked = jax.tree.leaves(names.meter.squared)
    every = jax.tree.leaves(names)
    return [next(i for i, x in enumerate(every) if x is m) for m in marked]


def _median_seconds(function: Callable[[], Any], turns: int) -> float:
    jax.block_until_ready(function())
    seconds = []
    for _ in range(turns):
        begin = time.perf_counter()
        jax.block_until_ready(function())
        seconds.append(time.perf_counter() - begin)
    return statistics.median(seconds)


def main() -> None:
    """Measure both forms for growing batches, and keep the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gpu", description=__doc__)
    parser.add_argument("--batches", type=int, nargs="+", default=[1024, 16_384, 131_072, 1_048_576])
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--block", type=int, default=128, help="scenarios of one program of the kernel")
    parser.add_argument("--interpret", action="store_true")
    given = parser.parse_args()
    if jax.default_backend() != "gpu" and not given.interpret:
        parser.exit(2, "no GPU here; --interpret checks the kernel without one\n")
    rows = []
    for size in given.batches:
        controller, scenario, values = ensemble(size)
        values = {name: jnp.asarray(value, jnp.float32) for name, value in values.items()}
        many = agvjax.batch(scenario, values)

        def scan(many: Any = many, size: int = size, controller: Any = controller) -> Any:
            return agvjax.evaluate(controller, many, dt=DT, n_steps=given.steps, block=size, dtype=jnp.float32).ise

        run = jax.jit(
            lambda c, v, s=scenario: in_registers(c, s, v, given.steps, given.block, given.interpret)  # pyright: ignore
        )
        apart = jnp.max(jnp.abs(run(controller, values) - scan() + _last(controller, many, given.steps)))
        row = {"batch": size, "steps": given.steps, "largest difference of ise": float(apart)}
        if not given.interpret:
            kernel = functools.partial(run, controller, values)
            for name, function in (("scan", scan), ("registers", kernel)):
                rate = size * given.steps / _median_seconds(function, given.turns) / 1e6
                row |= {f"{name}_mstep_per_s": rate, f"{name}_gflop_per_s": rate * FLOPS_PER_STEP / 1e3}
        rows.append(row)
    kept = {"part": "gpu", "machine": machine() | {"processor": jax.devices()[0].device_kind}, "rows": rows}
    print(table(kept))
    if not given.interpret:
        (RESULTS / "gpu.json").write_text(json.dumps(kept, indent=1) + "\n")
        (RESULTS / "gpu.md").write_text(table(kept))


def _last(controller: Any, many: Any, steps: int) -> Any:
    """What `evaluate` adds for the sample at the end of the run: half a step of its squared error."""

    def one(scenario: Any) -> Any:
        end = agvjax.simulate(controller, scenario, dt=DT, n_steps=steps, save_every=steps, dtype=jnp.float32)
        return agvjax.tracking_error(end)[-1] ** 2 * DT / 2

    return jax.vmap(one, in_axes=(many.axes,))(many.scenario)


if __name__ == "__main__":
    main()
