"""The worst scenario of a box, by gradient ascent from several starts; samples say where to start and what to beat."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

import agvjax
from agvjax.leaves import get

from ..compute.processes import gathered
from .draws import Draw, sample

if TYPE_CHECKING:
    from ..config.settings import Search

TENTH = 10  # of the samples may begin an ascent
SCOUTS, CHECKS = 1, 2  # parts of the random numbers, besides the ensemble's own
CHUNK = 128  # scenarios looked at together, so that one compilation serves any number
FIRST, LEAST, MOST = 0.25, 1e-3, 0.5  # steps of the ascent, as shares of the box
GROW, SHRINK = 1.2, 0.5  # of a step whose slope kept its sign, or turned


class Found(NamedTuple):
    """The worst scenario of one metric that was found."""

    metric: str
    value: float  # infinite: the run diverges
    scenario: dict[str, np.ndarray]  # its leaves that vary
    searches: int
    samples: int
    rollouts: int  # of single scenarios; a gradient counts 1 + its tangents


class Box(NamedTuple):
    """The leaves that are drawn, as one vector of shares of their ranges; flat, in the order of their names."""

    names: tuple[str, ...]
    shapes: tuple[tuple[int, ...], ...]
    low: np.ndarray  # (D,)
    high: np.ndarray  # (D,)
    mix: np.ndarray  # (D, D), how the sides make the leaves; the identity but for leaves that are drawn together
    moves: np.ndarray  # (D,), False where only some values are allowed

    @classmethod
    def of(cls, scenario: PyTree, draws: Mapping[str, Draw]) -> Box:
        """The box of an ensemble's draws."""
        nominal = {name: np.asarray(get(scenario, name), float) for name in sorted(draws)}
        ends = [draws[name].box(value) for name, value in nominal.items()]
        low, high = (np.concatenate([np.ravel(end[side]) for end in ends]) for side in (0, 1))
        moves = np.concatenate([np.full(x.size, draws[name].moves) for name, x in nominal.items()])
        shapes = tuple(x.shape for x in nominal.values())
        return cls(tuple(nominal), shapes, low, high, _mix(nominal, draws), moves)

    def leaves(self, shares: Float[Array, "B D"]) -> dict[str, Array]:
        """Leaves of B scenarios."""
        low, high = (jnp.asarray(x, shares.dtype)[None] for x in (self.low, self.high))
        plain = np.array_equal(self.mix, np.eye(len(self.mix)))
        mixed = shares if plain else 0.5 + (shares - 0.5) @ jnp.asarray(self.mix.T, shares.dtype)
        flat = low + mixed * (high - low)
        flat = flat if plain else jnp.clip(flat, low, high)  # the factors' box is longer than the leaves' at corners
        cuts = np.cumsum([int(np.prod(shape)) for shape in self.shapes])[:-1]
        parts = jnp.split(flat, cuts, axis=1)
        return {n: x.reshape(-1, *shape) for n, x, shape in zip(self.names, parts, self.shapes, strict=True)}

    def shares(self, leaves: Mapping[str, np.ndarray]) -> np.ndarray:
        """Where scenarios lie in the box, (B, D)."""
        size = len(next(iter(leaves.values())))
        flat = np.concatenate([np.asarray(leaves[name], float).reshape(size, -1) for name in self.names], axis=1)
        width = self.high - self.low
        places = np.where(width > 0, (flat - self.low) / np.where(width > 0, width, 1.0), 0.5)
        return 0.5 + np.linalg.solve(self.mix, (places - 0.5).T).T


