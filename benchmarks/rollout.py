"""Rollouts of the default tuning ensemble: `evaluate` beside every peer, one thread, same loop, same accuracy."""

from __future__ import annotations

import functools
import importlib
from collections.abc import Callable
from typing import Any

import numpy as np

from agvjax.engine.xla import cores

from .contest import PEERS, jax_ready
from .turns import rate, ratio, take_turns

LAP = 12.0  # s
STEPS = {"numpy": 1200, "scipy": 12000, "casadi": 12000}  # per run: long enough to be timed, short enough to wait for
ALONE = ("scipy", "casadi")  # one scenario after the other: their speed is that of a single one


def prepare(job: dict[str, Any]) -> Callable[[], Any]:
    """A compiled rollout of the ensemble that returns total RMSE (B,)."""
    if job["form"] in PEERS:
        values = ensemble(job["batch"])[2]
        peer = importlib.import_module(f".peers.{PEERS[job['form']]}", __package__)
        extra = {"scalar": True} if job.get("scalar") else {}
        return peer.contestant(values, dt=job["dt"], n_steps=job["steps"], dtype=job["dtype"], **extra)
    wait = jax_ready(job)
    import jax

    import agvjax

    controller, scenario, values = ensemble(job["batch"])
    values = {name: np.asarray(value, job["dtype"]) for name, value in values.items()}
    if job["form"] == "plain":
        from .plain import plain

        many = agvjax.batch(scenario, values)
        one = functools.partial(plain, dt=job["dt"], steps=job["steps"])
        whole = jax.jit(jax.vmap(one, in_axes=(None, many.axes)))
        return lambda: wait(whole(controller, many.scenario))
    method = agvjax.INTEGRATORS[job.get("integrator", "rk4")]

    @jax.jit
    def total(controller: Any, values: Any) -> Any:
        many = agvjax.batch(scenario, values)
        return agvjax.evaluate(controller, many, dt=job["dt"], n_steps=job["steps"], integrator=method)

    return lambda: wait(total(controller, values)).total_rmse


def ensemble(size: int) -> tuple[Any, Any, dict[str, np.ndarray]]:
    """Controller, scenario and the varying leaves of the default tuning problem."""
    import agvjax
    from tuning import default_draws, sample

    scenario = agvjax.Scenario()
    values = sample(scenario, default_draws(), size, seed=0).values
    return agvjax.NeuroBackstepping(), scenario, {name: np.asarray(value) for name, value in values.items()}


def work(job: dict[str, Any]) -> float:
    """Millions of steps of one scenario."""
    return job["batch"] * job["steps"] / 1e6


def job(form: str, batch: int, dtype: str = "float32", **more: Any) -> dict[str, Any]:
    """A run of about a second or less, at the step of the reproduction."""
    steps = STEPS.get(form, max(600, min(12000, 64 * 12000 // batch)))
    return {"kind": "rollout", "form": form, "batch": batch, "dtype": dtype, "dt": 1e-3, "steps": steps, **more}


def measure(turns: int) -> list[dict[str, Any]]:
    """A row for each peer and setting: `evaluate` and the peer, Mstep/s and the ratio."""
    rows = []
    for dtype in ("float32", "float64"):
        for batch in (1, 64, 1024, 8192):
            forms = ["c"] if batch == 8192 else ["c", "plain", "numba", "diffrax"]
            forms += ["numpy"] if batch == 1024 else []
            forms += ["scipy", "casadi"] if dtype == "float64" and batch <= 64 else []
            jobs = {"agvjax": job("agvjax", batch, dtype)}
            if dtype == "float32" and batch in (64, 1024):
                jobs["agvjax, default flags"] = job("agvjax", batch, dtype, flags="default")
            for form in forms:
                more = {"flags": "default"} if form in ("plain", "diffrax") else {}
                more |= {"scalar": True} if form == "c" and batch == 1 else {}
                jobs[form] = job(form, 1 if form in ALONE else batch, dtype, **more)
            rows += compare(jobs, turns, {"batch": batch, "dtype": dtype, "integrator": "rk4"})
    jobs = {"agvjax": job("agvjax", 1024, integrator="euler"), "agvjax, rk4": job("agvjax", 1024)}
    rows += compare(jobs, turns, {"batch": 1024, "dtype": "float32", "integrator": "euler"}, same=False)
    return rows


def measure_cores(turns: int) -> list[dict[str, Any]]:
    """The same batch on one core and on all of them."""
    rows, many = [], cores()
    for batch in (1024, 8192):
        jobs = {"agvjax": job("agvjax", batch, threads=many), "agvjax, one core": job("agvjax", batch)}
        rows += compare(jobs, turns, {"batch": batch, "dtype": "float32", "integrator": "rk4", "cores": many})
    return rows


def compare(
    jobs: dict[str, dict[str, Any]], turns: int, setting: dict[str, Any], same: bool = True
) -> list[dict[str, Any]]:
    """Rows of one group of contestants that took turns; the first is what the others are held against."""
    results = take_turns(jobs, turns)
    ours = results["agvjax"]
    rows = []
    for name, result in results.items():
        middle, low, high = ratio(result, ours)
        row = {**setting, "peer": name, "mstep_per_s": rate(result), "ours_mstep_per_s": rate(ours)}
        rows.append(row | {"ratio": middle, "low": low, "high": high, "value": result["value"], "ours": ours["value"]})
        if same and all(jobs[name][key] == jobs["agvjax"][key] for key in ("steps", "batch")):
            assert abs(result["value"] / ours["value"] - 1) < 2e-3, row  # the same loop
    return rows
