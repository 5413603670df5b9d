"""What a tuning run found: the table and the figures at its end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

import agvjax
from agvjax import plot

from .objective import METRICS, UNITS
from .optimise import FEASIBLE, HISTORY

SHOWN = ("rmse", "effort", "peak_position", "peak_heading", "chatter")


class Judged(NamedTuple):
    """Mean and worst of every metric over an ensemble, of the runs that did not diverge, and how many did."""

    mean: dict[str, float]
    worst: dict[str, float]
    latched: int
    size: int
    worst_index: int  # scenario with the largest error


def judge(metrics: agvjax.Metrics) -> Judged:
    """Summary of an ensemble's metrics; the worst index is of a diverged run where there is one."""
    ok = np.asarray(metrics.ok)
    values = {name: np.asarray(metric(metrics)) for name, metric in METRICS.items()}
    kept = {name: v[ok] for name, v in values.items()}
    none = not ok.any()
    return Judged(
        mean={name: np.inf if none else float(v.mean()) for name, v in kept.items()},
        worst={name: np.inf if none else float(v.max()) for name, v in kept.items()},
        latched=int((~ok).sum()),
        size=ok.size,
        worst_index=int(np.argmax(values["rmse"])),
    )


def comparison(before: Judged, after: Judged) -> str:
    """Before, after and their ratio, as a Markdown table."""
    rows = [
        "| metric | unit | mean before | after | ratio | worst before | after | ratio |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name in SHOWN:
        cells = [name, UNITS[name]]
        for old, new in ((before.mean[name], after.mean[name]), (before.worst[name], after.worst[name])):
            cells += [f"{old:.5g}", f"{new:.5g}", f"**{new / old:.3f}**"]
        rows.append("| " + " | ".join(cells) + " |")
    rows.append(f"| diverged runs | of {before.size} | {before.latched} | {after.latched} | | | | |")
    return "\n".join(rows)


def unmet(before: Judged, after: Judged, limits: Mapping[str, float]) -> list[str]:
    """The limits that the tuned gains exceed, each with by how much."""
    found = []
    for name, limit in limits.items():
        for what, old, new in (
            ("mean", before.mean[name], after.mean[name]),
            ("worst", before.worst[name], after.worst[name]),
        ):
            if new / old > limit + FEASIBLE:
                found.append(f"{what} {name} is {new / old:.4f} of the starting gains', limit {limit:g}")
    return found


def gains(names: Sequence[str], before: Any, after: Any, stability: Mapping[str, float]) -> str:
    """Gains before and after, with the margin to each stability condition."""
    rows = ["| gain | before | after | must exceed | margin |", "|---|---|---|---|---|"]
    old, new = agvjax.leaves(before), agvjax.leaves(after)
    for name in dict.fromkeys([*names, *stability]):
        bound = stability.get(name)
        condition = ["", ""] if bound is None else [f"{bound:.4g}", f"{float(new[name]) - bound:.4g}"]
        rows.append("| " + " | ".join([name, f"{float(old[name]):.5g}", f"{float(new[name]):.5g}", *condition]) + " |")
    return "\n".join(rows)


def history_figure(names: Sequence[str], rows: Sequence[Sequence[float]]) -> Figure:
    """Cost, gradient norm and gains over the iterations."""
    table = np.array(rows)
    figure = Figure(figsize=(7.5, 7), layout="constrained")
    cost, norm, gain = figure.subplots(3, 1, sharex=True)
    iteration = table[:, 0]
    cost.plot(iteration, table[:, HISTORY.index("cost")], color="0.6", lw=1, label="cost = goal + penalty")
    cost.plot(iteration, table[:, HISTORY.index("goal")], color="tab:blue", lw=1.3, label="goal")
    cost.set(ylabel="relative to start")
    cost.legend(fontsize=8)
    norm.semilogy(iteration, table[:, HISTORY.index("gradient_norm")], color="tab:orange", lw=1)
    norm.set(ylabel="gradient norm")
    values = table[:, len(HISTORY) :]
    for name, column in zip(names, values.T, strict=True):
        gain.semilogy(iteration, column / column[0], lw=1.2, label=name)
    gain.set(ylabel="gain / start", xlabel="iteration")
    gain.legend(fontsize=8, ncols=4)
    for axes in (cost, norm, gain):
        axes.grid(alpha=0.3)
    return figure


def tracking_figure(before: agvjax.Trajectory, after: agvjax.Trajectory, title: str) -> Figure:
    """Path, size of the error and of the commands, before and after."""
    runs = {"starting gains": before, "tuned": after}
    figure = Figure(figsize=(10, 4.6), layout="constrained")
    figure.suptitle(title, fontsize=10)
    parts = figure.subplot_mosaic([["path", "position"], ["path", "heading"]], width_ratios=[1, 1.4])
    plot.draw_path(parts["path"], runs)
    for (label, run), style in zip(runs.items(), plot.STYLES, strict=False):
        error = np.asarray(agvjax.tracking_error(run))
        parts["position"].semilogy(np.asarray(run.t), np.hypot(error[:, 0], error[:, 1]), label=label, **style)
        parts["heading"].plot(np.asarray(run.t), error[:, 2], label=label, **style)
    parts["position"].set(ylabel="position error [m]", ylim=(1e-4, None))
    parts["heading"].set(ylabel=plot.ERRORS[2], xlabel="time [s]")
    for name in ("position", "heading"):
        parts[name].grid(alpha=0.3)
    return figure


def page(
    config: Any,
    names: Sequence[str],
    tuned: Any,
    stability: Mapping[str, float],
    judged: Mapping[str, Mapping[str, Judged]],
    over: Sequence[str],
    progress: Any,
) -> str:
    """`report.md`."""
    before, after = judged["before"], judged["after"]
    settings = config.tune
    met = "All limits are met on the tuning scenarios." if not over else "**Limits not met:** " + "; ".join(over) + "."
    latched = sum(row[HISTORY.index("latched")] > 0 for row in progress.history)
    counts = (
        f"{progress.iteration} iterations of {settings.optimizer}, best at {progress.best_iteration}; {latched} of them"
        f" with diverged runs, {progress.clipped} gradients clipped to norm {settings.clip:g},"
        f" {progress.skipped} iterations skipped because the gradient was not finite."
    )
    validation = comparison(before["validation"], after["validation"])
    tuning = comparison(before["tuning"], after["tuning"])
    return f"""# Tuned gains

{gains(names, config.controller, tuned, stability)}

"Must exceed" are the paper's stability conditions, eqs. (48), (52), (70), for the smallest deadzone slopes that the
ensemble can draw; they hold by construction. The gains are in `gains.toml`: `agvjax simulate --config gains.toml`.

## On {after["validation"].size} validation scenarios, not seen in tuning

{validation}

## On the {after["tuning"].size} tuning scenarios

{tuning}

{met} rmse is sqrt(mean of e_x^2 + e_y^2 + e_psi^2), effort the same of the commands before the deadzone; mean and worst
are over the runs that did not diverge. Judged at steps of {config.simulate.dt:g} s, tuned at {settings.dt:g} s.

## How it went

{counts} Seed {config.seed}, {config.precision}-bit.

![cost and gains](history.png)

![nominal](nominal.png)

![worst](worst.png)
"""
