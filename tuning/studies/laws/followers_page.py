"""What the comparison of laws that follow a route found: table, figure, page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...config import gains_table
from ...config.settings import Config
from ...io import files
from ...io.files import Json
from ...io.pages import grid, picture, publish
from ...io.panels import panels
from ...io.pictures import write_figures
from ...io.statements import of_draws, worst_of
from ...io.statements import said as said_of
from ...tune.tables import gains_of_laws
from .followers import LABELS, Comparison, Tuned

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COMPARED = (
    "RMS distance to the route on unseen vehicles, with each law's own gains (grey) and tuned (blue): median, quartiles"
    " and extremes."
)
SHOWN = ("cross_track_late", "cross_track_peak_late", "pace", "total_chatter")


def shown(config: Config) -> tuple[str, ...]:
    """The metrics of the table; of runs no longer than the start those of the whole run."""
    late = config.simulate.horizon > config.criteria.late
    return SHOWN if late else tuple(name.removesuffix("_late") for name in SHOWN)


def rows(found: Mapping[str, Tuned], names: tuple[str, ...]) -> list[Json]:
    """One row a law, best first by its mean distance; statistics over the runs that did not diverge."""
    made = []
    for name, tuned in found.items():
        row: Json = {"law": name, "gains": len(tuned.gains), "met": tuned.excess == 0}
        row |= {"over": "; ".join(tuned.over), "unseen": int(np.size(tuned.after.ok))}
        row |= {"searches": tuned.searches, "jacobians": tuned.jacobians, "rollouts": tuned.rollouts}
        for label, metrics in (("before", tuned.before), ("after", tuned.after)):
            ok = np.asarray(metrics.ok)
            row[f"diverged_{label}"] = int(np.sum(~ok))
            for metric in names:
                values = np.asarray(metrics[metric])[ok]
                row[f"mean_{metric}_{label}"] = float(np.mean(values)) if ok.any() else np.inf
                row[f"worst_{metric}_{label}"] = float(np.max(values)) if ok.any() else np.inf
        made.append(row)
    return sorted(made, key=lambda row: (not row["met"], row[f"mean_{names[0]}_after"]))


def table(made: list[Json], names: tuple[str, ...]) -> str:
    """The comparison as a table; before and after with a bar between."""
    far, peak, pace, varies = names
    largest = worst_of(made[0]["unseen"])
    header = ["law", "gains", "mean distance [mm]", largest, f"largest instant, {largest}", "pace [s/m]"]
    header += ["variation", "diverged", "rollouts", "Jacobians"]
    lines = []
    for row in made:
        cells: list[object] = [LABELS[row["law"]] + ("" if row["met"] else " (limits not met)"), row["gains"]]
        for key in (f"mean_{far}", f"worst_{far}", f"worst_{peak}"):
            cells.append(" / ".join(f"{1e3 * row[f'{key}_{when}']:.1f}" for when in ("before", "after")))
        for key in (f"mean_{pace}", f"mean_{varies}"):
            cells.append(" / ".join(f"{row[f'{key}_{when}']:.3g}" for when in ("before", "after")))
        cells += [f"{row['diverged_before']} / {row['diverged_after']}", row["rollouts"], row["jacobians"]]
        lines.append(cells)
    return grid(header, lines)


def brief(made: list[Json], names: tuple[str, ...]) -> str:
    """The same for a terminal."""
    lines = [
        [LABELS[row["law"]] + ("" if row["met"] else " (limits not met)")]
        + [f"{1e3 * row[f'{key}_{names[0]}_{when}']:.1f}" for key in ("mean", "worst") for when in ("before", "after")]
        for row in made
    ]
    largest = f"{worst_of(made[0]['unseen'])}, own gains"
    return grid(["distance on unseen vehicles [mm]", "mean, own gains", "tuned", largest, "tuned"], lines)


def statements(made: list[Json], names: tuple[str, ...]) -> list[str]:
    """What follows from the rows, in words."""
    key = f"mean_{names[0]}_after"
    within = [row for row in made if row["met"]]
    if not within:
        return ["No law meets the limits."]
    first = within[0]
    said = [f"Smallest mean distance to the route: {LABELS[first['law']]}, {1e3 * first[key]:.1f} mm."]
    if len(within) > 1:
        others = ", ".join(f"{LABELS[row['law']]} {row[key] / first[key]:.2f}" for row in within[1:])
        said.append(f"The others, relative to it: {others}.")
    if lost := [LABELS[row["law"]] for row in made if not row["met"]]:
        said.append(f"Limits not met by: {', '.join(lost)}.")
    said += [f"{LABELS[row['law']]}, on validation vehicles: {row['over']}." for row in made if row["over"]]
    if worse := [f"{LABELS[row['law']]} {row['diverged_after']}" for row in made if row["diverged_after"]]:
        said.append(f"Diverged runs after tuning: {', '.join(worse)}.")
    return said


def figure(found: Mapping[str, Tuned], made: list[Json], metric: str) -> Figure:
    """Every law's distance on the unseen vehicles, before and after tuning: middle, quartiles and extremes."""
    drawn, ((axes,),) = panels(1, 1, (8.5, 4.2), "both")
    for side, (label, color) in enumerate((("own gains", "0.8"), ("tuned", "#6c8ebf"))):
        values = []
        for row in made:
            metrics = found[row["law"]].after if side else found[row["law"]].before
            values.append(1e3 * np.asarray(metrics[metric])[np.asarray(metrics.ok)])
        style = {"facecolor": color}
        places = np.arange(len(made)) + (0.2 if side else -0.2)
        boxes = axes.boxplot(values, positions=places, widths=0.35, whis=(0, 100), patch_artist=True, boxprops=style)
        boxes["boxes"][0].set_label(label)
        for line in boxes["medians"]:
            line.set_color("k")
    axes.set_xticks(np.arange(len(made)), [LABELS[row["law"]] for row in made], rotation=12, ha="right", fontsize=8)
    axes.set(yscale="log", ylabel="RMS distance to the route of a vehicle [mm]")
    axes.grid(visible=False, axis="x", which="both")
    axes.legend(fontsize=8)
    return drawn


