"""Which law is better? Every law tuned by the same tuner, on the same scenarios, to the same command budget."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from matplotlib.figure import Figure

import agvjax
from agvjax.leaves import get

from . import runs
from .ensemble import sample
from .free import Free, default_bounds, stability_bounds, tunable
from .markdown import grid, html
from .objective import METRICS, within
from .optimise import SEQUENTIAL, Tuner
from .paper.cases import LABELS, WORKERS, matched, problems
from .paper.figures import caption
from .paper.page import image
from .problem import requirements
from .settings import Config, steps_of

__all__ = ["Comparison", "Tuned", "compare", "laws", "problems", "rows", "write"]
BUDGET = tuple(f"{kind}_{channel}" for kind in ("effort", "peak", "chatter") for channel in ("x", "y", "heading"))
STARTS = (10.0, 20.0)  # 1/s, bandwidths to start from besides the law's own gains


class Tuned(NamedTuple):
    """One law: its gains before and after, and what each is worth on unseen scenarios."""

    start: Any
    controller: Any
    cost: float  # on the tuning scenarios
    excess: float  # of the budget there, as a ratio; 0 if it is kept
    looks: int  # Jacobians taken, over all starts
    refused: int  # of them, those of no use
    left_out: int  # starts outside the bounds of the tuning step or the stability conditions
    metrics: agvjax.Metrics  # of the tuned law on the validation scenarios
    metrics_before: agvjax.Metrics


def laws(proposed: Any) -> dict[str, Any]:
    """The laws that are tuned, with their own gains, those that take longest first."""
    return {
        "fractional": agvjax.FractionalBackstepping(inner=proposed),
        "proposed": proposed,
        "osfc": agvjax.OSFC(),
        "asmc": agvjax.ASMC(),
        "dfc": agvjax.DFC(),
        "ftsmc": agvjax.FTSMC(),
        "super_twisting": agvjax.SuperTwistingFTSMC(),
    }


def starts(name: str, law: Any) -> list[Any]:
    """Where the tuner starts from: the law's own gains, and those of some bandwidths where that is defined."""
    try:
        return [law, *(matched(name, p, law) for p in STARTS)]
    except KeyError:
        return [law]


class Comparison:
    """The tuning and validation scenarios and the budget: what the proposed law needs with the configured gains."""

    def __init__(self, config: Config):
        draws, sizes = config.ensemble.draws, config.ensemble
        self.config, self.method = config, agvjax.INTEGRATORS[config.tune.integrator]
        self.seen = sample(config.scenario, draws, sizes.size, config.seed)
        self.unseen = sample(config.scenario, draws, sizes.validation_size, config.seed + 1)
        limits = within(dict.fromkeys(BUDGET, 1.0))
        self.objective = requirements(config.tune)._replace(limits=limits, penalty=10.0)

    def steps(self, dt: float) -> dict[str, Any]:
        """Timing of a rollout at this step."""
        return {"dt": dt, "n_steps": steps_of(self.config.simulate.horizon, dt), "integrator": self.method}

    @functools.cached_property
    def budget(self) -> np.ndarray:
        """(3, M): statistics of the goals and of each command metric, of the configured law on the tuning set."""
        law = agvjax.check(self.config.controller)
        values, ok = self.objective.values(
            agvjax.evaluate(law, self.seen, criteria=self.objective.criteria, **self.steps(self.config.tune.dt))
        )
        return self.objective.reference(values, ok)

    def of(self, metric: str) -> list[float]:
        """Mean and worst that the budget allows of a command metric."""
        return self.budget[:2, self.objective.names.index(metric)].tolist()

    def judge(self, law: Any) -> agvjax.Metrics:
        """Metrics on the validation scenarios."""
        found = agvjax.evaluate(
            agvjax.check(law), self.unseen, criteria=self.objective.criteria, **self.steps(self.config.simulate.dt)
        )
        return jax.tree.map(np.asarray, found)

    def tune(self, name: str, law: Any) -> Tuned:
        """The best of all starts: the budget kept first, then the cost."""
        names, dt = tunable(law), self.config.tune.dt
        conditions = stability_bounds(law, self.config.scenario, self.config.ensemble.draws)
        limits = default_bounds(law, names, conditions, dt, self.method)
        free = Free(names, np.array([limits[n][0] for n in names]), np.array([limits[n][1] for n in names]))
        tuner = Tuner(
            controller=agvjax.check(law),
            batch=self.seen,
            free=free,
            objective=self.objective,
            budget=self.budget,
            optimizer=SEQUENTIAL,
            iterations=60,
            **self.steps(dt),
        )
        best, looks, refused, left_out = None, 0, 0, 0
        for start in starts(name, law):
            if free.problems(start):
                left_out += 1
                continue
            progress = tuner.begin(free.coordinates(start))
            while not tuner.finished(progress):
                progress = tuner.advance(progress)
            looks, refused = looks + progress.iteration, refused + progress.backed_out
            best = progress if best is None or progress.best < best.best else best
        if best is None:
            raise ValueError(f"no start of {name} lies inside its bounds")
        found = tuner.best(best)
        before, after = self.judge(law), self.judge(found)
        return Tuned(law, found, best.best[1], best.best[0], looks, refused, left_out, after, before)


