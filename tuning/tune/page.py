"""What a tuning run found: the tables and the figures at its end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import agvjax
from agvjax.leaves import unit_of
from agvjax.metric_table import METRICS, metrics_of

from ..config.settings import LATE
from ..ensemble.worst import statement
from ..io import files
from ..io.pages import grid, html
from . import caveats, figures
from .analysis import Findings
from .judge import Summary, TuneVerdict, baseline_of
from .problem import TuningProblem
from .rounds import COLUMNS, Outcome, Round, Run

SHOWN = ("total_rmse", *LATE, "effort", "peak_position", "peak_heading", "total_chatter")


CONDITIONS = """
"Must exceed" are the law's own stability conditions (of the paper's law eqs. (48), (52), (70)) for the smallest
deadzone slopes that the ensemble can draw, times the margin asked for; they hold by construction.
"""


def comparison(before: Summary, after: Summary, metrics: Sequence[str]) -> str:
    """Before, after and their ratio, as a Markdown table."""

    def change(old: float, new: float) -> list[str]:
        return [f"{old:.5g}", f"{new:.5g}", f"**{new / old:.3f}**" if old else ""]

    rows: list[list[object]] = [
        [n, METRICS[n].unit, *change(before.mean[n], after.mean[n]), *change(before.worst[n], after.worst[n])]
        for n in metrics
        if not np.isnan(before.mean[n])  # no late error of a run that ends before it
    ]
    counts = {"diverged runs": (before.latched, after.latched), "not settled": (before.unsettled, after.unsettled)}
    rows += [[name, f"of {before.size}", *pair, "", "", "", ""] for name, pair in counts.items()]
    return grid(["metric", "unit", "mean before", "after", "ratio", "worst before", "after", "ratio"], rows)


def changes(before: Summary, after: Summary, metrics: Sequence[str]) -> str:
    """In a sentence, which means became better and which worse."""
    parts: dict[str, list[str]] = {"better": [], "worse": [], "within 1 % of what it was": []}
    for name in metrics:
        old, new = before.mean[name], after.mean[name]
        if not (np.isfinite(old) and np.isfinite(new) and old > 0):
            continue
        change = new / old - 1
        kind = "better" if change < -0.01 else "worse" if change > 0.01 else "within 1 % of what it was"
        parts[kind].append(name if abs(change) <= 0.01 else f"{name} {change:+.0%}")
    told = "; ".join(f"{kind}: {', '.join(names)}" for kind, names in parts.items() if names)
    return f"On average over the scenarios not tuned on, {told}." if told else ""


def gains(names: Sequence[str], before: Any, after: Any, stability: Mapping[str, float]) -> str:
    """Gains before and after, with the margin to each stability condition."""
    old, new = agvjax.leaves(before), agvjax.leaves(after)
    rows = []
    for name in dict.fromkeys([*names, *stability]):
        bound = stability.get(name)
        condition = ["", ""] if bound is None else [f"{bound:.4g}", f"{float(new[name]) - bound:.4g}"]
        values = [f"{float(old[name]):.5g}", f"{float(new[name]):.5g}", unit_of(after, name)]
        rows.append([name, *values, *(condition if stability else [])])
    return grid(["gain", "before", "after", "unit", *(["must exceed", "margin"] if stability else [])], rows)


def standings(findings: Findings) -> str:
    """Where every requirement stands, and by how much a gain moves it."""
    rows = []
    for s in findings.standings:
        kind = "limit" if s.limit else "goal"
        state = "" if not s.limit else "**not met**" if not s.met else "active" if s.active else "met"
        price = f"{s.price:.2%}" if s.limit and s.price > 1e-6 else ""
        value = f"{s.value:.5g} {METRICS[s.requirement.metric].unit}"
        slopes = [figures.signed(x) for x in s.slopes]
        rows.append([s.requirement.name, kind, value, f"{s.level:.4f}", state, price, *slopes])
    return grid(["requirement", "", "value", "level", "", "price", *findings.names], rows)


def identifiability(findings: Findings) -> list[str]:
    """What the data cannot tell, in words."""
    names, (strength, weakest, alike) = findings.names, findings.identifiability
    if len(names) < 2:
        return []
    weak = sorted(zip(names, weakest, strict=True), key=lambda pair: -abs(pair[1]))
    mixture = ", ".join(f"{x:+.2f} {name}" for name, x in weak if abs(x) > 0.2)
    sentences = [
        f"The combination of gains felt least is ({mixture}), in relative changes:"
        f" {strength[-1] / strength[0]:.1e} of the one felt most."
    ]
    sentences += [
        f"{names[i]} and {names[j]} cannot be told apart: they do the same to every metric of every scenario (cosine"
        f" {cosine:+.3f})."
        for i, j, cosine in alike
    ]
    felt = np.max(np.abs([s.slopes for s in findings.standings]), axis=0)
    flat = [name for name, largest in zip(names, felt, strict=True) if largest < 1e-4]
    if flat:
        sentences.append(f"Not felt at all, to first order: {', '.join(flat)}.")
    return sentences


def rounds(
    rows: Sequence[Round], bounds: Mapping[str, float] | None = None, start: Mapping[str, float] | None = None
) -> str:
    """What every round came to; beside it the limits on the worst, and the starting gains where the last one looked."""
    last = max((r.round for r in rows), default=0)
    heads = ["round", "metric", "unit", "worst in the ensemble", "worst found in the box"]
    cells = [[r.round, r.metric, METRICS[r.metric].unit, r.best, r.worst_found] for r in rows]
    for head, values in (("limit", bounds), ("there with the starting gains", start)):
        if values is not None:
            heads.append(head)
            for cell, r in zip(cells, rows, strict=True):
                told = r.metric in values and (values is bounds or r.round == last)
                cell.append(f"{values[r.metric]:.5g}" if told else "")
    return grid(heads, cells)


def conclusion(verdict: TuneVerdict) -> str:
    """The verdict: a sentence, and a line for whatever a careful reader should know."""
    first, *rest = verdict.lines
    return "\n".join([f"**{first}**", "", *(f"* {line}" for line in rest)]).strip()


def subject(config: Any) -> str:
    """What was tuned, in a line."""
    law, scenario = config.controller, config.scenario
    names = [type(part).__name__ for part in (law, scenario.plant, scenario.path)]
    size, unseen = config.ensemble.size, config.ensemble.validation_size
    return (
        f"{names[0]} for the plant {names[1]} on the path {names[2]}, {config.simulate.horizon:g} s;"
        f" {size} scenarios tuned on, {unseen} others to judge by. agvjax {agvjax.__version__}."
    )


# long: one template
def markdown(outcome: Outcome, verdict: TuneVerdict) -> str:
    """`report.md`."""
    problem, run, p = outcome.problem, outcome.run, outcome.progress
    config, objective, tuned = problem.config, problem.tuner.objective, problem.tuner.gains
    settings, before, after = config.tune, verdict.before, verdict.after
    names = shown(problem)
    places = len({row[1] for row in run.history if row[0] == 0})
    starts = f" from {places} starts" if places > 1 else ""
    latched = sum(row[COLUMNS.index("latched")] > 0 for row in run.history)
    clipped = problem.tuner.method.note(run.total("clipped"))
    counts = (
        f"{_screened(run)}{len(run.history)} iterations of {settings.optimizer}{starts}, {run.total('rollouts')}"
        f" rollouts of the ensemble in all (a gradient counts 1 + its tangents), best at iteration {p.best_iteration};"
        f" {latched} of them with diverged runs,{clipped} {run.total('backed_out')} backed out of because no gradient"
        " there was of use."
    )
    smooth = _smooth_note(objective.names)
    learned = "\n".join(f"* {line}" for line in identifiability(verdict.findings))
    best = {r.metric: r.best for r in outcome.rounds if r.round == run.round}  # the ensemble lies in the box too
    worst = [f._replace(value=max(f.value, best.get(f.metric, 0.0))) for f in outcome.found]
    searched = "\n".join(f"* {line}" for line in [*statement(worst), *_worse(outcome)])
    conditions = CONDITIONS if tuned.stability else ""
    baseline = baseline_of(problem, verdict.start)
    worst_table = rounds(outcome.rounds, caveats.worst_bounds(objective, baseline), verdict.start_at_worst)
    return f"""# Tuned gains

