"""The report of `agvjax apply`: accepted or refused, why, and the files for the robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import agvjax
from agvjax.leaves import leaves
from agvjax.metric_units import units_in

from .. import config as configuration
from ..config.settings import Config
from ..io import files, statements
from ..io.files import Json
from ..io.pages import grid, picture, publish
from ..io.pictures import write_figures
from . import figures
from .run import Applied

ROBOT, BACK = "gains.toml", "back.toml"
CAPTION = (
    "Left the first goal in every run of a vehicle that the log leaves possible, with the current gains and with the"
    " new ones; right the weighted goals of every vehicle, averaged over its runs. Below the dashed line the new gains"
    " are better."
)
LIMITS, GAINS, VEHICLE = "Limits", "Gains that change", "The vehicle"
MOST = 5  # reasons that a terminal is told


def write(config: Config, result: Applied, named: tuple[str, str], contents: tuple[bytes, bytes], out: Path) -> str:
    """Everything into a folder; returns what is printed.

    The file for the robot is written last, when its way back is there; of refused gains neither is written.

    Args:
        config: as it was asked for; where the vehicle is known, that vehicle stands in the folder's `config.toml`.
        result: the decision.
        named: the files of the current gains and of the new ones.
        contents: their bytes.
        out: the folder.
    """
    there = result.known.config
    files.write(out / "config.toml", configuration.dump(config if result.known.against else there))
    files.write_json(out / "decision.json", decided(result))
    found = result.compared
    lost = [] if found is None else write_figures(out, {"vehicles": lambda: figures.vehicles(there, found)})
    publish(out, page(result, named), (VEHICLE,))
    if result.decision.accepted:
        files.write(out / BACK, contents[0])
        files.write(out / ROBOT, contents[1])
    return "\n\n".join([brief(result), *lost])


def decided(result: Applied) -> Json:
    """The numbers, for scripts."""
    decision, found = result.decision, result.compared
    told: Json = {"accepted": decision.accepted, "reasons": list(decision.reasons), "logs": list(result.known.logs)}
    if found is None:
        return told
    counts = {"vehicles": decision.vehicles, "worse": decision.worse, "not_worse_at_least": decision.least}
    costs = {"cost": found.costs.mean(axis=1).tolist(), "cost_at_the_worst_found": found.worst.tolist()}
    return told | counts | costs | {"limits": {one.name: [one.before, one.after] for one in found.limits}}


def verdict(result: Applied) -> str:
    """A sentence, and a line for every reason."""
    decision, found = result.decision, result.compared
    if found is None or not decision.accepted:
        head = "**Refused: the current gains stay.**"
        return "\n".join([head, "", *(f"* {reason[0].upper()}{reason[1:]}." for reason in decision.reasons)])
    asked = result.known.config.apply
    change = found.costs[1].mean() / found.costs[0].mean() - 1
    by = f", but for {asked.margin:.1%}," if asked.margin else ""
    return (
        f"**Accepted.** Of {decision.vehicles} vehicles that the log leaves possible the new gains are worse on"
        f" {decision.worse}: with {asked.confidence:.0%} confidence they are not worse{by} on {decision.least:.1%} of"
        f" all such vehicles. Nor are they on the vehicles worst found for either, and the limits are kept. On average"
        f" the weighted goals change by {change:+.1%}."
    )


def brief(result: Applied) -> str:
    """For a terminal."""
    lines = verdict(result).splitlines()
    more = len(lines) - 2 - MOST
    if more > 0:
        lines = [*lines[: 2 + MOST], f"* and {more} more reasons, in the report"]
    return "\n\n".join(["\n".join(lines), *([] if result.compared is None else [predicted(result)])])


def predicted(result: Applied) -> str:
    """Goals and limits on the vehicles that were drawn: mean and worst, current and new."""
    found = result.compared
    if found is None:
        return ""
    units, rows = units_in(result.known.config.scenario), []
    for name in found.objective.of_runs().metrics:
        before, after = (np.asarray(m[name], float)[np.asarray(m.ok)] for m in found.metrics)
        if not (before.size and after.size):
            continue
        pairs = [(before.mean(), after.mean()), (before.max(), after.max())]
        cells = [cell for a, b in pairs for cell in (f"{a:.4g}", f"{b:.4g}", f"{b / a:.3f}" if a else "")]
        rows.append([name, units[name], *cells])
    rows.append(["diverged runs", "", *(int((~np.asarray(m.ok)).sum()) for m in found.metrics), "", "", "", ""])
    worst = statements.worst_of(result.decision.vehicles)
    return grid(["metric", "unit", "mean now", "new", "ratio", f"{worst} now", "new", "ratio"], rows)


def changed(current: agvjax.Law, new: agvjax.Law) -> list[list[object]]:
    """Gains that are others, before and after; only those of one law are beside those of the other."""
    old, now = leaves(current), leaves(new)
    rows: list[list[object]] = []
    for name in dict.fromkeys([*old, *now]):
        a, b = (np.asarray(of[name], float) if name in of else None for of in (old, now))
        if a is None or b is None or not np.array_equal(a, b):
            rows.append([name, *("none" if x is None else _told(x) for x in (a, b))])
    return rows


def _told(value: np.ndarray) -> str:
    return f"{float(value):.5g}" if value.ndim == 0 else f"{value.size} numbers"


def page(result: Applied, named: tuple[str, str]) -> str:
    """The text of `report.md`."""
    (current, new), found, asked = named, result.compared, result.known.config.apply
    parts = [f"# {new} over {current}", verdict(result)]
    if result.decision.accepted:
        parts.append(
            f"For the robot: `{ROBOT}`, which is {new}. The way back: `{BACK}`, which is {current}, byte for byte."
        )
    if found is not None:
        parts += [picture("vehicles.png", CAPTION), predicted(result)]
        if found.limits:
            rows = [
                [r.name, r.before, r.after, "kept" if r.kept(asked.slack) else "**not kept**"] for r in found.limits
            ]
            words = f"1 is the bound. A limit that is held now must be held, but for {asked.slack:.0%}; another one"
            parts += [f"## {LIMITS}", f"{words} must not be exceeded further.", grid(["limit", "now", "new", ""], rows)]
    rows = changed(result.current, result.new)
    table = grid(["gain", "now", "new"], rows) if rows else "None: the files hold the same law."
    if found is not None:
        kinds = statements.of_draws(result.decision.vehicles), statements.of_kind(statements.FOUND)
        parts.append(statements.said(*kinds))
    parts += [f"## {GAINS}", table, f"## {VEHICLE}", f"By {', '.join(result.known.logs)}. {result.known.text}"]
    return "\n\n".join(parts) + "\n"
