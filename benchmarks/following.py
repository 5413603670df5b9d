"""Rollouts of regulated pure pursuit on a base along a route: `evaluate` beside numba, one thread, the same loop."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .contest import jax_ready
from .rollout import compare

DT, STEPS = 5e-3, 9000  # 45 s, of the preset


def prepare(job: dict[str, Any]) -> Callable[[], Any]:
    """A compiled rollout of the preset's ensemble that returns the RMS distance to the route after 4 s (B,)."""
    wait = jax_ready(job)
    import agvjax
    from tuning import config, sample

    base = config.load(["base"])
    batch = sample(base.scenario, base.ensemble.draws, job["batch"], seed=0)
    values = {name: np.asarray(value, job["dtype"]) for name, value in batch.values.items()}
    if job["form"] == "numba":
        from .peers import numba_route

        route, law = base.scenario.path, base.controller.inner
        assert isinstance(route, agvjax.Route) and isinstance(law, agvjax.RegulatedPurePursuit)
        arcs = np.linspace(0, float(route.length), 20_000, endpoint=False)
        points = np.asarray(_places(route, arcs))
        return numba_route.contestant(
            values, points, float(law.desired_linear_vel), dt=job["dt"], n_steps=job["steps"], dtype=job["dtype"]
        )
    import jax

    @jax.jit
    def total(values: Any) -> Any:
        many = agvjax.batch(base.scenario, values)
        criteria = agvjax.Criteria.of(["cross_track_late"])
        metrics = agvjax.evaluate(base.controller, many, criteria=criteria, **base.timing())
        return metrics["cross_track_late"]

    return lambda: wait(total(values))


def _places(route: Any, arcs: np.ndarray) -> Any:
    import jax
    import jax.numpy as jnp

    return jax.vmap(lambda arc: route.at(arc, jnp.zeros_like(arc)).position)(jnp.asarray(arcs))


def work(job: dict[str, Any]) -> float:
    """Millions of steps of one scenario."""
    return job["batch"] * job["steps"] / 1e6


def measure(turns: int) -> list[dict[str, Any]]:
    """A row for each peer and size: Mstep/s and the ratio; a control step is every tenth."""
    rows = []
    for batch in (64, 256):
        kept = {"kind": "following", "batch": batch, "dtype": "float32", "dt": DT, "steps": STEPS}
        jobs = {"agvjax": kept | {"form": "agvjax"}, "numba": kept | {"form": "numba"}}
        setting = {"batch": batch, "dtype": "float32", "law": "RegulatedPurePursuit", "plant": "base"}
        rows += compare(jobs, turns, setting, same=False)
    return rows
