"""Where slopes came to little: CMA-ES from two places, of which the better goes on, all sets looked at in one call.

Before that, populations as wide as the screening look further: a narrow valley that random sets hardly hit is found on
their way, and left again where more of the sets lie in a wide one. So their sets are places to begin at.

Slopes lead down from one place, and where a cost is rugged, chattering or a narrow valley they end early. Populations
of gain sets about places of their own (`methods.cma`) need none: one is drawn about the best so far, one about the best
set seen that lies apart from it. Sets are compared as everywhere: the sum of excesses first, then the goal.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from ..config.settings import Tune
from ..ensemble.sobol import sobol
from .methods.method import Progress
from .methods.objective import FEASIBLE, Objective, Score
from .screen import APART, Screen, Screened
from .tuner import HISTORY, Tuner

if TYPE_CHECKING:
    from .methods.cma import Cma, State

POPULATIONS, WIDE, CLOSING = 4, 64, 6  # that look further, sets in each, and generations
REACH = 2  # of their places and sets, as a power of `tune.spread`: 9 times, either way
SIZE, MOST = 16, 48  # sets in a population that goes on, and generations
RUNGS = (6,)  # generations after which the better half of the populations goes on
PATIENCE, LITTLE = 20, 0.01  # generations in which a population must gain so much, as a share of its goal


class Drawn(NamedTuple):
    """The state of such a search."""

    strategy: State  # over the gains that move


def drawn(search: Progress) -> bool:
    """Whether a search is such a one."""
    return isinstance(search.optimiser, Drawn)


@functools.cache
def _method(most: int = MOST, size: int = SIZE, spread: float | None = None) -> Cma:
    """CMA-ES as it is asked and told here; costs are places in the ranking."""
    from .methods.cma import Cma  # late: nobody waits for pycma who does not need it

    options = {"popsize": size} | ({} if spread is None else {"sigma": spread})
    return Cma(Tune(iterations=most, options=options), Objective(), lambda scenarios: jnp.sum)


def further(screen: Screen, seen: Screened, moving: np.ndarray, tick: Callable[[int, int], None]) -> Screened:
    """A look with that of wide populations, about its best set and places of their own."""
    method, found = _method(CLOSING, WIDE, REACH * float(np.log(screen.tuner.settings.spread))), []
    for about in places(screen, seen.places[0], moving):
        state = method.begin(jnp.asarray(about[moving]), 0)
        for _ in range(CLOSING):
            sets = np.tile(about, (WIDE, 1))
            sets[:, moving] = method.ask(state)
            _, excess, goal = screen.scores(sets, tick)
            state = method.told(state, np.argsort(np.lexsort((goal, excess))).astype(float))
            found.append((sets, np.column_stack([excess, goal])))
    return seen.joined(*(np.concatenate(x) for x in zip(*found, strict=True)))


def again(seen: Screened, best: np.ndarray) -> list[np.ndarray]:
    """Where populations begin that go on (K,): the best so far, and the best set seen that lies apart from it."""
    away = (np.abs(seen.places - best).max(axis=1) > APART) & np.isfinite(seen.ranks[:, 1])
    return [best, *seen.places[away][:1]]


def state(begin: np.ndarray) -> Drawn:
    """Before the first generation about a mean (K,) of the gains that move."""
    return Drawn(_method().begin(jnp.asarray(begin), 0))


def places(screen: Screen, best: np.ndarray, moving: np.ndarray) -> list[np.ndarray]:
    """Where populations look further (K,): about the best so far, and Sobol points about the configured gains."""
    tuner = screen.tuner
    middle, reach = np.asarray(tuner.gains.coordinates(tuner.controller)), REACH * np.log(tuner.settings.spread)
    sides = 2 * sobol(POPULATIONS - 1, int(moving.sum()), screen.seed + 1) - 1
    further = np.tile(middle, (POPULATIONS - 1, 1))
    further[:, moving] += reach * sides
    return [best, *further]


def begin(tuner: Tuner, z: ArrayLike, moving: np.ndarray) -> Progress:
    """A population about gains (K,)."""
    return tuner.begin(jnp.asarray(z), moving)._replace(optimiser=state(np.asarray(z)[moving]))


def advance(screen: Screen, searches: list[Progress]) -> list[Progress]:
    """One more generation of each."""
    sets = [np.tile(np.asarray(p.z, float), (SIZE, 1)) for p in searches]
    for points, p in zip(sets, searches, strict=True):
        points[:, p.moving] = _method().ask(p.optimiser.strategy)
    score, excess, goal = screen.scores(np.concatenate(sets))
    after = []
    for i, (points, p) in enumerate(zip(sets, searches, strict=True)):
        part = slice(i * SIZE, (i + 1) * SIZE)
        after.append(_told(screen.tuner, p, points, Score(*(x[part] for x in score)), excess[part], goal[part]))
    return after


def _told(
    tuner: Tuner, p: Progress, points: np.ndarray, score: Score, excess: np.ndarray, goal: np.ndarray
) -> Progress:
    """A search that knows what its sets (SIZE, K) are worth."""
    order = np.lexsort((goal, excess))
    best, z = order[0], jnp.asarray(points[order[0]], p.z.dtype)
    rank = (float(excess[best]), float(goal[best]))
    better, rollouts = rank < p.best, p.rollouts + SIZE
    row = (p.iteration, *(float(x[best]) for x in score[:4]), 0.0, p.clipped, p.backed_out, rollouts)
    return p._replace(
        iteration=p.iteration + 1,
        z=z,
        optimiser=Drawn(_method().told(p.optimiser.strategy, np.argsort(order).astype(float))),
        sound_z=z,
        best_z=z if better else p.best_z,
        best=rank if better else p.best,
        best_iteration=p.iteration if better else p.best_iteration,
        rollouts=rollouts,
        history=[*p.history, (*row, *tuner.gains.values(z, tuner.controller))],
    )


def finished(p: Progress) -> bool:
    """All generations done, sets that hardly differ, or little gained for a while."""
    if p.iteration >= MOST or _method().converged(p.optimiser.strategy):
        return True
    before, now = rank_at(p, p.iteration - PATIENCE), rank_at(p, p.iteration)
    return p.iteration > PATIENCE and before[0] == now[0] and now[1] > (1 - LITTLE) * before[1]


def generation(searches: Sequence[Progress]) -> int:
    """How many generations there were so far."""
    return max((p.iteration for p in searches if drawn(p)), default=0)


def rank_at(search: Progress, iterations: int) -> tuple[float, float]:
    """The best sum of excesses and goal of the first iterations of a search."""
    excess, goal = HISTORY.index("excess"), HISTORY.index("goal")
    rows = [row for row in search.history[:iterations] if np.isfinite(row[goal])]
    return min(((max(row[excess] - FEASIBLE, 0.0), row[goal]) for row in rows), default=(np.inf, np.inf))
