"""Where the first search came to little: searches from other places, of which the better go on, and further looks.

All is told from the run alone, so that one that is resumed goes the same way.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from .methods.objective import FEASIBLE
from .problem import TuningProblem
from .screen import Screen, Screened
from .tuner import HISTORY, Progress

if TYPE_CHECKING:
    from .rounds import Run

PLACES = 16  # of the screening are tried where gradients are of no use or gain little
LOOKS = 3  # more looks, about the best so far, where the places came to little too
RUNGS = (3, 6, 10, 15)  # iterations after which the better half of these goes on, and two to the end
MUCH = 0.01  # share of the goal, for which another look is worth its price
LITTLE = 0.05  # share of the goal: a search that gains no more over gain sets thrown at random has hardly got anywhere


def advanced(problem: TuningProblem, run: Run) -> Run | None:
    """The run with one more iteration of every search that goes on; None where none does."""
    on, searches = _going(problem, run), list(run.searches)
    if not any(on):
        return None
    if len(searches) == problem.config.tune.starts:  # in one batch
        return run._replace(searches=tuple(problem.tuner.advance_all(searches)))
    after = (problem.tuner.advance(p) if g else p for p, g in zip(searches, on, strict=True))
    return run._replace(searches=tuple(after))


def _going(problem: TuningProblem, run: Run) -> list[bool]:
    """Which searches go on: of those from further places the better half after each rung (successive halving).

    What begins after these, at a place looked for later, with further gains let go or tighter bounds, goes on alone.
    """
    on = [not problem.tuner.finished(p) for p in run.searches]
    if run.turns or run.tightened is not None or _looks(problem, run):
        return [*([False] * (len(on) - 1)), on[-1]]
    left = list(_raced(problem, run))
    for rung in RUNGS if len(left) > 2 else ():
        late = {i for i in left if on[i] and run.searches[i].iteration < rung}
        if late:
            return [g and (i not in left or i in late) for i, g in enumerate(on)]
        left.sort(key=lambda i: _rank_at(run.searches[i], rung))
        stay = max(2, -(-len(left) // 2))
        on = [g and i not in left[stay:] for i, g in enumerate(on)]
        left = left[:stay]
    return on


def _raced(problem: TuningProblem, run: Run) -> range:
    """The searches that race: those from further places of the screening."""
    return range(problem.config.tune.starts if not run.round else 1, len(run.searches))


def _looks(problem: TuningProblem, run: Run) -> int:
    """How often more gain sets were looked at in the first round, after the first look."""
    first = problem.config.tune.screen + 1  # with the configured gains; a look about others has these besides
    return 0 if run.round or run.screened is None else (run.screened.looked - first) // (first + 1)


def _rank_at(search: Progress, iterations: int) -> tuple[float, float]:
    """The best sum of excesses and goal of the first iterations of a search."""
    excess, goal = HISTORY.index("excess"), HISTORY.index("goal")
    rows = [row for row in search.history[:iterations] if np.isfinite(row[goal])]
    return min(((max(row[excess] - FEASIBLE, 0.0), row[goal]) for row in rows), default=(np.inf, np.inf))


def hard(problem: TuningProblem, run: Run) -> bool:
    """Whether the first searches gained little, or others had to follow and the last of these gained anything much."""
    first = run.searches[: problem.config.tune.starts]
    if not _looks(problem, run):
        return len(run.searches) > len(first) or _gained(run.lead) < LITTLE
    (excess, goal), last = min(p.best for p in run.searches[:-1]), run.searches[-1].best
    return last[0] < excess or (last[0] == excess and last[1] < (1 - MUCH) * goal)


def _gained(lead: Progress) -> float:
    """The share by which a search lowered the goal; 1 where it began outside the limits and ended within."""
    first, best = _rank_at(lead, 1), lead.best
    return float(first[0] > best[0]) if first[0] != best[0] else 1 - best[1] / first[1]


def elsewhere(problem: TuningProblem, run: Run, looking: Callable[[int, int], None]) -> Run | None:
    """The run with searches from the further places of the screening; None where no other is worth it.

    After the first round the places are those of another look, about the gains that the round began with.
    """
    seen, searches = run.screened, run.searches
    if seen is None or problem.screen is None:
        return None
    screen = dataclasses.replace(problem.screen, tuner=problem.tuner)
    if not run.round and (_looks(problem, run) or len(searches) >= len(seen.apart(PLACES))):
        return _about_the_best(problem, run, seen, screen, looking)
    if run.round and len(searches) == 1:
        count = len(next(iter(run.added.values())))
        seen = screen.look(looking, np.asarray(searches[0].sound_z), count).after(seen)
    places = seen.apart(PLACES)
    done = len(searches) - bool(run.round)  # the first search of a later round is at a place of its own
    if len(places) <= done:
        return None
    further = (problem.tuner.begin(z, run.moving) for z in places[done:])
    return run._replace(screened=seen, searches=(*searches, *further))


def _about_the_best(
    problem: TuningProblem, run: Run, seen: Screened, screen: Screen, looking: Callable[[int, int], None]
) -> Run | None:
    """The run with a search from the best of another look, about the best gains so far; None after `LOOKS` of them."""
    if _looks(problem, run) >= LOOKS:
        return None
    about = run.lead.best_z if np.isfinite(run.lead.best[1]) else seen.places[0]
    seen = screen.look(looking, np.asarray(about)).after(seen)
    return run._replace(screened=seen, searches=(*run.searches, problem.tuner.begin(seen.places[0], run.moving)))
