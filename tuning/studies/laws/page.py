"""What the comparison of laws found: table, figure, page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import agvjax
from agvjax.leaves import spread

from ...io import files
from ...io.files import Json
from ...io.pages import grid, publish
from ...io.panels import panels
from ...io.pictures import write_figures
from ...io.statements import of_draws, worst_of
from ...io.statements import said as said_of
from ...tune.tables import gains_of_laws
from ..captions import caption, image
from ..paper.cases import LABELS
from .study import BUDGET, Comparison, Tuned

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def rows(comparison: Comparison, found: Mapping[str, Tuned]) -> list[Json]:
    """One row a law, best first: error on unseen scenarios and the share of the budget that it uses there."""
    made = []
    for name, tuned in found.items():
        row: Json = {"law": name, "tuned": bool(tuned.excess == 0), "unseen": int(np.size(tuned.metrics.ok))}
        row["jacobians"] = tuned.looks
        row |= {"refused": tuned.refused, "starts_left_out": tuned.left_out}
        for label, metrics in (("before", tuned.metrics_before), ("after", tuned.metrics)):
            ok = np.asarray(metrics.ok)
            rmse = np.asarray(metrics.total_rmse)[ok]
            row |= {f"mean_{label}": rmse.mean(), f"worst_{label}": rmse.max(), f"diverged_{label}": int((~ok).sum())}
        objective = comparison.objective
        use = objective.levels_of(tuned.metrics, comparison.budget)[len(objective.goals) :]
        use = use.reshape(2, len(BUDGET))  # mean, worst
        row |= {"use_mean": use[0].max(), "use_worst": use[1].max()}
        row |= {"most_used": BUDGET[int(np.argmax(use[0]))]}
        row |= {
            f"rmse_{c}": v
            for c, v in zip("xyp", np.asarray(tuned.metrics.rmse)[np.asarray(tuned.metrics.ok)].mean(0), strict=True)
        }
        made.append({k: float(v) if isinstance(v, np.floating) else v for k, v in row.items()})
    return sorted(made, key=lambda row: row["mean_after"])


def markdown(made: list[Json]) -> str:
    """The comparison as a table."""
    base = next(row for row in made if row["law"] == "proposed")
    largest = worst_of(base["unseen"])
    header = ["law", "mean RMSE", "of proposed", largest, "of proposed", "x", "y", "psi", "before tuning"]
    lines = []
    for row in made:
        cells = [LABELS[row["law"]] + ("" if row["tuned"] else " (budget not met)")]
        for error in ("mean_after", "worst_after"):
            cells += [f"{row[error]:.4f}", f"**{row[error] / base[error]:.3f}**"]
        cells += [f"{row[name]:.4f}" for name in ("rmse_x", "rmse_y", "rmse_p", "mean_before")]
        cells += [f"{row['use_mean']:.2f} ({row['most_used']})", f"{row['use_worst']:.2f}"]
        lines.append([*cells, row["jacobians"], row["refused"], row["starts_left_out"]])
    return grid([*header, "budget used, mean", largest, "Jacobians", "refused", "starts left out"], lines)


def brief(made: list[Json]) -> str:
    """The same for a terminal."""
    base = next(row for row in made if row["law"] == "proposed")
    lines = [
        [LABELS[row["law"]] + ("" if row["tuned"] else " (budget not met)")]
        + [f"{row[error] / base[error]:.3f}" for error in ("mean_after", "worst_after")]
        + [f"{row['use_mean']:.2f}"]
        for row in made
    ]
    return grid(
        ["RMSE on unseen scenarios, of the proposed law's", "mean", worst_of(base["unseen"]), "budget used"], lines
    )


def statements(made: list[Json]) -> list[str]:
    """What follows from the rows, in words; nothing is said that is not computed."""
    base = next(row for row in made if row["law"] == "proposed")
    better = [LABELS[r["law"]] for r in made if r["mean_after"] < 0.99 * base["mean_after"]]
    worse = [LABELS[r["law"]] for r in made if r["mean_after"] > 1.01 * base["mean_after"]]
    alike = [LABELS[r["law"]] for r in made if LABELS[r["law"]] not in (*better, *worse, "Proposed")]
    sentences = [
        f"Compared with the proposed law at the same command budget, {words} mean RMSE: {', '.join(names)}."
        for names, words in ((better, "smaller"), (worse, "larger"), (alike, "similar (within 1 %)"))
        if names
    ]
    used = sorted(row["use_mean"] for row in made)
    sentences.append(
        "The budget holds on the tuning scenarios. On the unseen ones the laws use"
        f" {used[0]:.2f} to {used[-1]:.2f} times its mean, the proposed law {base['use_mean']:.2f}:"
        " an advantage smaller than a law's extra use of the budget may come from that alone."
    )
    diverged = [f"{LABELS[r['law']]} {r['diverged_after']}" for r in made if r["diverged_after"]]
    return [*sentences, f"Diverged runs after tuning: {', '.join(diverged) if diverged else 'none'}."]


def figure(found: Mapping[str, Tuned], made: list[Json]) -> Figure:
    """Every law's error on the unseen scenarios, before and after tuning: middle, quartiles and extremes."""
    drawn, ((axes,),) = panels(1, 1, (8.5, 4.2), "both")
    for side, (label, color, hatch) in enumerate((("own gains", "0.8", ""), ("tuned", "#6c8ebf", "//"))):
        values = []
        for row in made:
            metrics = found[row["law"]].metrics if side else found[row["law"]].metrics_before
            values.append(np.asarray(metrics.total_rmse)[np.asarray(metrics.ok)])
        places = np.arange(len(made)) + (0.2 if side else -0.2)
        style = {"facecolor": color, "hatch": hatch}
        boxes = axes.boxplot(values, positions=places, widths=0.35, whis=(0, 100), patch_artist=True, boxprops=style)
        boxes["boxes"][0].set_label(label)
        for line in boxes["medians"]:
            line.set_color("k")
    axes.set_xticks(np.arange(len(made)), [LABELS[row["law"]] for row in made], rotation=20, ha="right", fontsize=8)
    axes.set(yscale="log", ylabel="RMSE of a scenario [m, m, rad]")
    axes.grid(visible=False, axis="x", which="both")
    axes.legend(fontsize=8)
    return drawn


