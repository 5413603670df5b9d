"""The tables of a tuning report, and what they say in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import agvjax
from agvjax.leaves import element, unit_of
from agvjax.metric_table import METRICS
from agvjax.metric_units import PLAIN

from ..config.settings import Config
from ..io import numbers
from ..io.pages import grid
from ..io.statements import FOUND, NAMED, PROVED, of_draws, of_kind, said, worst_of
from . import figures, populations
from .analysis import Findings
from .choice import PAYS
from .gains import value_of
from .judge import Summary
from .meanings import of_gains
from .methods.objective import Requirement
from .rounds import Round, Run


def comparison(before: Summary, after: Summary, metrics: Sequence[str], units: Mapping[str, str] = PLAIN) -> str:
    """Before, after and their ratio, as a Markdown table."""

    def change(old: float, new: float) -> list[str]:
        return [f"{old:.5g}", f"{new:.5g}", f"**{new / old:.3f}**" if old else ""]

    rows: list[list[object]] = [
        [n, units[n], *change(before.mean[n], after.mean[n]), *change(before.worst[n], after.worst[n])]
        for n in metrics
        if not np.isnan(before.mean[n])  # no late error of a run that ends before it
    ]
    counts = {"diverged runs": (before.latched, after.latched), "not settled": (before.unsettled, after.unsettled)}
    rows += [[name, f"of {before.size}", *pair, "", "", "", ""] for name, pair in counts.items()]
    largest = f"{worst_of(before.size)} before"
    return grid(["metric", "unit", "mean before", "after", "ratio", largest, "after", "ratio"], rows)


def words(size: int, searched: bool, lawful: bool) -> str:
    """What the claims of a report mean: of so many validation scenarios, of a search, of the law's own conditions."""
    kinds = [kind for kind, there in ((FOUND, searched), (PROVED, lawful)) if there]
    return said(of_draws(size), NAMED, *map(of_kind, kinds))


def changes(before: Summary, after: Summary, metrics: Sequence[str]) -> str:
    """In a sentence, which means became better and which worse."""
    parts: dict[str, list[str]] = {"better": [], "worse": [], "unchanged within 1 %": []}
    for name in metrics:
        old, new = before.mean[name], after.mean[name]
        if not (np.isfinite(old) and np.isfinite(new) and old > 0):
            continue
        change = new / old - 1
        bad = -change if METRICS[name].large else change
        kind = "better" if bad < -0.01 else "worse" if bad > 0.01 else "unchanged within 1 %"
        parts[kind].append(name if abs(change) <= 0.01 else f"{name} {numbers.change(new / old)}")
    told = "; ".join(f"{kind}: {', '.join(names)}" for kind, names in parts.items() if names)
    return f"On average over the validation scenarios: {told}." if told else ""


def gains(names: Sequence[str], before: Any, after: Any, stability: Mapping[str, float]) -> str:
    """Gains before and after, with the margin to each stability condition."""
    rows = []
    for name in dict.fromkeys([*names, *stability]):
        bound, old, new = stability.get(name), value_of(before, name), value_of(after, name)
        condition = ["", ""] if bound is None else [f"{bound:.4g}", f"{new - bound:.4g}"]
        values = [f"{old:.5g}", f"{new:.5g}", unit_of(after, element(name)[0])]
        rows.append([name, *values, *(condition if stability else [])])
    return grid(["gain", "before", "after", "unit", *(["lower bound", "margin"] if stability else [])], rows)


def gains_of_laws(laws: Mapping[str, tuple[agvjax.Law, agvjax.Law, Sequence[str]]]) -> str:
    """Gains of several laws by their names: own and tuned values, units, meanings.

    Args:
        laws: by name the law with its own gains, the tuned one, and which gains are told.
    """
    rows = [
        [law, name, value_of(own, name), value_of(tuned, name), unit_of(own, element(name)[0]), meaning]
        for law, (own, tuned, names) in laws.items()
        for name, meaning in of_gains(own, names).items()
    ]
    return grid(["law", "gain", "own", "tuned", "unit", "meaning"], rows)


def choice(names: Sequence[str], first: Sequence[str], promises: np.ndarray | None) -> str:
    """Which further numbers of a law were tuned too, which were not, and why; empty where nothing was chosen."""
    if promises is None:
        return ""
    kept = [(name, column) for name, column in zip(names, promises.T, strict=True) if name not in first]
    rows = [
        [name, *(f"{100 * x:.4f}" if x else "" for x in column), "yes" if (column >= PAYS).any() else ""]
        for name, column in sorted(kept, key=lambda row: -row[1].max())
    ]
    turns = [f"predicted gain, pass {i + 1} [% of the cost]" for i in range(len(promises))]
    told = f"""
{", ".join(first)} were tuned first, as the law names them. Then the reduction of the cost that
every other parameter could bring was predicted, to first order, within the limits and a factor of e either way. Those
with {PAYS:.3%} or more were tuned too, and the rest were predicted again at the new gains; the others are unchanged.

"""
    return told + grid(["parameter of the law", *turns, "tuned too"], rows) + "\n"


