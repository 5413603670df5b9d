"""What a tuning run found: the tables and the figures at its end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

import agvjax
from agvjax.draw import plot
from agvjax.metric_table import METRICS, metrics_of
from agvjax.metric_units import units_in

from ..config import mapped
from ..config.names import in_words
from ..config.settings import FOLLOWED_METRICS, LATE, Config
from ..ensemble.worst import statement
from ..io import files, viewers
from ..io.pages import grid, look_closer, meanings, picture, publish
from ..io.pictures import Drawing, write_figures
from ..io.statements import worst_of
from . import caveats, figures, tables
from .finer import baseline_of
from .gains import value_of
from .judge import TuneVerdict
from .meanings import of_gains, of_metrics
from .problem import TuningProblem
from .rounds import COLUMNS, Outcome, Run

LINES, ROWS = 15, 7  # that a terminal is told, and of these of a table
SENSITIVITIES, SEEN, SEARCH = "Requirements and their sensitivities", "On the tuning scenarios", "The search"
SYMBOLS = "What these mean"
NOMINAL = (
    "The configured vehicle with the starting gains (grey, dashed) and the tuned gains (blue): its path, and over time"
    " its error and the command before the deadzone."
)
WORST = "The same for the validation scenario in which the tuned gains have the largest error."
SENSITIVITY = "By how many percent a requirement changes if one gain alone rises by one percent."
HISTORY = "The search, round after round: cost and goal, the norm of the gradient, and each gain relative to its start."
SHOWN = ("total_rmse", *LATE, "effort", "peak_position", "peak_heading", "total_chatter")


CONDITIONS = """
"Lower bound" is the law's own stability condition (for the paper's law eqs. (48), (52), (70)) at the smallest deadzone
slopes that the ensemble can draw, times `tune.stability_margin`; it holds by construction, and what it says is proved.
"""


def conclusion(verdict: TuneVerdict) -> str:
    """The verdict: a sentence, and a line for whatever a careful reader should know."""
    first, *rest = verdict.lines
    return "\n".join([f"**{first}**", "", *(f"* {line}" for line in rest)]).strip()


def subject(config: Config) -> str:
    """What was tuned, in a line."""
    law, scenario = config.controller, config.scenario
    size, unseen = config.ensemble.size, config.ensemble.validation_size
    which = in_words(law)
    if isinstance(law, agvjax.Sampled):
        which = f"{in_words(law.inner)}, one command every {float(law.period):g} s"
    return (
        f"Law: {which}. Vehicle: {in_words(scenario.plant)}. Path: {in_words(scenario.path)}. Runs of"
        f" {config.simulate.horizon:g} s; {size} scenarios for tuning, {unseen} others for validation."
    )


# long: one template
def markdown(outcome: Outcome, verdict: TuneVerdict, closer: str = "") -> str:
    """`report.md`; `closer` is a link to the interactive page, where there is one."""
    problem, run, p = outcome.problem, outcome.run, outcome.progress
    config, objective, tuned = problem.config, problem.tuner.objective, problem.tuner.gains
    settings, before, after = config.tune, verdict.before, verdict.after
    names, units = shown(problem), units_in(config.scenario)
    places = len({row[1] for row in run.history if row[0] == 0})
    starts = f" in {places} searches" if places > 1 else ""
    which = f" of search {next(i for i, one in enumerate(run.searches) if one is p)}" if len(run.searches) > 1 else ""
    latched = sum(row[COLUMNS.index("latched")] > 0 for row in run.history)
    clipped = problem.tuner.method.note(run.total("clipped"))
    counts = (
        f"{_screened(run)}{len(run.history)} iterations of {settings.optimizer}{starts}, {run.total('rollouts')}"
        f" rollouts of the ensemble in all (a gradient counts 1 + its tangents), best at iteration {p.best_iteration}"
        f"{which}; {latched} of them with diverged runs,{clipped} {run.total('backed_out')} undone because no gradient"
        f" there was usable.{tables.drawn(run)}"
    )
    smooth = _smooth_note(objective.metrics)
    learned = "\n".join(f"* {line}" for line in tables.identifiability(verdict.findings))
    best = {r.metric: r.best for r in outcome.rounds if r.round == run.round}  # the ensemble lies in the box too
    worst = [f._replace(value=max(f.value, best.get(f.metric, 0.0))) for f in outcome.found]
    searched = "\n".join(f"* {line}" for line in [*statement(worst), *_worse(outcome)])
    conditions = CONDITIONS if tuned.stability else ""
    baseline = baseline_of(problem, verdict.start)
    worst_table = tables.rounds(
        outcome.rounds, caveats.worst_bounds(objective, baseline), verdict.start_at_worst, units
    )
    return f"""# Tuned gains