def compare(config: Config, done: Callable[[str], None]) -> tuple[Comparison, dict[str, Tuned]]:
    """Tune and judge every law, two at a time; `done(name)` is called as each is ready."""
    comparison = Comparison(config)
    _ = comparison.budget

    def one(item: tuple[str, Any]) -> tuple[str, Tuned]:
        found = comparison.tune(*item)
        done(item[0])
        return item[0], found

    with ThreadPoolExecutor(WORKERS) as pool:
        found = dict(pool.map(one, laws(config.controller).items()))
    proposed = found["proposed"]
    held = agvjax.EventTriggered(inner=proposed.controller)  # tuned through its continuous law, judged held
    before = comparison.judge(agvjax.EventTriggered(inner=config.controller))
    found["event"] = proposed._replace(
        start=agvjax.EventTriggered(inner=config.controller),
        controller=held,
        metrics=comparison.judge(held),
        metrics_before=before,
        looks=0,
        refused=0,
        left_out=0,
    )
    done("event")
    return comparison, found


def rows(comparison: Comparison, found: Mapping[str, Tuned]) -> list[dict[str, Any]]:
    """One row a law, best first: error on unseen scenarios and the share of the budget that it uses there."""
    made = []
    for name, tuned in found.items():
        row: dict[str, Any] = {"law": name, "tuned": bool(tuned.excess == 0), "jacobians": tuned.looks}
        row |= {"refused": tuned.refused, "starts_left_out": tuned.left_out}
        for label, metrics in (("before", tuned.metrics_before), ("after", tuned.metrics)):
            ok = np.asarray(metrics.ok)
            rmse = np.asarray(METRICS["rmse"](metrics))[ok]
            row |= {f"mean_{label}": rmse.mean(), f"worst_{label}": rmse.max(), f"diverged_{label}": int((~ok).sum())}
        objective = comparison.objective
        use = np.asarray(objective.levels(*objective.values(tuned.metrics), comparison.budget))[len(objective.goals) :]
        use = use.reshape(2, len(BUDGET))  # mean, worst
        row |= {"use_mean": use[0].max(), "use_worst": use[1].max()}
        row |= {"most_used": BUDGET[int(np.argmax(use[0]))]}
        row |= {
            f"rmse_{c}": v
            for c, v in zip("xyp", np.asarray(tuned.metrics.rmse)[np.asarray(tuned.metrics.ok)].mean(0), strict=True)
        }
        made.append({k: float(v) if isinstance(v, np.floating) else v for k, v in row.items()})
    return sorted(made, key=lambda row: row["mean_after"])


