"""Statements about the paper as computed cells: what the network does, what the gains do, what events save."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

import agvjax
from agvjax.paths.heading import reference

from ...io.files import Json
from . import cases
from .cases import Judged, Run
from .published import CHANNELS

REFINEMENTS = 5  # halvings of the step in the Zeno check


def seen(trajectory: agvjax.Trajectory) -> Any:
    """What the law measured along a run of the decoupled plant."""
    return agvjax.Measurement(
        position=trajectory.position,
        velocity=trajectory.velocity,
        heading=trajectory.heading,
        yaw_rate=trajectory.delivered[..., 2],
    )


def network(judged: Judged, groups: Mapping[str, Mapping[str, cases.Case]]) -> list[Json]:
    """Fact (a): how large the network's gain becomes beside k2, and what it does to the RMSE, for each b1."""
    every: dict[str, Any] = {name: case.controller for group in groups.values() for name, case in group.items()}
    rows = []
    for prefix, known in (("b1", False), ("known b1", True)):
        for b1 in cases.B1:
            name = f"{prefix}={b1:g}"
            rows.append({"b1": b1, "known_slopes": known, **_network_row(judged[name], every[name])})
    without = judged["no_network"].judged.rmse
    none = {"b1": None, "known_slopes": False, "gain_position": 0.0, "gain_heading": 0.0}
    return [*rows, none | {f"rmse_{c}": float(without[i]) for i, c in enumerate(CHANNELS)}]


def _network_row(run: Run, controller: agvjax.NeuroBackstepping) -> dict[str, float]:
    trajectory, metrics = run
    gains = network_gains(trajectory, seen(trajectory), controller)
    rmse = metrics["0.05"].rmse
    named = {"gain_position": gains[0], "gain_heading": gains[1]}
    return named | {f"rmse_{c}": float(rmse[i]) for i, c in enumerate(CHANNELS)}


def network_gains(trajectory: agvjax.Trajectory, measured: Any, controller: agvjax.NeuroBackstepping) -> list[float]:
    """Largest gain along a run [1/s] that the network adds to k2 in (41), and to k3 in (63)."""
    norms = np.asarray(trajectory.weight_norm)
    shares = jax.vmap(controller.shares)(jax.tree.map(jnp.asarray, measured))
    gains = []
    for i, (belief, columns) in enumerate(((controller.Pi_hat, slice(0, 2)), (controller.Pi_psi_hat, slice(2, 3)))):
        slope = np.asarray(belief)
        if isinstance(belief, agvjax.readings.KnownSlopes):
            slope = np.where(np.asarray(trajectory.command)[:, columns] > 0, belief.right, belief.left)
        gains.append(float(np.max((norms[:, i] * np.asarray(shares[i]))[:, None] / slope)))
    return gains


def bandwidth(judged: Judged) -> list[Json]:
    """Fact (b): at matched bandwidth, in which channels each law beats the proposed one, and at what peak command."""
    rows = []
    for p in cases.BANDWIDTHS:
        base = judged[f"proposed p={p:g}"].judged
        for law in ("osfc", "asmc", "dfc", "ftsmc"):
            other = judged[f"{law} p={p:g}"].judged
            row: Json = {"p": p, "law": law}
            for metric in ("rmse", "rmse_late", "settling_time"):
                mine, theirs = np.asarray(getattr(base, metric)), np.asarray(getattr(other, metric))
                row[f"better_{metric}"] = [c for i, c in enumerate(CHANNELS) if theirs[i] < mine[i]]
            row |= {"peak_law": float(other.peak_command.max()), "peak_proposed": float(base.peak_command.max())}
            rows.append(row)
    return rows


def updates(trajectory: agvjax.Trajectory) -> Json:
    """How often each channel of an event-triggered run was updated, and the shortest interval between updates [s]."""
    t, command = np.asarray(trajectory.t), np.asarray(trajectory.command)
    counts, shortest = [], []
    for i in range(3):
        moments = t[1:][np.diff(command[:, i]) != 0]
        counts.append(int(moments.size))
        shortest.append(float(np.diff(moments).min()) if moments.size > 1 else float("inf"))
    return {"updates": counts, "shortest": shortest, "of": t.size - 1}