{subject(config)}

{conclusion(verdict)}

{tables.changes(before["validation"], after["validation"], names)}

{tables.words(after["validation"].size, bool(outcome.found), bool(tuned.stability))}

{picture("nominal.png", NOMINAL)}

{closer}

## The gains

{tables.gains((*moved(outcome), *tuned.tied), config.controller, outcome.controller, tuned.stability)}
{conditions}{tables.choice(tuned.names, problem.first, run.promises)}
They are in `gains.toml`: `agvjax simulate --config config.toml --config gains.toml`, in this folder.

## On {after["validation"].size} validation scenarios (not used for tuning)

{tables.comparison(before["validation"], after["validation"], names, units)}

Runs that diverged are left out. Evaluated at steps of {config.simulate.dt:g} s, tuned at {settings.dt:g} s.{smooth}

## {SYMBOLS}

{symbols(outcome)}
{tables.path_of(config)}
## Worst found

{searched}

{worst_table}

The search covers the whole range of values that the ensemble can draw{_cut(problem)} (the box); "largest in the
ensemble" includes scenarios that earlier rounds added. Searched at steps of {settings.dt:g} s.

{picture("worst.png", WORST)}

## {SENSITIVITIES}

{tables.standings(verdict.findings, units)}

Level: for a goal its value / that with the starting gains, for a limit value / bound, for a lower limit
2 - value / bound; a limit is met at a level of 1 or less. Shadow price: by how much the goal would fall if this limit
alone were relaxed by 1 %; not known where the slopes of runs that chatter leave its linear problem unsolved. Below each
gain: its sensitivity, the relative change of the requirement per relative change of the gain, at the tuned gains.

{picture("sensitivity.png", SENSITIVITY)}

{learned}

## {SEEN}

{tables.comparison(before["tuning"], after["tuning"], names, units)}

## {SEARCH}

{counts}{tables.tightened(objective.limits, run)} Seed {config.seed}, {config.precision}-bit.