class Rise(NamedTuple):
    """Rprop, upwards: each side has a step of its own that grows while its slope keeps its sign, and shrinks else.

    To the same numbers as `optax.rprop`, whose import takes as long as a whole ascent: it moves by the slope before the
    last one (Riedmiller and Braun, A direct adaptive method for faster backpropagation learning, 1993).
    """

    steps: np.ndarray  # (B, D)
    change: np.ndarray  # (B, D), the last one

    @classmethod
    def begin(cls, u: np.ndarray) -> Rise:
        """Before the first slope at u (B, D)."""
        return cls(np.full_like(u, FIRST), np.zeros_like(u))

    def step(self, slope: np.ndarray) -> tuple[np.ndarray, Rise]:
        """How far to move (B, D) after a slope (B, D), not at all where it turned, and the state."""
        kept, dtype = slope * self.change, self.steps.dtype.type
        scaled = np.clip(self.steps * np.where(kept > 0, dtype(GROW), dtype(SHRINK)), LEAST, MOST)
        steps = np.where(kept == 0, self.steps, scaled)
        change = np.where(kept < 0, dtype(0.0), steps * np.sign(slope))
        return np.where(kept < 0, dtype(0.0), self.change), Rise(steps, change)


def _mix(nominal: Mapping[str, np.ndarray], draws: Mapping[str, Draw]) -> np.ndarray:
    """The rows of the Cholesky factor of leaves that are drawn together, numbers all; unit rows of the others."""
    sizes = [x.size for x in nominal.values()]
    first, mix = dict(zip(nominal, np.cumsum([0, *sizes]), strict=False)), np.eye(sum(sizes))
    for name in nominal:
        partners = draws[name].partners(name)
        if len(partners) > 1:
            mix[first[name], [first[leaf] for leaf in partners]] = list(partners.values())
    return mix