{subject(config)}

{conclusion(verdict)}

## The gains

{gains((*tuned.names, *tuned.tied), config.controller, outcome.controller, tuned.stability)}
{conditions}
They are in `gains.toml`: `agvjax simulate --config config.toml --config gains.toml`, in this folder.

![nominal](nominal.png)

## On {after["validation"].size} validation scenarios, not seen in tuning

{changes(before["validation"], after["validation"], names)}

{comparison(before["validation"], after["validation"], names)}

## On the {after["tuning"].size} tuning scenarios

{comparison(before["tuning"], after["tuning"], names)}

total_rmse is sqrt(mean of e_x^2 + e_y^2 + e_psi^2), rmse_late one channel's after
4 s, past the start; effort the same of the commands before the deadzone; mean and worst
are over the runs that did not diverge. Judged at steps of {config.simulate.dt:g} s, tuned at {settings.dt:g} s.{smooth}
{_path(config)}
## What each requirement hangs on

{standings(verdict.findings)}

Level: of a goal relative to the starting gains, of a limit relative to its bound. Price: by how much the goal would
fall if this limit alone were relaxed by 1 %. Under each gain: relative change of the requirement per relative change
of the gain, at the tuned gains.

{learned}

## The worst case

{searched}

{worst_table}

The box holds every value that the ensemble can draw{_cut(problem)}; "worst in the ensemble" includes scenarios that
earlier rounds added. Searched at steps of {settings.dt:g} s.

## How it went