def markdown(made: list[dict[str, Any]]) -> str:
    """The comparison as a table."""
    base = next(row for row in made if row["law"] == "proposed")
    lines = [
        "| law | mean RMSE | of proposed | worst | of proposed | x | y | psi | before tuning | budget used, mean |"
        " worst | Jacobians | refused | starts left out |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in made:
        cells = [LABELS[row["law"]] + ("" if row["tuned"] else " (budget not met)"), f"{row['mean_after']:.4f}"]
        cells += [f"**{row['mean_after'] / base['mean_after']:.3f}**", f"{row['worst_after']:.4f}"]
        cells += [f"**{row['worst_after'] / base['worst_after']:.3f}**"]
        cells += [f"{row[f'rmse_{c}']:.4f}" for c in "xyp"]
        cells += [f"{row['mean_before']:.4f}", f"{row['use_mean']:.2f} ({row['most_used']})", f"{row['use_worst']:.2f}"]
        lines.append(
            "| " + " | ".join([*cells, *(str(row[k]) for k in ("jacobians", "refused", "starts_left_out"))]) + " |"
        )
    return "\n".join(lines)


def statements(made: list[dict[str, Any]]) -> list[str]:
    """What follows from the rows, in words; nothing is said that is not computed."""
    base = next(row for row in made if row["law"] == "proposed")
    better = [LABELS[r["law"]] for r in made if r["mean_after"] < 0.99 * base["mean_after"]]
    worse = [LABELS[r["law"]] for r in made if r["mean_after"] > 1.01 * base["mean_after"]]
    alike = [LABELS[r["law"]] for r in made if LABELS[r["law"]] not in (*better, *worse, "Proposed")]
    said = []
    for names, words in (
        (better, "these track better"),
        (worse, "these track worse"),
        (alike, "these track alike, within 1 %,"),
    ):
        if names:
            said.append(
                f"Beside the proposed law at the same command budget, {words} in mean RMSE: {', '.join(names)}."
            )
    diverged = [f"{LABELS[r['law']]} {r['diverged_after']}" for r in made if r["diverged_after"]]
    said.append(f"Diverged runs after tuning: {', '.join(diverged) if diverged else 'none'}.")
    return said


def figure(found: Mapping[str, Tuned], made: list[dict[str, Any]]) -> Figure:
    """Every law's error on the unseen scenarios, before and after tuning: middle, quartiles and extremes."""
    drawn = Figure(figsize=(8.5, 4.2), layout="constrained")
    axes = drawn.add_subplot()
    for side, (label, color, hatch) in enumerate((("own gains", "0.8", ""), ("tuned", "#6c8ebf", "//"))):
        values = []
        for row in made:
            metrics = found[row["law"]].metrics if side else found[row["law"]].metrics_before
            values.append(np.asarray(METRICS["rmse"](metrics))[np.asarray(metrics.ok)])
        places = np.arange(len(made)) + (0.2 if side else -0.2)
        style = {"facecolor": color, "hatch": hatch}
        boxes = axes.boxplot(values, positions=places, widths=0.35, whis=(0, 100), patch_artist=True, boxprops=style)
        boxes["boxes"][0].set_label(label)
        for line in boxes["medians"]:
            line.set_color("k")
    axes.set_xticks(np.arange(len(made)), [LABELS[row["law"]] for row in made], rotation=20, ha="right", fontsize=8)
    axes.set(yscale="log", ylabel="RMSE of a scenario [m, m, rad]")
    axes.grid(alpha=0.3, axis="y", which="both")
    axes.legend(fontsize=8)
    return drawn


def write(comparison: Comparison, found: Mapping[str, Tuned], out: Path) -> str:
    """Table, figure, gains and pages into a folder; returns the table."""
    made = rows(comparison, found)
    table = markdown(made)
    drawn = caption("comparison", figure(found, made), "agvjax compare")
    runs.write_figure(out / "comparison.png", drawn)
    runs.write_csv(out / "comparison.csv", made[0], [list(row.values()) for row in made])
    budget = {name: comparison.of(name) for name in BUDGET}
    gains = {
        n: {k: float(v) for k, v in agvjax.leaves(t.controller).items() if np.ndim(v) == 0} for n, t in found.items()
    }
    runs.write_json(out / "comparison.json", {"rows": made, "budget_mean_worst": budget, "gains": gains})
    text = _page(comparison, found, table, made)
    runs.write(out / "report.md", text)
    runs.write(out / "report.html", html(text, out, "Which law is better?"))
    return "\n".join([table, "", *statements(made)])


def _page(comparison: Comparison, found: Mapping[str, Tuned], table: str, made: list[dict[str, Any]]) -> str:
    sizes = comparison.config.ensemble
    limits = grid(
        ["command", "mean", "worst"],
        [[name, *comparison.of(name)] for name in BUDGET],
    )
    gains = grid(
        ["law", "gain", "own", "tuned"],
        [
            [LABELS[name], gain, float(get(tuned.start, gain)), float(get(tuned.controller, gain))]
            for name, tuned in found.items()
            for gain in tunable(tuned.controller)
        ],
    )
    said = "\n".join(f"* {line}" for line in statements(made))
    return f"""# Which law is better at the same command budget?

Every law was tuned by the same tuner (sequential quadratic programming on the exact Jacobian) on the same {sizes.size}
scenarios, to the lowest mean and worst error within one budget: for each channel RMS, peak and chatter of the command,
mean and worst, no more than the proposed law needs there with its printed gains. The table is on
{sizes.validation_size} scenarios that no law has seen. Event-triggered: tuned through its continuous law, judged held.

{said}

{table}

"Budget used" is the largest of the nine commands' shares of the budget on the unseen scenarios. "Refused" are Jacobians
whose slopes are the sensitivity of a chattering run; "left out" are starts that the tuning step or the stability
conditions forbid.

{image("comparison")}

## The budget

{limits}

## The gains

{gains}

Made by `agvjax compare`, seed {comparison.config.seed}.
"""
