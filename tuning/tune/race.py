"""Where the first search came to little: searches from other places, of which the better go on, then populations.

All is told from the run alone, so that one that is resumed goes the same way.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from . import populations
from .problem import TuningProblem
from .screen import Screen, Screened
from .tuner import Progress

if TYPE_CHECKING:
    from .rounds import Run

PLACES, FEWER = 16, 6  # far apart are tried, of a later round's look; and of a further look, which has tried many
RUNGS = (3, 6, 10, 15)  # iterations after which the better half of these goes on, and two to the end
LITTLE = 0.1  # share of the goal: a search that gains no more over gain sets thrown at random has hardly got anywhere


def advanced(problem: TuningProblem, run: Run) -> Run | None:
    """The run with one more iteration of every search that goes on; None where none does."""
    on, searches = _going(problem, run), list(run.searches)
    if not any(on):
        return None
    if len(searches) == problem.config.tune.starts:  # in one batch
        return run._replace(searches=tuple(problem.tuner.advance_all(searches)))
    some = [i for i, g in enumerate(on) if g]
    if problem.screen is not None and populations.drawn(searches[some[0]]):  # these go on by themselves
        screen = dataclasses.replace(problem.screen, tuner=problem.tuner)
        after = populations.advance(screen, [searches[i] for i in some])
    else:
        after = [problem.tuner.advance(searches[i]) for i in some]
    for i, p in zip(some, after, strict=True):
        searches[i] = p
    return run._replace(searches=tuple(searches))


def _going(problem: TuningProblem, run: Run) -> list[bool]:
    """Which searches go on: of those from further places the better half after each rung (successive halving).

    What begins after these, with further gains let go or tighter bounds, goes on alone.
    """
    on = [not (populations.finished(p) if populations.drawn(p) else problem.tuner.finished(p)) for p in run.searches]
    rows = [i for i, p in enumerate(run.searches) if populations.drawn(p)]
    if run.turns or run.tightened is not None or (rows and not populations.drawn(run.searches[-1])):
        return [*([False] * (len(on) - 1)), on[-1]]
    if rows:
        on = [g and i in rows for i, g in enumerate(on)]
        return _better(run, on, rows, populations.RUNGS, 1)
    return _better(run, on, list(_raced(problem, run)), RUNGS, 2)


def _better(run: Run, on: list[bool], racing: list[int], rungs: tuple[int, ...], fewest: int) -> list[bool]:
    """Of the searches that race those that go on: all up to a rung, the better half beyond."""
    left = racing
    for rung in rungs if len(left) > fewest else ():
        late = {i for i in left if on[i] and run.searches[i].iteration < rung}
        if late:
            return [g and (i not in left or i in late) for i, g in enumerate(on)]
        left = sorted(left, key=lambda i: populations.rank_at(run.searches[i], rung))
        stay = max(fewest, -(-len(left) // 2))
        on = [g and i not in left[stay:] for i, g in enumerate(on)]
        left = left[:stay]
    return on


def _raced(problem: TuningProblem, run: Run) -> range:
    """The searches that race: those from further places of the screening."""
    return range(problem.config.tune.starts if not run.round else 1, len(run.searches))


def hard(problem: TuningProblem, run: Run) -> bool:
    """Whether the first searches gained little, or others had to follow."""
    first = run.searches[: problem.config.tune.starts]
    return len(run.searches) > len(first) or _gained(run.lead) < LITTLE


def _gained(lead: Progress) -> float:
    """The share by which a search lowered the goal; 1 where it began outside the limits and ended within."""
    first, best = populations.rank_at(lead, 1), lead.best
    return float(first[0] > best[0]) if first[0] != best[0] else 1 - best[1] / first[1]


def elsewhere(problem: TuningProblem, run: Run, looking: Callable[[int, int], None]) -> Run | None:
    """The run with searches from places of a further look, then with populations, then along slopes again.

    None where no other is worth it. After the first round the places are those of another look, about the gains that
    the round began with, and no population is drawn.
    """
    seen, searches = run.screened, run.searches
    if seen is None or problem.screen is None:
        return None
    screen = dataclasses.replace(problem.screen, tuner=problem.tuner)
    looked_further = seen.looked > 1 + screen.tuner.settings.screen
    if not run.round and (populations.drawn(searches[-1]) or looked_further):
        return _populations(run, seen, screen)
    if not run.round:
        begun, seen = seen.apart(problem.config.tune.starts), populations.further(screen, seen, run.moving, looking)
        places = [z for z in seen.apart(FEWER) if not (z == begun).all(axis=1).any()]
    elif len(searches) == 1:
        count = len(next(iter(run.added.values())))
        seen = screen.look(looking, np.asarray(searches[0].sound_z), count).after(seen)
        places = seen.apart(PLACES)
    else:
        return None
    further = (problem.tuner.begin(z, run.moving) for z in places)
    return run._replace(screened=seen, searches=(*searches, *further))


def _populations(run: Run, seen: Screened, screen: Screen) -> Run | None:
    """The run with populations; then with a search along slopes from their best, if that is the best so far."""
    moving = run.moving
    if not any(populations.drawn(p) for p in run.searches):
        best = np.asarray(run.lead.best_z if np.isfinite(run.lead.best[1]) else seen.places[0])
        further = [populations.begin(screen.tuner, z, moving) for z in populations.again(seen, best)]
    elif populations.drawn(run.searches[-1]) and populations.drawn(run.lead):
        further = [screen.tuner.begin(run.lead.best_z, moving)]
    else:
        return None
    return run._replace(searches=(*run.searches, *further))