def steepest(trajectory: agvjax.Trajectory, controller: agvjax.EventTriggered, scenario: agvjax.Scenario) -> np.ndarray:
    """Largest |rate| of what the law inside asks for along an event-triggered run, (3,) [1/s of the command]."""

    def asked(t: Array, flow: PyTree, measurement: agvjax.Measurement) -> agvjax.Command:
        ref = reference(scenario.path, scenario.heading, t)
        command, _ = controller.inner.law(flow, (), measurement, ref)
        return agvjax.Command(position=command.position, heading=command.heading)

    inputs = jax.tree.map(jnp.asarray, (trajectory.t, trajectory.controller, seen(trajectory)))
    out = jax.jit(jax.vmap(asked))(*inputs)
    u = np.column_stack([np.asarray(out.position), np.asarray(out.heading)])
    return np.abs(np.diff(u, axis=0)).max(axis=0) / float(trajectory.t[1] - trajectory.t[0])


def zeno(case: cases.Case, timing: Mapping[str, Any]) -> Json:
    """The shortest interval at ever finer steps, beside its bound m / sup |u'|; whether it is the grid's or its own."""
    law, rows = case.controller, []
    if not isinstance(law, agvjax.EventTriggered):
        raise ValueError(f"zeno needs an event-triggered law; got {type(law).__name__}")
    runs = []
    for k in range(REFINEMENTS):
        finer = {**timing, "dt": timing["dt"] / 2**k}  # as many steps: the shortest interval is in the first instants
        runs.append(cases.roll({"event": case}, finer)["event"].trajectory)
        rows.append({"dt": finer["dt"], "shortest": updates(runs[-1])["shortest"]})
    rates = steepest(runs[-1], law, case.scenario)
    m = np.broadcast_to(np.asarray(law.m, float), (3,))
    before, last = (np.array(row["shortest"]) for row in rows[-2:])
    limited = ((last <= 1.5 * rows[-1]["dt"]) | (last < 0.75 * before)).tolist()
    return {"steps": rows, "rate": rates.tolist(), "bound": (m / rates).tolist(), "grid_limited": limited}


def cost(
    controllers: Mapping[str, Any], scenario: agvjax.Scenario, timing: Mapping[str, Any], repeats: int = 7
) -> Json:
    """Run time of a closed-loop step beside the first law's, interleaved in one run, and numbers of states."""
    once = {name: _runner(c, scenario, {**timing, "save_every": timing["n_steps"]}) for name, c in controllers.items()}
    for run in once.values():
        run()
    times: dict[str, list[float]] = {name: [] for name in once}
    for _ in range(repeats):
        for name, run in once.items():
            begin = time.perf_counter()
            run()
            times[name].append(time.perf_counter() - begin)
    base = np.array(times[next(iter(times))])
    found = {}
    for name, controller in controllers.items():
        ratios = np.array(times[name]) / base
        states = jax.eval_shape(controller.init, *_example())
        adapted = sum(x.size for x in jax.tree.leaves(states.network))
        found[name] = {
            "time": float(np.median(ratios)),
            "time_spread": [float(ratios.min()), float(ratios.max())],
            "adapted": adapted,
            "states": sum(x.size for x in jax.tree.leaves(states)),
        }
    return found


def _runner(controller: agvjax.Law, scenario: agvjax.Scenario, timing: Mapping[str, Any]) -> Callable[[], Any]:
    controller, scenario = agvjax.check(controller), agvjax.check(scenario)
    return lambda: jax.block_until_ready(agvjax.simulate(controller, scenario, **timing))


def _example() -> tuple[Any, Any]:
    zero, pair = jnp.zeros(()), jnp.zeros(2)
    measurement = agvjax.Measurement(position=pair, velocity=pair, heading=zero, yaw_rate=zero)
    still = {"position": pair, "velocity": pair, "acceleration": pair}
    return measurement, agvjax.Reference(**still, heading=zero, heading_rate=zero)
