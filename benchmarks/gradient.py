"""What a gradient costs, in rollouts of the same problem: by mode, number of parameters and horizon.

Parameters are the seven gains and, beyond them, amplitudes of a disturbance that is a sum of cosines.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import agvjax

from .contest import jax_ready
from .rollout import ensemble
from .turns import ratio, take_turns

GAINS = agvjax.NeuroBackstepping.tunable


def problem(job: dict[str, Any]) -> tuple[Callable[[Any], Any], Any]:
    """Mean tracking error of the ensemble as a function of the parameters, and where to look."""
    import jax.numpy as jnp

    law, scenario, values = ensemble(job["batch"])
    del values["disturbance.amplitude"]
    count = job["parameters"]
    names, waves = GAINS[:count], max(1, count - len(GAINS))
    series = agvjax.CosineSum(
        amplitudes=np.full(waves, 0.2 / waves), omegas=np.linspace(0.5, 5.0, waves), phases=np.zeros(waves)
    )
    start = np.array([*(float(agvjax.leaves(law)[name]) for name in names), *series.amplitudes[: count - len(names)]])
    scenario = agvjax.Scenario(disturbance=series)

    def cost(x: Any) -> Any:
        scene = scenario
        if count > len(GAINS):
            scene = agvjax.replace(scenario, {"disturbance.amplitudes": x[len(GAINS) :]})
        many = agvjax.batch(scene, {name: jnp.asarray(value, x.dtype) for name, value in values.items()})
        controller = agvjax.replace(law, {name: x[i] for i, name in enumerate(names)})
        block = {"block": job["block"]} if "block" in job else {}
        metrics = agvjax.evaluate(
            controller, many, dt=job["dt"], n_steps=job["steps"], dtype=x.dtype.type, devices=1, **block
        )
        return jnp.mean(metrics.total_rmse)

    return cost, start.astype(job["dtype"])


def compute(job: dict[str, Any]) -> tuple[Callable[[Any], Any], Any]:
    """The value, or the gradient in the mode of the job; and its argument."""
    import jax
    import jax.numpy as jnp

    cost, start = problem(job)

    def forward(x: Any) -> Any:
        return jax.vmap(lambda v: jax.jvp(cost, (x,), (v,))[1])(jnp.eye(x.size, dtype=x.dtype))

    return jax.jit({"value": cost, "forward": forward, "reverse": jax.grad(cost)}[job["mode"]]), start


def prepare(job: dict[str, Any]) -> Callable[[], Any]:
    """Compiled, ready to be called; or, for "memory", what XLA says it needs."""
    wait = jax_ready(job)
    function, start = compute(job)
    if job["kind"] == "memory":
        needs = function.lower(start).compile().memory_analysis().temp_size_in_bytes
        return lambda: np.array([needs / 2**20])
    return lambda: wait(function(start))


def work(job: dict[str, Any]) -> float:
    """Gradients."""
    return 1.0


def measure(turns: int) -> list[dict[str, Any]]:
    """Cost of a gradient in rollouts, for both modes."""
    rows = []
    cases = [(count, 2400) for count in (1, 7, 30, 100, 200)] + [(7, 1000), (7, 10_000), (7, 100_000)]
    for parameters, steps in cases:
        batch = 64 if steps <= 10_000 else 8
        common = {"kind": "gradient", "dtype": "float64", "dt": 5e-3, "parameters": parameters}
        common |= {"steps": steps, "batch": batch}
        jobs = {"value": {**common, "mode": "value"}}
        jobs["forward"] = {**common, "mode": "forward", "block": 64}
        jobs["reverse"] = {**common, "mode": "reverse", "flags": "reverse"}
        results = take_turns(jobs, turns if steps <= 10_000 else 3)
        for name in ("forward", "reverse"):
            middle, low, high = ratio(results[name], results["value"])
            row = {"parameters": parameters, "steps": steps, "batch": batch, "mode": name}
            rows.append(row | {"rollouts": middle, "low": low, "high": high, "norm": results[name]["value"]})
        assert abs(rows[-1]["norm"] / rows[-2]["norm"] - 1) < 1e-6, rows[-2:]  # both modes agree
    return rows


def measure_memory() -> list[dict[str, Any]]:
    """XLA's own account of temporary memory, by horizon."""
    rows = []
    for mode in ("value", "forward", "reverse"):
        for steps in (1000, 10_000, 100_000):
            common = {"kind": "memory", "dtype": "float64", "dt": 1e-3, "parameters": 7, "steps": steps, "batch": 64}
            flags = {"flags": "reverse"} if mode == "reverse" else {}
            found = take_turns({"m": {**common, "mode": mode, **flags}}, 0)["m"]
            rows.append({"mode": mode, "steps": steps, "temporary_mb": found["value"], "compile_s": found["ready_s"]})
    return rows