def write(comparison: Comparison, found: Mapping[str, Tuned], out: Path) -> str:
    """Table, figure, gains and pages into a folder; returns what is printed."""
    made = rows(comparison, found)
    table = markdown(made)
    files.write_csv(out / "comparison.csv", made[0], [list(row.values()) for row in made])
    budget = {name: comparison.of(name) for name in BUDGET}
    gains = {
        n: {k: float(v) for k, v in agvjax.leaves(t.controller).items() if np.ndim(v) == 0} for n, t in found.items()
    }
    files.write_json(out / "comparison.json", {"rows": made, "budget_mean_worst": budget, "gains": gains})
    drawing = {"comparison": lambda: caption("comparison", figure(found, made), "agvjax compare")}
    lost = write_figures(out, drawing)
    text = _page(comparison, found, table, made)
    publish(out, text, ("The budget", "The gains"))
    return "\n".join([brief(made), "", *statements(made), *lost])


# long: one template
def _page(comparison: Comparison, found: Mapping[str, Tuned], table: str, made: list[Json]) -> str:
    sizes = comparison.config.ensemble
    limits = grid(
        ["command", "mean", worst_of(sizes.size)],
        [[name, *comparison.of(name)] for name in BUDGET],
    )
    names = {law: spread(tuned.start, tuned.controller.gains_to_tune()) for law, tuned in found.items()}
    gains = gains_of_laws({LABELS[law]: (tuned.start, tuned.controller, names[law]) for law, tuned in found.items()})
    said = "\n".join(f"* {line}" for line in statements(made))
    return f"""# Which law is better at the same command budget?

Every law was tuned by the same tuner (sequential quadratic programming on the exact Jacobian) on the same {sizes.size}
scenarios, for the lowest mean and largest error within one budget: for each channel RMS, peak and chatter of the
command, mean and largest, no more than the proposed law needs there with its printed gains. Searches begin at the law's
own gains, at those for two bandwidths where defined, and at the best of 512 screened gain sets. The table is for
{sizes.validation_size} scenarios not used for tuning. The event-triggered law was tuned without its trigger and is
evaluated with it.

{said}

{table}

{said_of(of_draws(sizes.validation_size))}

These figures differ from those of `agvjax tune`, which has three limits, not nine, and can therefore trade the command
of one channel for that of another. "Budget used" is the largest of the nine shares of the budget used on the unseen
scenarios. "Refused" are Jacobians rejected because their slopes are those of a chattering run; "left out" are starts
that the tuning step or the stability conditions do not allow.

{image("comparison")}

## The budget

{limits}

## The gains

{gains}

Made by `agvjax compare`, seed {comparison.config.seed}.
"""
