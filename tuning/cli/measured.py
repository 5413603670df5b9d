"""What is said of one run: its metrics by channel, or when it diverged."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import jax
import numpy as np
from jaxtyping import Array

import agvjax
from agvjax.draw import plot
from agvjax.metric_table import METRICS, metrics_of
from agvjax.metric_units import units_in

from ..io.pages import grid

BEFORE, OFTEN = 1.0, 4  # s before a divergence that are looked at; turns of a command in a second that are many

Number = float | str  # or words where there is none
CHANNELS = ("rmse", "rmse_late", "settling_time", "rms_command", "peak_command", "chatter")
ROUTED = ("cross_track", "cross_track_late", "cross_track_peak_late", "heading_error", "speed_error", "pace")
ROUTED += ("corridor_excess", "lateral_acceleration", "standstill", "time_to_finish", "total_chatter")
RIDDEN = ("arc", "cross_track", "heading_error", "speed", "wanted")  # of a route, kept sample by sample
Numbers = dict[str, Number | dict[str, Number]]  # by metric, and by channel or actuator where each has its own


def measured(trajectory: agvjax.Trajectory, criteria: agvjax.Criteria) -> agvjax.Metrics:
    """Metrics of a run, as one program: each operation by itself is one to load."""
    return jax.jit(agvjax.measure)(trajectory, criteria)


def divergence(trajectory: agvjax.Trajectory, limit: float) -> str:
    """When the vehicle left what its scenario allows, what passed that, and what it likely means."""
    held = np.asarray(trajectory.position)
    moves = np.flatnonzero(np.any(held != held[-1], axis=1))
    last = min(int(moves[-1]) + 1, len(held) - 1) if moves.size else 0
    when = float(trajectory.t[last])
    state = "the vehicle's state, its position counted from the path,"
    said = f"the run diverged at t = {when:.4g} s: {state} exceeded scenario.limit = {limit:g} and was frozen there"
    return f"{said}; {_why(trajectory, last)}"


def _why(run: agvjax.Trajectory, last: int) -> str:
    """What was large at a sample, and what the second before it looks like: a guess at the cause."""
    away = run.position[last] - run.reference_position[last] if run.route is None else run.route.cross_track[last]
    far, fast = float(np.linalg.norm(away)), float(np.linalg.norm(run.velocity[last]))
    parts = [f"it was {far:.3g} m from the path", f"moved at {fast:.3g} m/s"]
    t = np.asarray(run.t)
    first = int(np.searchsorted(t, t[last] - BEFORE))
    span, limited = float(t[last] - t[first]), float(np.mean(np.asarray(run.limited)[first : last + 1]))
    turns = np.diff(np.sign(np.diff(np.asarray(run.command)[first : last + 1], axis=0)), axis=0)
    often = int(np.max(np.sum(turns != 0, axis=0), initial=0))
    if limited > 0.5:
        parts.append(f"something was at its limit for {limited:.0%} of the last {span:.2g} s")
        cause = "the path or the start may ask for more than the vehicle can do"
    elif often >= max(3, OFTEN * span):
        parts.append(f"a command turned back {often} times in the last {span:.2g} s")
        cause = "gains may be too high for the delay or for the step"
    else:
        parts.append("its commands did not oscillate")
        cause = "gains may be of the wrong sign or far too high, the step too long, or the start too far from the path"
    return f"{', '.join(parts)}: {cause}"


def numbers(metrics: agvjax.Metrics, scenario: agvjax.Scenario) -> Numbers:
    """Metrics for `metrics.json`: a channel that has not settled says so and gives no number."""
    plant = scenario.plant
    delivered = [part for name in plant.actuators for part in plant.parts(name)]
    numbers: Numbers = {"ok": bool(metrics.ok)}
    for field in dataclasses.fields(metrics):
        if field.name in ("ok", "settled", "settling_smooth", "limited", "followed", "loop"):
            continue
        values = np.asarray(getattr(metrics, field.name)).tolist()
        if field.name == "settling_time":
            values = [v if s else "not settled" for v, s in zip(values, metrics.settled, strict=True)]
        places = delivered if field.name.endswith("_delivered") else plot.CHANNELS[: len(values)]
        numbers[field.name] = dict(zip(places, values, strict=True))
    totals: Numbers = {name: float(metrics[name]) for name in metrics_of(scenario) if METRICS[name].channel is None}
    settled = bool(np.all(metrics.settled))
    if "time_to_finish" in totals and totals["time_to_finish"] == np.inf:
        totals["time_to_finish"] = "not finished"
    return numbers | totals | ({} if settled else {"longest_settling_time": "not settled"})


def brief(numbers: Numbers, scenario: agvjax.Scenario) -> str:
    """The metrics that people look at: along a route where there is one, by channel elsewhere. All are in a file."""
    routed = {name: numbers[name] for name in ROUTED if name in numbers}
    rows = {name: values for name in CHANNELS if isinstance(values := numbers[name], dict)}
    lines = [[name, x, units_in(scenario)[name]] for name, x in routed.items()]
    table = grid(["metric", "value", "unit"], lines) if "cross_track" in routed else _table("metric", rows)
    share = numbers["limited"]
    limited = f"\n\nat a limit {share:.1%} of the time" if isinstance(share, float) and 0 < share < np.inf else ""
    return f"{table}{limited}"


def _table(corner: str, rows: Mapping[str, Mapping[str, Number]]) -> str:
    lines = [[name, *(x if isinstance(x, str) else f"{x:.5g}" for x in row.values())] for name, row in rows.items()]
    return grid([corner, *next(iter(rows.values()))], lines)


def arrays(trajectory: agvjax.Trajectory) -> dict[str, Array]:
    """All that is sampled, but the state of the law, by name."""
    sampled = {f.name: getattr(trajectory, f.name) for f in dataclasses.fields(trajectory)}
    sampled = {name: x for name, x in sampled.items() if x is not None and name not in ("controller", "ok", "route")}
    ride = trajectory.route
    return sampled if ride is None else sampled | {name: getattr(ride, name) for name in RIDDEN}
