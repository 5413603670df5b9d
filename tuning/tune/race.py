"""Where the first search came to little: searches from other places, of which the better go on, then populations.

Where it came far and yet ended where slopes promise more than any step kept, as they do of a law that chatters and
where grip breaks away: a population and slopes by turns, each from where the other ended.

All is told from the run alone, so that one that is resumed goes the same way.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from . import populations
from .methods import sqp
from .problem import TuningProblem
from .screen import Screen, Screened
from .tuner import Progress

if TYPE_CHECKING:
    from .rounds import Run

PLACES, FEWER = 16, 6  # far apart are tried, of a later round's look; and of a further look, which has tried many
RUNGS = (3, 6, 10, 15)  # iterations after which the better half of these goes on, and two to the end
LITTLE = 0.1  # share of the goal: a search that gains no more over gain sets thrown at random has hardly got anywhere
STEADY = 0.005  # share of the cost that slopes may still promise, see `sqp.promise`, where a search has ended
SLIGHT, IDLE = 0.005, 2  # share of the goal: so many turns in a row that gain no more are the last
DEAREST = 90  # runs a screened gain set that all may cost so that a turn begins, with its longest population
ASIDE = 0.1  # in the coordinates: how far a population begins from the best, so that no two draw the same sets


def advanced(problem: TuningProblem, run: Run) -> Run | None:
    """The run with one more iteration of every search that goes on; None where none does."""
    on, searches = _going(problem, run), list(run.searches)
    if not any(on):
        return None
    if len(searches) == firsts(problem, run):  # in one batch
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
    rows = _last_drawn(run)
    if run.turns or run.tightened is not None or (not rows and any(populations.drawn(p) for p in run.searches)):
        return [*([False] * (len(on) - 1)), on[-1]]
    if rows:
        on = [g and i in rows for i, g in enumerate(on)]
        return _better(run, on, rows, populations.RUNGS, 1)
    return _better(run, on, list(_raced(problem, run)), RUNGS, 2)


def _last_drawn(run: Run) -> list[int]:
    """The populations that were begun last; none where slopes followed."""
    count = len(run.searches)
    while count and populations.drawn(run.searches[count - 1]):
        count -= 1
    return list(range(count, len(run.searches)))


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
    return range(firsts(problem, run), len(run.searches))


def firsts(problem: TuningProblem, run: Run) -> int:
    """How many searches a round begins with: one after the first; there one a place, which may be fewer than asked."""
    return 1 if run.round else run.first or problem.config.tune.starts


def hard(problem: TuningProblem, run: Run) -> bool:
    """Whether the first searches gained little, ended where slopes promise more, or others had to follow."""
    return len(run.searches) > firsts(problem, run) or _gained(run.lead) < LITTLE or _promises(problem, run.lead)


def _promises(problem: TuningProblem, lead: Progress) -> bool:
    """Whether a search has ended where its slopes promise more than any step kept; not by its number of iterations."""
    if np.isinf(lead.best[1]) or not problem.tuner.method.converged(lead.optimiser):
        return False
    return sqp.promise(lead.optimiser, problem.tuner.objective, problem.tuner.baseline) > STEADY


def _gained(lead: Progress) -> float:
    """The share by which a search lowered the goal; 1 where it began outside the limits and ended within."""
    first, best = populations.rank_at(lead, 1), lead.best
    return float(first[0] > best[0]) if first[0] != best[0] else 1 - best[1] / first[1]


def elsewhere(problem: TuningProblem, run: Run, looking: Callable[[int, int], None]) -> Run | None:
    """The run with searches from places of a further look, then with populations, then along slopes again.

    None where no other is worth it. Where the first searches came far, see `_by_turns`. After the first round the
    places are those of another look, about the gains that the round began with, and no population is drawn.
    """
    seen, searches = run.screened, run.searches
    if seen is None or problem.screen is None:
        return None
    screen = dataclasses.replace(problem.screen, tuner=problem.tuner)
    first = searches[: firsts(problem, run)]
    if not run.round and _gained(min(first, key=lambda p: p.best)) >= LITTLE:
        return _by_turns(run, screen, len(first))
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


def _by_turns(run: Run, screen: Screen, first: int) -> Run | None:
    """The run with a population from near the best so far, or with slopes from the best of the last population.

    None after turns that gained little, and where enough was spent.
    """
    searches, tuner = run.searches, screen.tuner
    if populations.drawn(searches[-1]):
        return run._replace(searches=(*searches, tuner.begin(searches[-1].best_z, run.moving)))
    turns = (len(searches) - first) // 2
    if turns >= IDLE:
        before, now = min(p.best for p in searches[: -2 * IDLE]), run.lead.best
        if before[0] == now[0] and now[1] > (1 - SLIGHT) * before[1]:
            return None
    rollouts = run.total("rollouts") + populations.MOST * populations.SIZE
    if rollouts * screen.size > DEAREST * tuner.settings.screen:
        return None
    begin = np.array(run.lead.best_z)
    begin[run.moving] += ASIDE * np.random.default_rng([screen.seed, turns]).standard_normal(int(run.moving.sum()))
    return run._replace(searches=(*searches, populations.begin(tuner, begin, run.moving)))
