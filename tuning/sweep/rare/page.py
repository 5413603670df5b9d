"""The report of a search for rare failures, in Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from pathlib import Path
from typing import NamedTuple

import numpy as np

from agvjax.metric_units import units_in

from ...io import files, statements
from ...io.pages import grid, meanings, picture, publish
from ...io.pictures import write_figures
from ...tune.meanings import of_metrics
from .. import points
from . import figures
from .estimate import OF_PLAIN, OF_WEIGHTED, Estimate
from .prepare import Prepared
from .study import Outcome, Study

HOW = "How this was computed"
CAPTIONS = {
    "importance": (
        "Which numbers matter: the squared direction cosines of the most likely failures, the shares of the squared"
        " distance from the middle of the ensemble that each number makes up"
    ),
    "failures": (
        "The draws of the estimate over the two numbers that matter most, as normal numbers; more of them are drawn"
        " where vehicles fail than the ensemble has there"
    ),
}


class Told(NamedTuple):
    """What a command says in the end."""

    text: str  # in Markdown
    failure: str  # why nothing can be stated; empty: it can


def write(asked: Study, outcome: Outcome, folder: Path) -> Told:
    """Findings, figures, report, and the most likely failures to be simulated again; what a terminal is told."""
    points.write(folder, [point.leaves for point in outcome.points])
    files.write_json(folder / "rare.json", as_json(asked, outcome))
    drawings = figures.every(asked, outcome)
    lost = write_figures(folder, drawings)
    pictures = [picture(f"{name}.png", f"{CAPTIONS[name]}.") for name in drawings]
    publish(folder, page(asked, outcome, pictures, str(folder)), (HOW,))
    brief = [*verdict(outcome), _again(outcome, str(folder)), *lost]
    refused = outcome.estimate.refused if outcome.estimate.failures else ()
    return Told("\n\n".join(filter(None, brief)), "; ".join(refused))


def page(asked: Study, outcome: Outcome, pictures: Sequence[str], folder: str) -> str:
    """The whole report."""
    blocks = ["# How likely is a failure?", _what(asked, outcome), *verdict(outcome)]
    blocks += [statements.said(statements.of_kind(statements.PROBABLE)), *pictures[:1]]
    if outcome.points:
        blocks += ["## The most likely failures", *_points(asked, outcome), _again(outcome, folder), *pictures[1:]]
    means = meanings(of_metrics(tuple(asked.bounds), asked.config.criteria))
    return "\n\n".join([*filter(None, blocks), f"## {HOW}", _how(asked, outcome), means]).rstrip() + "\n"


def _what(asked: Study, outcome: Outcome) -> str:
    names = ", ".join(axis.name for axis in asked.plan.sampled)
    return (
        f"{outcome.rollouts} rollouts, seed {asked.config.seed}, step {asked.config.sweep.dt:g} s. Drawn at random:"
        f" {names}. {_failure(asked)}"
    )


def verdict(outcome: Outcome) -> list[str]:
    """What may be said, with what it rests on; or why it is not said."""
    made, level = outcome.estimate, statements.PERCENT
    plain = f"{made.plain_failures} of {made.plain_runs} plain draws failed"
    if not made.failures:
        return [
            f"No failure was found by the searches, nor in {made.runs} draws. **With probability at most"
            f" {_up(made.plain_high)} ({level}), a vehicle drawn from this ensemble fails**: {plain}. A smaller"
            " probability cannot be stated from so many rollouts."
        ]
    if made.refused:
        return [
            f"**No estimate is stated**: {'; '.join(made.refused)}. By plain draws alone: with probability at most"
            f" {_up(made.plain_high)} ({level}), a vehicle drawn from this ensemble fails ({plain}). More rollouts may"
            " make an estimate sound: --set sweep.rollouts=N."
        ]
    where = "" if made.everywhere else ", if all failures lie in the explored region"
    said = (
        f"**With probability at most {_up(made.high)} ({level}), a vehicle drawn from this ensemble fails{where}**;"
        f" estimate {made.probability:.3g}, at least {_down(made.low)} ({level}); effective sample size"
        f" {made.effective:.0f} of {made.runs} rollouts."
    )
    if made.everywhere:
        return [said, "This holds wherever the failures lie."]
    return [
        said,
        "The explored region: where gradients, subset simulation and trial draws found failures, and around. Without"
        " the assumption that all failures lie there no more can be claimed than a"
        f" probability of at most {_up(made.plain_high)} ({level}): {plain}; rarer failures that nothing leads to"
        " cannot be excluded.",
    ]


def _up(bound: float) -> str:
    """An upper bound in three digits, rounded up: what is written must hold too."""
    return f"{float(Context(3, ROUND_CEILING).create_decimal_from_float(bound)):.3g}"


def _down(bound: float) -> str:
    """A lower bound, rounded down."""
    return f"{float(Context(3, ROUND_FLOOR).create_decimal_from_float(bound)):.3g}"


def _points(asked: Study, outcome: Outcome) -> list[str]:
    """The most likely failures: how far out they lie, and the numbers of each."""
    units = units_in(asked.config.scenario)
    header = ["index", "distance", "share of the failures", *(f"{name} [{units[name]}]" for name in asked.bounds)]
    rows = [
        [i, point.distance, f"{point.share:.1%}", *(point.metrics[name] for name in asked.bounds)]
        for i, point in enumerate(outcome.points)
    ]
    said = (
        "Distance: from the middle of the ensemble, in standard deviations of the normal numbers behind the draws"
        " (the reliability index). Share: of the estimated probability, of the failures about this one."
    )
    listed = {name: asked.plan.unit(name) for name in asked.plan.names}
    numbers = [
        [
            f"{name} [{unit}]",
            _shown(asked.plan.nominal(name)),
            *(_shown(point.leaves[name]) for point in outcome.points),
        ]
        for name, unit in listed.items()
    ]
    head = ["number", "nominal", *(f"index {i}" for i in range(len(outcome.points)))]
    first = outcome.points[0].importance
    ways = sorted(zip(first, asked.plan.sampled, strict=True), key=lambda pair: -pair[0])
    matter = ", ".join(f"{axis.name} {share:.0%}" for share, axis in ways[:4] if share >= 0.01)
    return [grid(header, rows), said, f"What matters to index 0: {matter}.", grid(head, numbers)]


def _again(outcome: Outcome, folder: str) -> str:
    if not outcome.points:
        return ""
    return f"The most likely failure: `agvjax simulate --from {folder} --index 0`."


def _failure(asked: Study) -> str:
    units = units_in(asked.config.scenario)
    rule = ", or if ".join(f"{name} exceeds {bound:.5g} {units[name]}" for name, bound in asked.bounds.items())
    return f"A run fails if it diverges{f', or if {rule}' if rule else ''}."


def _how(asked: Study, outcome: Outcome) -> str:
    before, made = outcome.prepared, outcome.estimate
    pilot = f"estimates {before.pilot:.2g}" if before.pilot else "met no failure"
    region = (
        "all there is" if before.everywhere else f"where a draw weighs at most {before.cut:.2g}{edge(before, made)}"
    )
    lines = [
        f"Subset simulation {pilot}; searches by gradient and trial draws followed. In all {before.spent} rollouts,"
        " a gradient counted as 1 + its tangents.",
        f"{made.runs} draws of a mixture: half of them of the ensemble itself, a tenth of a wider one, the rest normal"
        f" about {len(before.mixture.points)} points that fail. {made.failures} failed. Each is weighted by how much"
        " more likely the ensemble draws it than the mixture does.",
        f"The region explored: {region}. Draws that failed outside it: {made.outside}.",
        "Bounds hold for this number of draws, whatever the distribution: for weighted draws by betting (Waudby-Smith"
        " and Ramdas 2024), for plain draws exact (Clopper and Pearson 1934). Each is one-sided. Draws decide which"
        f" upper bound is stated, so that the weighted one is made with {100 * OF_WEIGHTED:g} % and the plain one"
        f" with {100 * OF_PLAIN:g} %: both hold at once with {statements.PERCENT}.",
        f"Draws further out than 1e-10 in one number are not simulated; they count as failing in upper bounds"
        f" ({asked.problem.tail:.1g}).",
    ]
    return "\n".join(f"* {line}" for line in lines)


def edge(prepared: Prepared, made: Estimate) -> str:
    """How far one more failure at the edge of the region moves an estimate; empty where that is 0."""
    total = made.probability * made.runs
    return f"; one more failure at its edge would move the estimate by {prepared.cut / total:.1%}" if total else ""


def _shown(value: np.ndarray) -> str:
    return ", ".join(f"{x:.4g}" for x in np.ravel(value))


def as_json(asked: Study, outcome: Outcome) -> dict[str, object]:
    """`rare.json`."""
    prepared = {name: x for name, x in outcome.prepared._asdict().items() if name != "mixture"}
    return {
        "confidence": statements.CONFIDENCE,
        "bounds": asked.bounds,
        **outcome.estimate._asdict(),
        "stated": outcome.estimate.bound,
        "rollouts": outcome.rollouts,
        "prepared": prepared,
        "points": [
            {
                "distance": point.distance,
                "share": point.share,
                "importance": dict(zip((a.name for a in asked.plan.sampled), point.importance.tolist(), strict=True)),
                "metrics": point.metrics,
                "leaves": {name: np.asarray(x).tolist() for name, x in point.leaves.items()},
            }
            for point in outcome.points
        ],
    }