def tightened(limits: Sequence[Requirement], run: Run) -> str:
    """What bounds were multiplied by because limits held at the step of tuning alone; empty where all held."""
    if (rows := run.tightened) is None:
        return ""
    told = [f"{r.name} to {x:.5f} of its bound" for r, x in zip(limits, rows[-1], strict=True) if x != 1]
    times = "once" if len(rows) == 1 else f"{len(rows)} times"
    earlier = " The gains are those of an earlier search, whose limits hold at simulate.dt too."
    found = earlier if run.factors_found is None else ""
    return f" Limits that held at tune.dt but not at simulate.dt were tightened {times}: {', '.join(told)}.{found}"


def drawn(run: Run) -> str:
    """How many of the iterations followed no slope, and whether the gains come from these."""
    count = sum(p.iteration for p in run.searches if populations.drawn(p))
    if not count:
        return ""
    found = ", and the gains come from these" if populations.drawn(run.lead) else ""
    return f" {count} of them are generations of CMA-ES, {populations.SIZE} gain sets each, without gradients{found}."


def standings(findings: Findings, units: Mapping[str, str] = PLAIN) -> str:
    """Where every requirement stands, and by how much a gain moves it."""
    rows = []
    for s in findings.standings:
        kind = "goal" if not s.limit else "lower limit" if s.requirement.least else "limit"
        state = "" if not s.limit else "**not met**" if not s.met else "active" if s.active else "met"
        price = "not known" if s.price is None else f"{s.price:.2%}" if s.limit and s.price > 1e-6 else ""
        value = f"{s.value:.5g} {units[s.requirement.metric]}"
        slopes = [figures.signed(x) for x in s.slopes]
        rows.append([s.requirement.name, kind, value, f"{s.level:.4f}", state, price, *slopes])
    return grid(["requirement", "", "value", "level", "", "shadow price", *findings.names], rows)


def identifiability(findings: Findings) -> list[str]:
    """What the data cannot tell, in words."""
    names, (strength, weakest, alike) = findings.names, findings.identifiability
    if len(names) < 2:
        return []
    weak = sorted(zip(names, weakest, strict=True), key=lambda pair: -abs(pair[1]))
    mixture = ", ".join(f"{x:+.2f} {name}" for name, x in weak if abs(x) > 0.2)
    sentences = [
        f"The metrics are least sensitive to the combination ({mixture}) of relative changes of the gains:"
        f" {strength[-1] / strength[0]:.1e} of the largest sensitivity."
    ]
    sentences += [
        f"{names[i]} and {names[j]} cannot be distinguished: they have the same effect on every metric of every"
        f" scenario (cosine {cosine:+.3f})."
        for i, j, cosine in alike
    ]
    felt = np.max(np.abs([s.slopes for s in findings.standings]), axis=0)
    flat = [name for name, largest in zip(names, felt, strict=True) if largest < 1e-4]
    if flat:
        sentences.append(f"No effect at all, to first order: {', '.join(flat)}.")
    return sentences


def rounds(
    rows: Sequence[Round],
    bounds: Mapping[str, float] | None = None,
    start: Mapping[str, float] | None = None,
    units: Mapping[str, str] = PLAIN,
) -> str:
    """What every round came to; beside it the limits on the worst, and the starting gains where the last one looked."""
    last = max((r.round for r in rows), default=0)
    heads = ["round", "metric", "unit", "largest in the ensemble", f"{FOUND} in the box"]
    cells = [[r.round, r.metric, units[r.metric], r.best, r.worst_found] for r in rows]
    for head, values in (("limit", bounds), ("same scenario, starting gains", start)):
        if values is not None:
            heads.append(head)
            for cell, r in zip(cells, rows, strict=True):
                told = r.metric in values and (values is bounds or r.round == last)
                cell.append(f"{values[r.metric]:.5g}" if told else "")
    return grid(heads, cells)


def path_of(config: Config) -> str:
    """Why the nominal vehicle cannot follow the path exactly with any gains; else what it takes of its limits."""
    scenario, horizon = config.scenario, config.simulate.horizon
    title, reasons = "\n## The path\n\n", agvjax.path_warnings(scenario, horizon)
    if reasons:
        listed = "\n".join(f"* {text}" for text in reasons)
        return f"{title}It cannot be followed exactly with any gains:\n\n{listed}\n"
    if unchecked := agvjax.path_unchecked(scenario, horizon):
        return f"{title}Whether it can be followed was not checked: {unchecked}.\n"
    needs = "; ".join(agvjax.path_needs(scenario, horizon))
    return f"{title}The nominal vehicle can follow it. At most it needs, of its limits: {needs}.\n" if needs else ""
