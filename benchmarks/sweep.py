"""A sweep of the default ensemble into a folder, here and by workers, beside `evaluate` on the same scenarios."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from agvjax.engine.xla import cores

from .contest import jax_ready
from .turns import rate, ratio, take_turns

SIZE, STEPS = 65_536, 1200  # scenarios; steps of .01 s
ENDS = contextlib.ExitStack()  # workers end with the process


def prepare(job: dict[str, Any]) -> Callable[[], Any]:
    """One of them, compiled; returns total RMSE (B,)."""
    wait = jax_ready(job)
    import agvjax
    from tuning import Config, Sweep, load
    from tuning.compute import schedule
    from tuning.config.complete import complete
    from tuning.sweep import run, shards, work
    from tuning.sweep.laws import CONFIGURED

    config = complete(Config(sweep=Sweep(over=(), ensemble=True, samples=SIZE, metrics=("total_rmse",))))
    plan = work.planned(config)
    if job["form"] == "evaluate":
        batch = agvjax.batch(config.scenario, plan.values(0, SIZE))
        law = agvjax.check(config.controller)
        return lambda: wait(agvjax.evaluate(law, batch, dt=1e-2, n_steps=STEPS)).total_rmse
    made = work.manifest_of(config, plan, {CONFIGURED: config.controller})
    jobs = run.jobs(run.parcel(made), plan, work.judges(config, plan, [config.controller], config.sweep.shard))
    spelled = f"local:{job['threads']}" if job["form"] == "workers" else None
    engine = ENDS.enter_context(schedule.opened(spelled, print))

    def sweep() -> Any:
        with tempfile.TemporaryDirectory() as folder:
            shards.write_manifest(Path(folder), made)
            run.fill(Path(folder), made, range(made.shards), jobs, engine)
            return load(folder).metrics["total_rmse"][0]

    return sweep


def work(job: dict[str, Any]) -> float:
    """Millions of steps of one scenario."""
    return SIZE * STEPS / 1e6


def measure(turns: int) -> list[dict[str, Any]]:
    """The rate of a sweep as a share of that of `evaluate`, and that of one by workers as a share of it."""
    forms = ("evaluate", "sweep", "workers")
    jobs = {form: {"kind": "sweep", "form": form, "dtype": "float64", "threads": cores()} for form in forms}
    results = take_turns(jobs, turns)
    middle, low, high = ratio(results["evaluate"], results["sweep"])
    assert abs(results["sweep"]["value"] / results["evaluate"]["value"] - 1) < 1e-12
    assert results["workers"]["value"] == results["sweep"]["value"]
    row = {"scenarios": SIZE, "dtype": "float64", "cores": cores(), "mstep_per_s": rate(results["sweep"])}
    row |= {"evaluate_mstep_per_s": rate(results["evaluate"]), "ratio": middle, "low": low, "high": high}
    middle, low, high = ratio(results["sweep"], results["workers"])
    row |= {"workers_mstep_per_s": rate(results["workers"]), "workers_ratio": middle, "workers_low": low}
    return [row | {"workers_high": high}]