{picture("history.png", HISTORY)}
"""


def brief(outcome: Outcome, verdict: TuneVerdict) -> str:
    """What a terminal is told, in at most `LINES` lines: the verdict, goals and limits on scenarios not seen, gains."""
    before, after = verdict.before["validation"], verdict.after["validation"]
    names = [n for n in outcome.problem.tuner.objective.metrics if n in before.mean][:ROWS]
    first, *rest = verdict.lines
    said = rest[: max(LINES - 6 - len(names), 1)]
    left = [f"* and {len(rest) - len(said)} more, in the report"] if len(rest) > len(said) else []
    size = f"On {after.size} validation scenarios, after / before:"
    rows = [
        [n, *(_times(x[n], y[n]) for x, y in ((after.mean, before.mean), (after.worst, before.worst)))] for n in names
    ]
    held = [name for name in moved(outcome) if not np.ndim(value_of(outcome.controller, name))][:ROWS]
    gains = ", ".join(f"{name} {float(value_of(outcome.controller, name)):.4g}" for name in held)
    gains += " ..." if len(held) < len(moved(outcome)) else ""
    table = grid([size, "mean", worst_of(after.size)], rows)
    return "\n".join([first, *(f"* {line}" for line in said), *left, table, f"Gains: {gains}"])


def _times(new: float, old: float) -> str:
    return f"{new / old:.3f}" if old and np.isfinite(old) else f"{new:.4g} / {old:.4g}"


def moved(outcome: Outcome) -> tuple[str, ...]:
    """The gains that were tuned, without those that were left as they are."""
    return tuple(name for name, m in zip(outcome.problem.tuner.gains.names, outcome.run.moving, strict=True) if m)


def symbols(outcome: Outcome) -> str:
    """What the gains and metrics of the tables mean."""
    config, tuned = outcome.problem.config, outcome.problem.tuner.gains
    gains = tuple(dict.fromkeys((*moved(outcome), *tuned.tied, *tuned.stability)))
    return meanings(of_gains(outcome.controller, gains) | of_metrics(shown(outcome.problem), config.criteria))


def shown(problem: TuningProblem) -> tuple[str, ...]:
    """The metrics that a report shows: the usual ones, those of actuators, and all that goals and limits name."""
    scenario, law = problem.config.scenario, problem.config.controller
    plant = scenario.plant
    delivered = [] if type(plant) is agvjax.Decoupled else sorted(n for n, row in METRICS.items() if row.delivered)
    ends = ("time_to_finish",) if np.isfinite(scenario.path.end()) else ()
    usual = (*FOLLOWED_METRICS, *ends) if law.follows() else SHOWN
    names = dict.fromkeys([*usual, *delivered, *problem.tuner.objective.metrics])
    return tuple(name for name in names if name in metrics_of(scenario, loop=True))


def _worse(outcome: Outcome) -> list[str]:
    """What to do where the search found scenarios worse than those tuned on."""
    if not outcome.worse:
        return []
    rounds = outcome.problem.config.tune.search.rounds
    more = "tune.search.rounds tunes again with these" if not rounds else "more rounds may help"
    more = outcome.stopped or more
    return [f"Worse than any tuning scenario, in {', '.join(outcome.worse)}: {more}."]


def _screened(run: Run) -> str:
    """What was looked at before the first iteration, and again where a round led nowhere."""
    seen = run.screened
    if seen is None:
        return ""
    lost = f", every run diverged for {seen.lost} of them" if seen.lost else ""
    return f"{seen.looked} gain sets screened, at the cost of {seen.rollouts} rollouts of the ensemble{lost}. "


def _smooth_note(names: Sequence[str]) -> str:
    if not any(name.startswith("settling") for name in names):
        return ""
    return (
        " A settling time jumps when the error touches its band once more: its value is the true one (the horizon for"
        " a run that has not settled), its derivative that of a smooth surrogate."
    )


def _cut(problem: TuningProblem) -> str:
    tailed = [n for n, d in problem.config.ensemble.draws.items() if d.tailed]
    return f", except the outermost 0.1 % on either side of {', '.join(tailed)}" if tailed else ""


def prepare(config: Config) -> None:
    """Import what draws, compile the run that is drawn: called in the background while a search computes."""
    plot.sheet((1.0, 1.0))
    _run(config, config.controller, config.scenario)


def _run(config: Config, law: agvjax.Law, scene: agvjax.Scenario) -> agvjax.Trajectory:
    """The run that is drawn."""
    timing, every = config.timing(), config.simulate.save_every
    run = agvjax.simulate(agvjax.check(law), agvjax.check(scene), save_every=every, **timing)
    return mapped.drawn(run, scene)


def write(outcome: Outcome, verdict: TuneVerdict, out: Path, appendix: str, recordings: viewers.Asked) -> str:
    """Report, figures, `worst.json`, and `recordings` of the nominal run; returns what a terminal has room for."""
    config, tuner = outcome.problem.config, outcome.problem.tuner
    files.write_json(out / "worst.json", _worst(outcome, verdict))
    scenes = {"nominal": ("nominal scenario", config.scenario)}
    scenes["worst"] = ("validation scenario with the largest error of the tuned gains", verdict.worst)
    drawings: dict[str, Drawing] = {}
    runs: dict[str, dict[str, agvjax.Trajectory]] = {}
    unit = config.scenario.plant.command_units[0]
    for name, (title, scene) in scenes.items():
        laws = {"before": config.controller, "after": outcome.controller}
        runs[name] = {which: _run(config, law, scene) for which, law in laws.items()}
        points = mapped.corners(scene.path)
        drawings[name] = partial(figures.tracking_figure, *runs[name].values(), title, points, unit, scene.path)
    start = tuner.gains.values(tuner.gains.coordinates(config.controller), config.controller)
    drawings["history"] = partial(figures.history_figure, tuner.gains.names, start, outcome.run)
    drawings["sensitivity"] = partial(figures.sensitivity_figure, verdict.findings)
    lost = write_figures(out, drawings)
    titles = {
        title[0].upper() + title[1:]: (scene, tuple(runs[name].values())) for name, (title, scene) in scenes.items()
    }
    text = markdown(outcome, verdict, look_closer(out, titles)) + appendix
    publish(out, text, (SYMBOLS, SENSITIVITIES, SEEN, SEARCH))
    viewers.write_runs(recordings, runs["nominal"], config.scenario.plant)
    return "\n\n".join([brief(outcome, verdict), *lost])


def _worst(outcome: Outcome, verdict: TuneVerdict) -> Mapping[str, object]:
    """The worst scenario found for each metric, so that it can be looked at again, and why the gains failed, if so."""
    rows = [
        {"metric": f.metric, "value": f.value, "searches": f.searches, "samples": f.samples, "rollouts": f.rollouts}
        | {"scenario": mapped.told(f.scenario, outcome.problem.config.scenario)}
        for f in outcome.found
    ]
    gains = {name: np.asarray(value, float).tolist() for name, value in agvjax.leaves(outcome.controller).items()}
    rounds = [r._asdict() for r in outcome.rounds]
    said = {"verdict": verdict.failure, "cautions": verdict.cautions}
    return {"found": rows, "rounds": rounds, **said, "gains": gains}
