"""Where to begin: many gain sets looked at, in few scenarios each, then in more of them for the better sets.

A gradient says how to walk downhill and not into which valley: from gains far off a search may end where nothing is
steered. Looking costs little, since a thousand runs share one compiled program. The sets are Sobol points about the
configured gains, in the coordinates that the search moves in; the better ones stay and are given more of the ensemble
(successive halving: Jamieson and Talwalkar, Non-stochastic best arm identification, 2016). Horizon and step stay the
same for all: another one would be compiled for longer than it saves.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..ensemble.sobol import sobol
from .methods.objective import Objective, Score
from .tuner import Tuner

FEW = 8  # scenarios of the ensemble that every set is given first
SHARE = 4  # one set in so many stays, and is given so many times the scenarios
KEPT = 16  # sets, at least, that are given the whole ensemble
LANES = 1024  # runs at a time, so that one compilation serves any number
REACHES = (1, 3, 6)  # a third of the sets each, as powers of `tune.spread`: 3, 27 and 729 times, either way
NEARER = (0.1, 0.3, 1)  # the same about gains that were tuned already
APART = 0.7  # between places to begin at, in the coordinates: one gain about twice as large


class Screened(NamedTuple):
    """What was seen of many gain sets."""

    places: np.ndarray  # (N, K), coordinates of those that were given the whole ensemble, the best first
    ranks: np.ndarray  # (N, 2), of each the sum of its limits' excesses and the goal, compared in this order
    unit: np.ndarray  # (K,), where the gains are whose statistics goals and limits are multiples of
    looked: int  # gain sets in all
    lost: int  # those of which every run diverged
    rollouts: int  # of the whole ensemble, rounded up

    def after(self, first: Screened) -> Screened:
        """This look, with the price of the looks before it and the unit of the first."""
        looked, lost, rollouts = self.looked + first.looked, self.lost + first.lost, self.rollouts + first.rollouts
        return self._replace(unit=first.unit, looked=looked, lost=lost, rollouts=rollouts)

    def joined(self, places: np.ndarray, ranks: np.ndarray) -> Screened:
        """This look and further gain sets (N, K) that were given the whole ensemble, with their ranks (N, 2)."""
        places, ranks = np.concatenate([self.places, places]), np.concatenate([self.ranks, ranks])
        order, more = np.lexsort((ranks[:, 1], ranks[:, 0])), len(places) - len(self.places)
        lost = self.lost + int(np.isinf(ranks[len(self.ranks) :, 1]).sum())
        price = {"looked": self.looked + more, "lost": lost, "rollouts": self.rollouts + more}
        return self._replace(places=places[order], ranks=ranks[order], **price)

    def apart(self, count: int) -> np.ndarray:
        """The best places that lie apart, at least one and at most so many, (S, K)."""
        chosen = [0]
        for i in range(1, len(self.places)):
            gaps = np.abs(self.places[chosen] - self.places[i]).max(axis=1)
            if len(chosen) < count and np.all(gaps > APART) and np.isfinite(self.ranks[i, 1]):
                chosen.append(i)
        return self.places[chosen]


@dataclasses.dataclass(frozen=True)
class Screen:
    """A look at many gain sets.

    Attributes:
        tuner: the problem.
        size: scenarios of its ensemble, without the places that are kept for others.
        seed: of the Sobol points.
        compiled: `tuner.values` of `LANES` runs, each with gains and a scenario of its own, compiled before.
        moved: names of the gains that the sets differ in; None: all that are tuned.
    """

    tuner: Tuner
    size: int
    seed: int = 0
    compiled: Callable[..., tuple[Array, Array]] | None = None
    moved: tuple[str, ...] | None = None

    def points(self, about: np.ndarray | None = None) -> np.ndarray:
        """The gain sets (N, K): the configured gains, then Sobol points about them, near and far by turns.

        With tuned gains `about` (K,): the configured ones, these, and points about these, nearer.
        """
        count, spread = self.tuner.settings.screen, self.tuner.settings.spread
        middle = np.asarray(self.tuner.gains.coordinates(self.tuner.controller))
        reaches, begin = (REACHES, middle[None]) if about is None else (NEARER, np.stack([middle, about]))
        names, sides = self.tuner.gains.names, np.zeros((count, middle.size))
        moves = [i for i, name in enumerate(names) if self.moved is None or name in self.moved]
        sides[:, moves] = 2 * sobol(count, len(moves), self.seed) - 1
        reach = np.log(spread) * np.array(reaches)[np.arange(count) % len(reaches)]
        return np.vstack([begin, begin[-1] + reach[:, None] * sides])

    def example(self) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Arguments of the right shapes for `compiled`."""
        zeros = np.zeros(LANES, int)
        return self.points()[zeros], {name: x[zeros] for name, x in self.tuner.scenarios().items()}

    def look(
        self,
        tick: Callable[[int, int], None] = lambda runs, sets: None,
        about: np.ndarray | None = None,
        added: int = 0,
    ) -> Screened:
        """Look at them all.

        Args:
            tick: told after every bundle how many runs it held, and how many gain sets are still looked at.
            about: gains (K,) to look about; None: the configured ones.
            added: scenarios beyond those of the ensemble, which every set is given first; no mean counts them.

        Raises:
            RuntimeError: every run of every set diverges, or what goals or limits are multiples of is 0.
        """
        points, few = self.points(about), min(FEW, self.size)
        scenarios = np.r_[self.size + np.arange(added), np.arange(self.size)]
        weights = np.r_[np.zeros(added), np.ones(self.size)] if added else None
        values, ok = self._runs(points, scenarios[: added + few], tick)
        runs, lost = ok.size, int(np.sum(~ok.any(axis=1)))
        unit = 0 if ok[0].any() else _soundest(self.tuner.objective, values, ok)
        kept, place = np.arange(len(points)), unit  # sets still looked at, and which of them is the unit
        while True:
            excess, goal = self._ranks(values, ok, place, None if weights is None else weights[: added + few])
            order = np.lexsort((goal, excess))
            if few == self.size:
                break
            stay = np.unique(np.r_[0, place, order[: max(KEPT, len(kept) // SHARE)]])
            old, few = few, min(SHARE * few, self.size)
            kept, place = kept[stay], int(np.searchsorted(stay, place))
            further = self._runs(points[kept], scenarios[added + old : added + few], tick)
            runs += further[1].size
            values, ok = (
                np.concatenate([old[stay], new], axis=-1) for old, new in zip((values, ok), further, strict=True)
            )
        ranks = np.column_stack([excess, goal])[order]
        return Screened(points[kept[order]], ranks, points[unit], len(points), lost, -(-runs // self.size))

    def _runs(
        self, points: np.ndarray, which: np.ndarray, tick: Callable[[int, int], None]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Metrics (N, M, B) and ok (N, B) of every set in some scenarios of the ensemble."""
        scenarios = self.tuner.scenarios()
        roll = self.tuner.with_loops(self.compiled) if self.compiled else self.tuner.roll
        sets, runs = np.repeat(np.arange(len(points)), len(which)), np.tile(which, len(points))
        values, ok = [], []
        for i in range(0, len(sets), LANES):
            at = np.minimum(np.arange(i, i + LANES), len(sets) - 1)  # the last is repeated
            bundle = roll(jnp.asarray(points[sets[at]]), {name: x[runs[at]] for name, x in scenarios.items()})
            count = min(LANES, len(sets) - i)
            values.append(np.asarray(bundle[0])[:, :count])
            ok.append(np.asarray(bundle[1])[:count])
            tick(count, len(points))
        table = np.concatenate(values, axis=1).reshape(-1, len(points), len(which))
        return table.transpose(1, 0, 2), np.concatenate(ok).reshape(len(points), len(which))

    def _ranks(
        self, values: np.ndarray, ok: np.ndarray, unit: int, weights: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Sums of excesses (N,) and goals (N,), in multiples of those of one set in the same scenarios."""
        objective, budget = self.tuner.objective._replace(weights=weights), self.tuner.budget
        baseline = objective.baseline(jnp.asarray(values[unit]), jnp.asarray(ok[unit])) if budget is None else budget
        score = jax.jit(jax.vmap(lambda values, ok: objective.score(values, ok, baseline)))
        return _compared(objective, score(jnp.asarray(values), jnp.asarray(ok)), ok)

    def scores(
        self, points: np.ndarray, tick: Callable[[int, int], None] = lambda runs, sets: None
    ) -> tuple[Score, np.ndarray, np.ndarray]:
        """What gain sets (N, K) are worth in the whole ensemble: scores, sums of excesses (N,) and goals (N,)."""
        values, ok = self._runs(points, np.arange(self.size), tick)
        score = self.tuner.score_all(jnp.asarray(values), jnp.asarray(ok))
        return score, *_compared(self.tuner.objective, score, ok)


def _compared(objective: Objective, score: Score, ok: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """By what gain sets are compared: sums of excesses (N,) and goals (N,)."""
    excess, goal = objective.ranks(score)
    nothing = ~ok.any(axis=1)  # sets that lose every run are alike, and last
    return np.where(nothing, np.inf, excess), np.where(nothing, np.inf, goal)


def _soundest(objective: Objective, values: np.ndarray, ok: np.ndarray) -> int:
    """The set with the fewest runs that diverge, and of these the smallest goals; where those of the start all do."""
    if not ok.any():
        raise RuntimeError(
            f"every run diverges, with the starting gains and with {len(ok) - 1} other gain sets: nothing to tune from"
        )
    goals = [objective.names.index(goal.metric) for goal in objective.goals]
    means = np.array(
        [
            np.mean(v[goals][:, o], axis=1) if o.any() else np.full(len(goals), np.inf)
            for v, o in zip(values, ok, strict=True)
        ]
    )
    sizes = np.sum(means / np.median(means[ok.any(axis=1)], axis=0), axis=1)
    return int(np.lexsort((sizes, -ok.sum(axis=1)))[0])
