"""A tuning problem solved: searches from every start, then the worst case, tuned again with it until none is worse."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import agvjax

from ..ensemble.worst import Found
from . import populations
from .choice import PAYS, promises
from .finer import TURNS, before_and_after, judged_with, tightened, tighter
from .problem import TuningProblem, in_units_of, starts, with_added
from .race import advanced, elsewhere, hard
from .screen import Screened
from .tuner import HISTORY, Progress, Tuner

COLUMNS = ("round", "start", *HISTORY)


class Round(NamedTuple):
    """What a round of tuning and searching came to, for one metric."""

    round: int
    metric: str
    best: float  # its worst in the ensemble, with what was added
    worst_found: float  # in the box; infinite where a run diverges


class Run(NamedTuple):
    """Everything that a run needs to go on from where it stands."""

    round: int
    searches: tuple[Progress, ...]  # of this round, one a start
    added: dict[str, np.ndarray]  # leaves of the scenarios that searches found, (A, ...)
    rounds: tuple[Round, ...]  # those before
    past: tuple[tuple[float, ...], ...]  # history of the rounds before, rows of COLUMNS and gains
    screened: Screened | None = None  # what was seen before the first iteration
    tightened: np.ndarray | None = None  # (turns, L), what bounds were multiplied by, see `finer.tighter`
    promises: np.ndarray | None = None  # (turns, K), of the gains that did not move yet, see `choice.promises`
    first: int = 0  # searches that the first round began with; 0, of an earlier release: `tune.starts`
    held: int = -1  # the search of before bounds were tightened whose limits hold at the finer step; -1: none

    @property
    def history(self) -> list[tuple[float, ...]]:
        """A row an iteration and start, over all rounds."""
        rows = [(self.round, i, *row) for i, p in enumerate(self.searches) for row in p.history]
        return [*self.past, *sorted(rows, key=lambda row: (row[2], row[1]))]

    @property
    def factors(self) -> np.ndarray | None:
        """What the bounds of limits (L,) are multiplied by now; None: nothing."""
        return None if self.tightened is None else self.tightened[-1]

    @property
    def factors_found(self) -> np.ndarray | None:
        """What they were multiplied by where the best search found its gains."""
        return None if 0 <= self.held and self.searches[self.held] is self.lead else self.factors

    @property
    def moving(self) -> np.ndarray:
        """Which gains (K,) may move by now."""
        return self.searches[-1].moving

    @property
    def turns(self) -> int:
        """How many times further gains were let go in this round."""
        return len({p.moving.tobytes() for p in self.searches}) - 1

    @property
    def lead(self) -> Progress:
        """The best search of this round."""
        return min(self.searches, key=lambda p: p.best)

    def total(self, name: str) -> int:
        """Sum over rounds and starts of what a column counts up."""
        ends: dict[tuple[float, float], float] = {}
        for row in self.history:
            ends[row[0], row[1]] = row[COLUMNS.index(name)]
        if name == "rollouts":  # a search along a line adds to them after its row
            ends |= {(self.round, i): p.rollouts for i, p in enumerate(self.searches)}
            ends[-1, 0] = 0 if self.screened is None else self.screened.rollouts
        return int(sum(ends.values()))


class Outcome(NamedTuple):
    """Tuned gains and what is known of them."""

    problem: TuningProblem  # the last round's problem
    run: Run
    controller: Any
    found: list[Found]  # the worst scenarios of the last search
    rounds: tuple[Round, ...]
    stopped: str = ""  # why fewer rounds were tuned than could have been
    metrics: tuple[agvjax.Metrics, agvjax.Metrics] | None = None  # at the finer step, see `finer.before_and_after`

    @property
    def worse(self) -> list[str]:
        """Metrics of which the box is known to hold a worse scenario than any that was tuned on."""
        last = [r for r in self.rounds if r.round == self.run.round]
        return [r.metric for r in last if r.worst_found > (1 + self.problem.config.tune.search.tolerance) * r.best]

    @property
    def progress(self) -> Progress:
        """The search that found the gains."""
        return self.run.lead


def begin(problem: TuningProblem) -> Run:
    """Before the first iteration."""
    return Run(0, tuple(problem.tuner.begin(z, problem.moving) for z in starts(problem)), {}, (), ())


def solve(
    problem: TuningProblem,
    run: Run | None = None,
    each: Callable[[Run], None] = lambda run: None,
    searching: Callable[[], None] = lambda: None,
    looking: Callable[[int, int], None] = lambda runs, sets: None,
) -> Outcome:
    """Look at many gain sets, tune from the best, search for the worst scenario, add it and tune again.

    As many rounds of the last two as are configured.

    Args:
        problem: the problem, from `pose`.
        run: where to go on; None begins.
        each: called after every iteration.
        searching: called before every search for the worst scenario.
        looking: called while many gain sets are looked at, see `Screen.look`.

    Raises:
        RuntimeError: nothing can be tuned from the starting gains.
    """
    run = _begun(problem, run, looking)
    problem = in_units_of(problem, run.screened.unit) if run.screened is not None else problem
    problem = with_added(problem, run.added) if run.added else problem
    while True:
        run, metrics = _held(problem, run, each, looking)
        reason = _hindrance(run)
        run, stopped = _known(problem, run, reason) if reason else (run, "")
        searching()
        outcome = _outcome(problem, run, stopped)._replace(metrics=metrics)
        if stopped or run.round >= problem.config.tune.search.rounds or not outcome.worse:
            return outcome
        problem, run = _again(outcome)


def _begun(problem: TuningProblem, run: Run | None, looking: Callable[[int, int], None]) -> Run:
    """The run with its screening behind it; one that has iterated, of an earlier release, may have had none."""
    run = begin(problem) if run is None else run
    if problem.screen is None or run.screened is not None or run.history:
        return run
    seen = problem.screen.look(looking)
    places = seen.apart(problem.config.tune.starts)
    searches = tuple(problem.tuner.begin(z, problem.moving) for z in places)
    return run._replace(screened=seen, searches=searches, first=len(searches))


def _held(
    problem: TuningProblem, run: Run, each: Callable[[Run], None], looking: Callable[[int, int], None]
) -> tuple[Run, tuple[agvjax.Metrics, agvjax.Metrics] | None]:
    """The run with all searches finished, and its metrics at the finer step.

    Where limits are met at the step of tuning and not there, bounds are tightened and the search goes on from its best.
    """
    while True:
        tight = tightened(problem, run.factors)
        run = _searched(tight, run, each, looking)
        if _hindrance(run):
            return run, None
        metrics = before_and_after(problem, tight.tuner.best(run.lead))
        turns = np.zeros((0, 0)) if run.tightened is None else run.tightened
        factors = tighter(problem, metrics, run.factors) if run.lead.best[0] == 0 and len(turns) < TURNS else None
        if factors is None:
            return run, metrics
        held, none = _holding(problem, run, metrics[0]), (np.inf, np.inf)  # by bounds that count no more
        old = (p if i == held else p._replace(best=none) for i, p in enumerate(run.searches))
        begin = (
            populations.begin if populations.drawn(run.lead) else Tuner.begin
        )  # what found them, where slopes led no further
        begun = begin(tight.tuner, run.lead.best_z, run.moving)
        rows = factors[None] if run.tightened is None else np.vstack([turns, factors])
        run = run._replace(searches=(*old, begun), tightened=rows, held=held)


def _holding(problem: TuningProblem, run: Run, before: agvjax.Metrics) -> int:
    """Which of the other searches is the best whose limits hold at the finer step; -1: none. `before` is the start's.

    Where errors of the step differ from gains to gains, it may be better than what tightened bounds lead to.
    """
    for i in sorted(range(len(run.searches)), key=lambda i: run.searches[i].best):
        p = run.searches[i]
        if p is not run.lead and p.history and p.best[0] == 0 and np.isfinite(p.best[1]):
            after = judged_with(problem, problem.tuner.best(p))
            if tighter(problem, (before, after), None) is None:
                return i
    return -1


def _searched(
    problem: TuningProblem, run: Run, each: Callable[[Run], None], looking: Callable[[int, int], None]
) -> Run:
    """The run with all searches finished.

    Where the first gain little or nothing, with others from further places (`race`); then with further gains let go. In
    later rounds a search gains little because it begins at tuned gains: others follow only where it came to nothing.
    """
    while True:
        while (after := advanced(problem, run)) is not None:
            run = after
            each(run)
        stuck = _hindrance(run)
        if run.round == 0 and not run.turns and problem.tuner.method.jacobian and hard(problem, run):
            stuck = "it gained little"
        further = elsewhere(problem, run, looking) if stuck and run.tightened is None else None
        further = _let_go(problem, run) if further is None else further
        if further is None:
            return run
        run = further


def _outcome(problem: TuningProblem, run: Run, stopped: str) -> Outcome:
    """What the lead is worth in the worst scenarios of the box."""
    z, names = run.lead.best_z, problem.tuner.objective.names
    found, best = problem.adversary.search(z, run.round), problem.tuner.worst(z)
    rounds = tuple(Round(run.round, f.metric, float(best[names.index(f.metric)]), f.value) for f in found)
    return Outcome(problem, run, problem.tuner.best(run.lead), found, (*run.rounds, *rounds), stopped)


def _hindrance(run: Run) -> str:
    """Why searches came to nothing; empty where they did not: slopes may take no step from what a population found."""
    lead = run.lead
    place = next(i for i, p in enumerate(run.searches) if p is lead)
    follows = place > 0 and populations.drawn(run.searches[place - 1])
    if lead.backed_out and lead.backed_out == lead.iteration - 1 and not follows:
        return "every step led to a point without a usable gradient: the gains are the starting gains"
    if np.isinf(lead.best[1]):
        advice = "other starting gains may help, or tune.starts = 8, which tries more; agvjax doctor shows why"
        return f"no gradient at the starting gains was usable: no step was taken; {advice}"
    return ""


def _let_go(problem: TuningProblem, run: Run) -> Run | None:
    """The run with a search from its best gains in which more of them move; None where no more are to.

    All that are left, or those that promise something; then again those that do so where these have been tuned.
    """
    if run.round or run.moving.all() or _hindrance(run):
        return None
    more, looked = ~run.moving, run.promises
    if problem.config.tune.gains == "sensitive":
        if looked is not None and len(looked) > run.turns:
            return None  # the last look found none
        steered = next(p for p in (run.lead, *reversed(run.searches)) if not populations.drawn(p))  # it has a penalty
        found = promises(problem.tuner, steered._replace(best_z=run.lead.best_z), run.moving)
        looked = found[None] if looked is None else np.vstack([looked, found])
        more = found >= PAYS
    run = run._replace(promises=looked)
    if not more.any():
        return run
    return run._replace(searches=(*run.searches, problem.tuner.begin(run.lead.best_z, run.moving | more)))


def _known(problem: TuningProblem, run: Run, reason: str) -> tuple[Run, str]:
    """The run with the best gains that are known in the lead, where no search came to anything, and a word on it.

    Those that a later round began with; in the first round the best gain set of the screening.

    Raises:
        RuntimeError: there was no screening.
    """
    if run.round:
        z = run.lead.best_z
        excess, goal = problem.tuner.objective.ranks(problem.tuner.cost_of(*problem.tuner.judged(z))[1])
        said = f"round {run.round}, with the worst scenarios added, made no progress: no gradient was usable"
        stopped = f"{said}; the gains are those of the previous round"
    elif run.screened is None:
        raise RuntimeError(reason)
    else:
        (excess, goal), z = run.screened.ranks[0], run.screened.places[0]
        tried = f"no gradient was usable from any of {len(run.searches)} starting points"
        stopped = f"{tried}: these are the best of {run.screened.looked} gain sets; tune.optimizer = cma needs none"
    leader = run.lead._replace(best_z=z, best=(float(excess), float(goal)))
    return run._replace(searches=tuple(leader if p is run.lead else p for p in run.searches)), stopped


def _again(before: Outcome) -> tuple[TuningProblem, Run]:
    """The problem with the worst scenarios added, and its run, from the gains that did not stand them."""
    run, worse = before.run, [f.scenario for f in before.found if f.metric in before.worse]
    added = {name: np.stack([scenario[name] for scenario in worse]) for name in before.problem.tuner.batch.names}
    if run.added:
        added = {name: np.concatenate([run.added[name], value]) for name, value in added.items()}
    problem = with_added(before.problem, added)
    searches = (problem.tuner.begin(run.lead.best_z, run.moving),)
    past = tuple(run.history)
    return problem, Run(run.round + 1, searches, added, before.rounds, past, run.screened, run.tightened, run.promises)