def write(comparison: Comparison, found: Mapping[str, Tuned], out: Path) -> str:
    """Table, figure, gains and page into a folder; returns what is printed."""
    names = shown(comparison.config)
    made = rows(found, names)
    files.write_csv(out / "comparison.csv", made[0], [list(row.values()) for row in made])
    for name, tuned in found.items():
        files.write(out / f"gains-{name}.toml", gains_table(tuned.controller))
    lost = write_figures(out, {"comparison": lambda: figure(found, made, names[0])})
    said = statements(made, names)
    text = _page(comparison, found, table(made, names), said)
    publish(out, text, ("The gains",))
    return "\n".join([brief(made, names), "", *said, *lost])


def _page(comparison: Comparison, found: Mapping[str, Tuned], text: str, said: list[str]) -> str:
    config = comparison.config
    sizes, first = config.ensemble, "\n".join(f"* {line}" for line in said)
    gains = gains_of_laws({LABELS[law]: (tuned.start, tuned.controller, tuned.gains) for law, tuned in found.items()})
    limits = ", ".join(config.tune.limits) or "none"
    return f"""# Which law follows a route best?

{first}

{text}

Own gains / tuned, on {sizes.validation_size} validation vehicles; over the runs that did not diverge. Distances are RMS
over a run after its start-up phase, and the largest. Every law runs in the same computer, on the same base and route,
and was tuned on the same {sizes.size} vehicles for the same goal. Limits ({limits}) and goal are relative to **one**
law, the configured one, with its starting gains. Searches begin at the law's own gains and at the best of
{config.tune.screen} screened gain sets. The paper's law follows a time schedule and catches up when it is late.

{said_of(of_draws(sizes.validation_size))}

{picture("comparison.png", COMPARED)}

## The gains

{gains}

Each law is in `gains-LAW.toml`. Made by `agvjax compare`, seed {config.seed}.
"""
