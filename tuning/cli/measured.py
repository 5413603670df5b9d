"""What is said of one run: its metrics by channel, or when it diverged."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Array

import agvjax
from agvjax.draw import plot
from agvjax.metric_table import METRICS, metrics_of

from ..io.pages import grid

Number = float | str  # or words where there is none
RIDDEN = ("arc", "cross_track", "heading_error", "speed", "wanted")  # of a route, kept sample by sample
Numbers = dict[str, Number | dict[str, Number]]  # by metric, and by channel or actuator where each has its own


def divergence(trajectory: agvjax.Trajectory, limit: float) -> str:
    """When the vehicle left what its scenario allows, and what that is."""
    held = np.asarray(trajectory.position)
    moves = np.flatnonzero(np.any(held != held[-1], axis=1))
    when = float(trajectory.t[min(moves[-1] + 1, len(held) - 1)]) if moves.size else 0.0
    state = "the vehicle's state, its position counted from the path,"
    return f"the run diverged at t = {when:.4g} s: {state} passed scenario.limit = {limit:g} and was held there"


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


def tables(numbers: Numbers) -> str:
    """The metrics by channel, how a route was followed, and what the actuators delivered."""
    routed = {name: x for name, x in numbers.items() if name in METRICS and METRICS[name].route}
    lines = [[name.replace("_", " "), x, METRICS[name].unit] for name, x in routed.items()]
    route = grid(["along the route", "", "unit"], lines) + "\n\n" if routed else ""
    rows = {name: values for name, values in numbers.items() if isinstance(values, dict)}
    delivered = {name.removesuffix("_delivered"): rows.pop(name) for name in list(rows) if name.endswith("_delivered")}
    limited = f"\nat a limit {numbers['limited']:.1%} of the time" if numbers["limited"] else ""
    return f"{route}{_table('metric', rows)}\n\n{_table('delivered', delivered)}{limited}"


def _table(corner: str, rows: Mapping[str, Mapping[str, Number]]) -> str:
    lines = [[name, *(x if isinstance(x, str) else f"{x:.5g}" for x in row.values())] for name, row in rows.items()]
    return grid([corner, *next(iter(rows.values()))], lines)


def arrays(trajectory: agvjax.Trajectory) -> dict[str, Array]:
    """All that is sampled, but the state of the law, by name."""
    sampled = {f.name: getattr(trajectory, f.name) for f in dataclasses.fields(trajectory)}
    sampled = {name: x for name, x in sampled.items() if x is not None and name not in ("controller", "ok", "route")}
    ride = trajectory.route
    return sampled if ride is None else sampled | {name: getattr(ride, name) for name in RIDDEN}
