"""What the comparison of remedies found: table, figure, page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import agvjax
from agvjax.metric_units import units_in

from ...config import gains_table
from ...io import files
from ...io.files import Json
from ...io.pages import grid, publish
from ...io.panels import panels
from ...io.pictures import write_figures
from ...io.statements import of_draws, worst_of
from ...io.statements import said as said_of
from ...tune.gains import value_of
from ...tune.meanings import of_gains
from ..captions import caption, image
from .remedies import LABELS
from .study import Judged, Study
from .words import metric_of, rows, statements

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COMMAND = "agvjax compare --deadzone"


def table(made: list[Json]) -> str:
    """The comparison as a table; own gains and tuned ones with a bar between."""
    largest = worst_of(made[0]["unseen"])
    header = ["remedy", "mean error, 10^-3", largest, "variation delivered", "reversals"]
    header += ["mean error with noise", largest, "reversals", "diverged", "with noise", "gains", "budget used"]
    lines = []
    for row in made:
        cells: list[object] = [LABELS[row["remedy"]] + ("" if row["met"] else " (budget not met)")]
        for key, noise, factor in (
            ("mean", "", 1e3),
            ("worst", "", 1e3),
            ("variation", "", 1),
            ("reversals", "", 1),
            ("mean", "_noise", 1e3),
            ("worst", "_noise", 1e3),
            ("reversals", "_noise", 1),
            ("diverged", "", 1),
            ("diverged", "_noise", 1),
        ):
            cells.append(" / ".join(f"{factor * row[f'{key}_{when}{noise}']:.4g}" for when in ("before", "after")))
        lines.append([*cells, row["gains"], f"{row['use']:.2f}"])
    return grid(header, lines)


def brief(made: list[Json], metric: str, unit: str) -> str:
    """The same for a terminal, of tuned gains."""
    lines = [
        [LABELS[row["remedy"]] + ("" if row["met"] else " (budget not met)")]
        + [f"{1e3 * row[f'{key}_after{noise}']:.4g}" for noise in ("", "_noise") for key in ("mean", "worst")]
        for row in made
    ]
    largest = worst_of(made[0]["unseen"])
    return grid([f"{metric} [10^-3 {unit}]", "mean", largest, "with noise, mean", largest], lines)


def figure(made: list[Json], metric: str, unit: str) -> Figure:
    """Mean error of every remedy, own gains and tuned, and tuned with noise; lines reach to the largest."""
    drawn, ((axes,),) = panels(1, 1, (9.0, 4.6), "both")
    kinds = (("own gains", "before", "", "o", "w"), ("tuned", "after", "", "o", "k"))
    kinds += (("tuned, with noise", "after", "_noise", "D", "0.6"),)
    for i, (label, when, noise, marker, color) in enumerate(kinds):
        mean, worst = (np.array([1e3 * row[f"{key}_{when}{noise}"] for row in made]) for key in ("mean", "worst"))
        shown = np.isfinite(mean) & (mean > 0)
        places, heights = np.arange(len(made))[shown] + 0.2 * (i - 1), mean[shown]
        axes.vlines(places, heights, worst[shown], color="k", linewidth=0.8)
        axes.plot(places, worst[shown], "_", color="k", ms=6)
        axes.plot(places, heights, marker, color=color, mec="k", ms=6, label=label)
    axes.set_xticks(np.arange(len(made)), [LABELS[row["remedy"]] for row in made], rotation=25, ha="right", fontsize=8)
    axes.set(yscale="log", ylabel=f"{metric} [10^-3 {unit}]: mean, and {worst_of(made[0]['unseen'])}")
    axes.grid(visible=False, axis="x", which="both")
    axes.legend(fontsize=8)
    return drawn


def write(study: Study, judged: Mapping[str, Judged], wrong: Mapping[str, agvjax.Metrics], out: Path) -> str:
    """Table, figure, gains and page into a folder; returns what is printed."""
    metric = metric_of(study.config)
    unit = units_in(study.config.scenario)[metric]
    made = rows(judged, metric)
    said = statements(made, judged, wrong, metric)
    files.write_csv(out / "remedies.csv", made[0], [list(row.values()) for row in made])
    mistaken = {name: np.asarray(metrics[metric]).tolist() for name, metrics in wrong.items()}
    each = {name: np.asarray(one.after[0][metric]).tolist() for name, one in judged.items()}
    left = study.remedies.left_out
    found = {"metric": metric, "rows": made, "conclusion": said, "left_out": left}
    files.write_json(out / "remedies.json", found | {"each_vehicle": each, "mistaken_after_tuning": mistaken})
    for name, one in judged.items():
        files.write(out / f"gains-{name}.toml", gains_table(one.controller))
    drawing = {"remedies": lambda: caption("remedies", figure(made, metric, unit), COMMAND)}
    lost = write_figures(out, drawing)
    text = _page(study, judged, made, said)
    publish(out, text, ("The budget", "The gains"))
    return "\n".join([brief(made, metric, unit), "", *said, *lost])


# long: one template
def _page(study: Study, judged: Mapping[str, Judged], made: list[Json], said: list[str]) -> str:
    config, metric = study.config, metric_of(study.config)
    unit = units_in(config.scenario)[metric]
    sizes, sensor = config.ensemble, study.sensor(True)
    limits = grid(
        ["limit", "mean", worst_of(sizes.size), "mean of the largest tenth"],
        [[name, limit.mean, limit.worst, limit.cvar] for name, limit in config.tune.limits.items()],
    )
    gains = grid(
        ["remedy", "gain", "own", "tuned", "meaning"],
        [
            [LABELS[name], gain, value_of(one.remedy.law, gain), value_of(one.controller, gain), meaning]
            for name, one in judged.items()
            for gain, meaning in of_gains(one.remedy.law, one.gains).items()
        ],
    )
    left = "\n".join(f"* {LABELS[name]}: {why}." for name, why in study.remedies.left_out.items()) or "* none"
    over = "\n".join(f"* {LABELS[row['remedy']]}: {row['over']}." for row in made if row["over"]) or "* none"
    b1 = study.remedies.mattering_b1
    when = "with that noise" if study.tuned_with_noise else "without noise"
    matters = "" if b1 is None else _matters(b1)
    return f"""# Which remedy against the deadzone is best?