{counts} Seed {config.seed}, {config.precision}-bit.

![cost and gains](history.png)

![sensitivities](sensitivity.png)

![worst](worst.png)
"""


def brief(outcome: Outcome, verdict: TuneVerdict) -> str:
    """What a terminal is told: the gains, the metrics on scenarios not seen, the verdict."""
    problem, before, after = outcome.problem, verdict.before["validation"], verdict.after["validation"]
    tuned, names = problem.tuner.gains, shown(problem)
    table = gains((*tuned.names, *tuned.tied), problem.config.controller, outcome.controller, tuned.stability)
    first, *rest = verdict.lines
    size = f"On {after.size} validation scenarios, not seen in tuning:"
    told = [comparison(before, after, names), "", changes(before, after, names), "", first]
    return "\n".join([table, "", size, "", *told, *(f"* {line}" for line in rest)])


def shown(problem: TuningProblem) -> tuple[str, ...]:
    """The metrics that a report shows: the usual ones, those of actuators, and all that goals and limits name."""
    plant = problem.config.scenario.plant
    delivered = [] if type(plant) is agvjax.Decoupled else sorted(n for n, row in METRICS.items() if row.delivered)
    names = dict.fromkeys([*SHOWN, *delivered, *problem.tuner.objective.names])
    return tuple(name for name in names if name in metrics_of(plant))


def _path(config: Any) -> str:
    """Why no gains can make the nominal vehicle follow the path exactly; nothing where it can."""
    reasons = "\n".join(f"* {text}" for text in agvjax.path_warnings(config.scenario, config.simulate.horizon))
    return f"\n## The path\n\nWhatever the gains, it cannot be followed exactly:\n\n{reasons}\n" if reasons else ""


def _worse(outcome: Outcome) -> list[str]:
    """What to do where the search found scenarios worse than those tuned on."""
    if not outcome.worse:
        return []
    rounds = outcome.problem.config.tune.search.rounds
    more = "tune.search.rounds tunes again with what was found" if not rounds else "more rounds may help"
    more = outcome.stopped or more
    return [f"Worse than any scenario that was tuned on, in {', '.join(outcome.worse)}: {more}."]


def _screened(run: Run) -> str:
    """What was looked at before the first iteration."""
    seen = run.screened
    if seen is None:
        return ""
    lost = f", every run of {seen.lost} of them diverged" if seen.lost else ""
    return f"{seen.looked} gain sets looked at first, at the price of {seen.rollouts} rollouts of the ensemble{lost}. "


def _smooth_note(names: Sequence[str]) -> str:
    if not any(name.startswith("settling") for name in names):
        return ""
    return (
        " A settling time jumps where the error touches its band once more: its value is the true one (the horizon for"
        " a run that has not settled), its slope that of a smooth stand-in."
    )


def _cut(problem: Any) -> str:
    tailed = [n for n, d in problem.config.ensemble.draws.items() if d.tailed]
    return f", but for the outermost 0.1 % on either side of {', '.join(tailed)}" if tailed else ""


def write(outcome: Outcome, verdict: TuneVerdict, out: Path) -> str:
    """Report, figures and `worst.json` into a folder; returns what a terminal has room for."""
    config, tuner = outcome.problem.config, outcome.problem.tuner
    scenes = {"nominal": ("nominal scenario", config.scenario)}
    scenes["worst"] = ("validation scenario with the largest error of the tuned gains", verdict.worst)
    for name, (title, scene) in scenes.items():
        before, after = (
            agvjax.simulate(
                agvjax.check(law), agvjax.check(scene), save_every=config.simulate.save_every, **config.timing()
            )
            for law in (config.controller, outcome.controller)
        )
        files.write_figure(out / f"{name}.png", figures.tracking_figure(before, after, title))
    files.write_figure(out / "history.png", figures.history_figure(tuner.gains.names, outcome.run))
    files.write_figure(out / "sensitivity.png", figures.sensitivity_figure(verdict.findings))
    files.write_json(out / "worst.json", _worst(outcome, verdict))
    text = markdown(outcome, verdict)
    files.write(out / "report.md", text)
    files.write(out / "report.html", html(text, out, "Tuned gains"))
    return brief(outcome, verdict)


def _worst(outcome: Outcome, verdict: TuneVerdict) -> Mapping[str, object]:
    """The worst scenario found for each metric, so that it can be looked at again, and why the gains failed, if so."""
    rows = [
        {"metric": f.metric, "value": f.value, "searches": f.searches, "samples": f.samples, "rollouts": f.rollouts}
        | {"scenario": {name: np.asarray(value).tolist() for name, value in f.scenario.items()}}
        for f in outcome.found
    ]
    gains = {name: np.asarray(value, float).tolist() for name, value in agvjax.leaves(outcome.controller).items()}
    rounds = [r._asdict() for r in outcome.rounds]
    return {"found": rows, "rounds": rounds, "verdict": verdict.failure, "gains": gains}