@dataclasses.dataclass(frozen=True)
class Adversary:
    """Looks for the scenario that some gains handle worst, one search per metric and start."""

    rollout: Callable[..., tuple[Array, Array]]  # (z, leaves of B scenarios) -> metrics (M, B), ok (B,)
    names: tuple[str, ...]  # of the M metrics
    scenario: PyTree  # the nominal one
    draws: Mapping[str, Draw]
    metrics: tuple[str, ...]
    settings: Search  # how many samples, ascents and steps of them
    seed: int = 0
    compiled: tuple[Callable[..., PyTree], Callable[..., PyTree]] | None = None  # `climb` and `look`, compiled before

    @functools.cached_property
    def box(self) -> Box:
        """Where to look."""
        return Box.of(self.scenario, self.draws)

    def climb(self, z: PyTree, shares: Float[Array, "B D"]) -> tuple[Array, Array, Array]:
        """Values, ok and slopes (D, M, B) along every side of the box."""

        def along(side: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
            change = jnp.broadcast_to(side, shares.shape)
            return jax.jvp(lambda s: self.rollout(z, self.box.leaves(s)), (shares,), (change,))

        (values, ok), (slopes, _) = jax.vmap(along, out_axes=((None, None), (0, None)))(
            jnp.eye(self.box.low.size, dtype=shares.dtype)
        )
        return values, ok, jnp.where(ok, slopes, 0.0)

    def look(self, z: PyTree, leaves: Mapping[str, Array]) -> Array:
        """Values (M, B), those of diverged runs infinite."""
        values, ok = self.rollout(z, leaves)
        return jnp.where(ok, values, jnp.inf)

    @functools.cached_property
    def functions(self) -> tuple[Callable[..., PyTree], Callable[..., PyTree]]:
        """`climb` and `look`, jitted."""
        return self.compiled or (gathered(jax.jit(self.climb)), gathered(jax.jit(self.look)))

    def examples(self) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Arguments of the right shapes, after z, for `climb` and for `look`."""
        return np.zeros((len(self.metrics) * self.settings.starts, self.box.low.size)), self._sampled(SCOUTS, CHUNK)

    def _values(self, z: PyTree, leaves: Mapping[str, np.ndarray]) -> np.ndarray:
        """`look` at any number of scenarios, a chunk at a time."""
        count, look = len(next(iter(leaves.values()))), self.functions[1]
        rows = [np.minimum(np.arange(i, i + CHUNK), count - 1) for i in range(0, count, CHUNK)]  # the last repeats one
        return np.concatenate([np.asarray(look(z, {n: x[r] for n, x in leaves.items()})) for r in rows], 1)[:, :count]

    def search(self, z: PyTree, round_: int = 0) -> list[Found]:
        """The worst scenario of each metric for the gains at z, by samples and ascents; other samples every round."""
        settings, rows = self.settings, [self.names.index(metric) for metric in self.metrics]
        lanes = np.repeat(np.arange(len(rows)), settings.starts)  # the metric of each ascent
        scouts = self._sampled(SCOUTS + 2 * round_, settings.scouts)
        seen, places = self._values(z, scouts)[rows], self.box.shares(scouts)  # (W, scouts), (scouts, D)
        begin = places[np.concatenate([_apart(places, values, settings.starts) for values in seen])]
        u, best = self._ascend(z, jnp.asarray(begin, jnp.result_type(float)), np.take(rows, lanes))
        ends = {name: np.asarray(x) for name, x in self.box.leaves(jnp.asarray(u)).items()}
        by_metric = np.where(lanes == np.arange(len(rows))[:, None], best, -np.inf)
        pools = [(by_metric, ends), (seen, scouts)]  # values (W, n) and leaves of n scenarios
        if settings.checks:
            checks = self._sampled(CHECKS + 2 * round_, settings.checks)
            pools.append((self._values(z, checks)[rows], checks))
        samples = settings.scouts + settings.checks
        rollouts = samples + settings.starts * settings.iterations * (1 + self.box.low.size)
        worst = []
        for w, metric in enumerate(self.metrics):
            values, leaves = max(pools, key=lambda pool: pool[0][w].max())
            i = int(np.argmax(values[w]))
            scenario = {name: x[i] for name, x in leaves.items()}
            worst.append(Found(metric, float(values[w, i]), scenario, settings.starts, samples, rollouts))
        return worst

    def _sampled(self, part: int, size: int) -> dict[str, np.ndarray]:
        drawn = sample(self.scenario, self.draws, size, self.seed, part)
        return {name: np.asarray(value) for name, value in drawn.values.items()}

    def _ascend(self, z: PyTree, u: Array, row: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Shares (B, D) and value (B,) of the worst on the way of every ascent.

        By `Rise`: corners and folds alike are reached in a dozen steps, whatever the metric's scale.
        """
        lanes, climb = np.arange(len(row)), self.functions[0]
        rise, best, at = Rise.begin(np.asarray(u)), np.full(len(row), -np.inf), np.asarray(u)
        for _ in range(self.settings.iterations):
            values, ok, slopes = climb(z, u)
            value = np.where(np.asarray(ok), np.asarray(values)[row, lanes], np.inf)
            higher = value > best
            best, at = np.where(higher, value, best), np.where(higher[:, None], np.asarray(u), at)
            slope = np.asarray(slopes)[:, row, lanes].T * self.box.moves
            change, rise = rise.step(slope)
            u = jnp.asarray(np.clip(np.asarray(u) + change, 0.0, 1.0))
        return at, best


def _apart(places: np.ndarray, values: np.ndarray, count: int) -> list[int]:
    """Where to start: the worst of the samples (S, D), then those of the worst tenth that lie furthest apart."""
    order = np.argsort(-values)[: max(count, len(values) // TENTH)]
    chosen = [int(order[0])]
    while len(chosen) < count:
        gaps = np.linalg.norm(places[order][:, None] - places[chosen][None], axis=2).min(axis=1)
        chosen.append(int(order[np.argmax(gaps)]))
    return chosen


def statement(found: Sequence[Found]) -> list[str]:
    """What may be said in the end, a sentence for each metric."""
    searched = "No scenario in this box was found with {} above {:.5g}, by {} searches and {} samples."
    diverged = "A scenario in this box was found that diverges ({})."
    return [
        searched.format(worst.metric, worst.value, worst.searches, worst.samples)
        if np.isfinite(worst.value)
        else diverged.format(worst.metric)
        for worst in found
    ]


def batch_of(batch: agvjax.Batch, added: Mapping[str, np.ndarray], slots: int) -> agvjax.Batch:
    """The ensemble with scenarios added, and up to `slots` places filled with copies of its first."""
    count = len(next(iter(added.values()))) if added else 0
    values = {}
    for name, value in batch.values.items():
        drawn = np.asarray(value)
        more = np.asarray(added[name], drawn.dtype) if count else drawn[:0]
        values[name] = np.concatenate([drawn, more, np.repeat(drawn[:1], slots - count, axis=0)])
    return agvjax.batch(batch.scenario, values)
