"""A sweep of the default ensemble into a folder, beside `evaluate` on the same scenarios and no folder."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from agvjax.engine.xla import cores

from .contest import jax_ready
from .turns import rate, ratio, take_turns

SIZE, STEPS = 65_536, 1200  # scenarios; steps of .01 s


def prepare(job: dict[str, Any]) -> Callable[[], Any]:
    """One or the other, compiled; returns total RMSE (B,)."""
    wait = jax_ready(job)
    import agvjax
    from tuning import Config, Sweep, load
    from tuning.sweep import shards, work
    from tuning.sweep.design import design

    config = Config(sweep=Sweep(over=(), ensemble=True, samples=SIZE, metrics=("total_rmse",)))
    plan = design(config)
    if job["form"] == "evaluate":
        batch = agvjax.batch(config.scenario, plan.values(0, SIZE))
        law = agvjax.check(config.controller)
        return lambda: wait(agvjax.evaluate(law, batch, dt=1e-2, n_steps=STEPS)).total_rmse
    made = work.manifest_of(config, plan, {"configured": config.controller})
    judges = work.judges(config, plan, [config.controller], config.sweep.shard)

    def sweep() -> Any:
        with tempfile.TemporaryDirectory() as folder:
            shards.write_manifest(Path(folder), made)
            work.run(Path(folder), made, plan, judges)
            return load(folder).metrics["total_rmse"][0]

    return sweep


def work(job: dict[str, Any]) -> float:
    """Millions of steps of one scenario."""
    return SIZE * STEPS / 1e6


def measure(turns: int) -> list[dict[str, Any]]:
    """The rate of a sweep as a share of that of `evaluate`."""
    jobs = {
        form: {"kind": "sweep", "form": form, "dtype": "float64", "threads": cores()} for form in ("evaluate", "sweep")
    }
    results = take_turns(jobs, turns)
    middle, low, high = ratio(results["evaluate"], results["sweep"])
    assert abs(results["sweep"]["value"] / results["evaluate"]["value"] - 1) < 1e-12
    row = {"scenarios": SIZE, "dtype": "float64", "cores": cores(), "mstep_per_s": rate(results["sweep"])}
    return [row | {"evaluate_mstep_per_s": rate(results["evaluate"]), "ratio": middle, "low": low, "high": high}]