{" ".join(said)}

{table(made)}

Own gains / tuned, {metric} [10^-3 {unit}], on {sizes.validation_size} validation vehicles; over the
runs that did not diverge. "Budget used" is the largest share of a limit there. Every remedy was tuned by the same tuner
on the same {sizes.size} vehicles, {when}, for the same goal and within the same limits; searches begin at the remedy's
own gains and at the best of {config.tune.screen} screened gain sets. Noise: {sensor}.

{said_of(of_draws(sizes.validation_size))}

{image("remedies")}

## What they are
{matters}
"Nothing" is the configured law without a network. "Each vehicle's own deadzone": the vehicle's true slopes and
thresholds, as an identification without error would give them. "Thresholds assumed 1.5 (0.5) times": the true slopes,
with 1.5 (0.5) times the true thresholds; a wrong slope is only a wrong loop gain, which tuning would correct. `width`
and `quiet` of these inverses are tuned with the law's gains; `slope` and `threshold` only for the one inverse for all.
The adaptive inverse runs in a computer; if the law is in continuous time, its period, {study.period:g} s, is part of
the comparison. The observer is another law, with its own gains.

Left out:

{left}

## The budget

{limits}

Limits are multiples of the values of the configured law with its starting gains and without a remedy. Commands are
measured behind the deadzone, at the actuator outputs: what an inverse sends is not what its law asks for. Limits
exceeded on the validation vehicles:

{over}

## The gains

{gains}

Each law is in `gains-REMEDY.toml`. Made by `{COMMAND}`, seed {config.seed}. agvjax {agvjax.__version__}.
"""


def _matters(b1: float) -> str:
    return (
        f"\nThe network matters at b1 = {b1:g} and below, where somewhere on the nominal run it adds more than k2 to"
        " the gain of (41) (of the values that `agvjax reproduce` tries).\n"
    )
