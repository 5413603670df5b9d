"""The search for gains: looks at an ensemble, steps, backs out of what diverges, keeps the best so far."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import agvjax
from agvjax.leaves import swap

from ..compute.processes import gathered, joined
from .gains import Free
from .methods import optax as first_order
from .methods import sqp
from .objective import Objective, Score

BLOCK, LEAST = 64, 16  # scenarios in a block and on a device: fewer than in a rollout, since each carries its tangents
MOST_FORWARD = 30  # gains up to which forward mode costs less than reverse mode; see benchmarks/gradient.py
TOLERANCE = 1e-3  # a limit counts as met up to a tenth of a percent
FEASIBLE = 5e-4  # while tuning up to half of it: the coarser step of tuning may be wrong by the other half
SEQUENTIAL = "sqp"  # an optimiser of our own, beside those of optax
HISTORY = ("iteration", "cost", "goal", "excess", "latched", "gradient_norm", "clipped", "backed_out", "rollouts")


class Progress(NamedTuple):
    """Everything a search needs to go on from where it stands."""

    iteration: int
    z: Any  # free coordinates
    optimiser: Any  # state of the optax chain, or of the sequential quadratic programme
    sound_z: Any  # where the last sound gradient was found
    best_z: Any
    best: tuple[float, float]  # (sum of excesses beyond tolerance, goal) of best_z, compared in this order
    best_iteration: int
    clipped: int  # gradients cut to the allowed norm so far
    backed_out: int  # iterations whose point was given up: no finite gradient, every run diverged, slopes of no use
    rollouts: int  # of the whole ensemble so far; a gradient counts 1 + its tangents
    history: list[tuple[float, ...]]  # a row an iteration: HISTORY, then the gains


class Look(NamedTuple):
    """What was seen at a point."""

    score: Score
    gradient: Any  # (K,)
    model: Any = None  # values (M, B), ok (B,), slopes (K, M, B), where the optimiser asks for them
    rank: Score | None = None  # by what to rank the point, where that is not the same ensemble


@dataclasses.dataclass(frozen=True)
class Tuner:
    """A tuning problem and how to solve it; the defaults are those that did best on the default problem."""

    controller: Any
    batch: agvjax.Batch
    free: Free
    objective: Objective = Objective()
    timing: agvjax.Timing = agvjax.Timing(dt=5e-3, n_steps=2400)
    iterations: int = 300
    optimizer: str = SEQUENTIAL
    learning_rate: float = 0.1
    options: dict[str, Any] = dataclasses.field(default_factory=dict)  # further arguments of the optax optimiser
    clip: float = 1.0
    patience: int = 100
    gradient: str = "auto"
    budget: Any = None  # (3, M), what the ratios are taken to; None for what the starting gains achieve
    fresh: Callable[[int], Mapping[str, Any]] | None = (
        None  # leaves of the scenarios of an iteration; None: the batch's
    )
    prepared: Callable[[Any, Any], tuple[Any, Any, Any]] | None = (
        None  # `jacobian` of this very problem, compiled before
    )

    @functools.cached_property
    def chain(self) -> Any:
        """The transformation of optax."""
        return first_order.chain(self.optimizer, self.options, self.learning_rate, self.iterations, self.clip)

    def values(self, z: Any, scenarios: Mapping[str, Any]) -> tuple[Any, Any]:
        """The metrics that matter of every scenario (M, B), and which runs are worth having (B,)."""
        batch = agvjax.Batch(scenario=swap(self.batch.scenario, scenarios), names=self.batch.names)
        metrics = agvjax.evaluate(
            self.free.controller(z, self.controller),
            batch,
            criteria=self.objective.criteria,
            dtype=z.dtype.type,
            block=BLOCK,
            devices=None if joined() else max(1, min(jax.local_device_count(), batch.size // LEAST)),
            **self.timing,
        )
        return self.objective.values(metrics)

    def jacobian(self, z: Any, scenarios: Mapping[str, Any]) -> tuple[Any, Any, Any]:
        """Values, ok and slopes (K, M, B) at z: one rollout carries all tangents, memory flat in the horizon."""
        along = jax.vmap(
            lambda v: jax.jvp(lambda z: self.values(z, scenarios), (z,), (v,)), out_axes=((None, None), (0, None))
        )
        (values, ok), (slopes, _) = along(jnp.eye(z.size, dtype=z.dtype))
        return values, ok, jnp.where(ok, slopes, 0.0)  # a run that diverged steers nothing

    @property
    def scenarios(self) -> dict[str, Any]:
        """The leaves that vary, as the arguments of what is compiled."""
        return {name: np.asarray(value) for name, value in self.batch.values.items()}

    @functools.cached_property
    def push(self) -> Callable[[Any, Any], tuple[Any, Any, Any]]:
        """`jacobian`, jitted; what it returns is on one device, however many took part."""
        return self.prepared or _placeless(gathered(jax.jit(self.jacobian)))

    @functools.cached_property
    def push_all(self) -> Callable[[Any, Any], tuple[Any, Any, Any]]:
        """`jacobian` at several points (S, K) in one batch."""
        return _placeless(gathered(jax.jit(jax.vmap(self.jacobian, in_axes=(0, None)))))

    @functools.cached_property
    def roll(self) -> Callable[[Any, Any], tuple[Any, Any]]:
        """`values`, jitted."""
        return _placeless(gathered(jax.jit(self.values)))

    def worst(self, z: Any) -> np.ndarray:
        """The worst of every metric (M,) in the ensemble at z; infinite where a run diverges."""
        values, ok = (self.push if self.forward else self.roll)(z, self.scenarios)[:2]
        return np.where(ok, values, np.inf).max(axis=1)

    @functools.cached_property
    def reference(self) -> np.ndarray:
        """What the ratios are taken to; raises `RuntimeError` where every run diverges."""
        if self.budget is not None:
            return np.asarray(self.budget)
        start = self.free.coordinates(self.controller)
        values, ok = (self.push if self.forward else self.roll)(start, self.scenarios)[:2]
        return self.objective.reference(values, ok)

    def cost_of(self, values: Any, ok: Any) -> tuple[Any, Score]:
        """Cost of an ensemble's metrics, and what it is made of."""
        score = self.objective.score(values, ok, self.reference)
        return score.cost, score

    @functools.cached_property
    def weigh(self) -> Callable[[Any, Any, Any], tuple[Score, Any]]:
        """What `push` returns -> score and the gradient of its cost."""
        _ = self.reference  # a number: computed before anything is traced
        return jax.jit(self._weigh)

    def _weigh(self, values: Any, ok: Any, slopes: Any) -> tuple[Score, Any]:
        weights, score = jax.grad(self.cost_of, has_aux=True)(values, ok)
        return score, jnp.tensordot(slopes, weights, axes=2)

    @functools.cached_property
    def gradient_of(self) -> Callable[[Any, Any], tuple[Score, Any]]:
        """(z, scenarios) -> score and the gradient of its cost, by the mode of `gradient`."""
        _ = self.reference  # as above

        def reverse(z: Any, scenarios: Any) -> tuple[Score, Any]:
            gradient, score = jax.grad(lambda z: self.cost_of(*self.values(z, scenarios)), has_aux=True)(z)
            return score, gradient

        return (
            (lambda z, scenarios: self.weigh(*self.push(z, scenarios)))
            if self.forward
            else _placeless(gathered(jax.jit(reverse)))
        )

    @functools.cached_property
    def update(self) -> Callable[..., tuple[Any, Any]]:
        """gradient, optimiser state, z, cost, scenarios -> (z, state)."""

        def step(gradient: Any, state: Any, z: Any, value: Any, scenarios: Any) -> tuple[Any, Any]:
            return first_order.update(self.chain, gradient, state, z, value, self._searched(scenarios))

        return gathered(jax.jit(step))

    def _searched(self, scenarios: Any) -> Callable[[Any], Any]:
        """The cost as a function of z whose gradient is taken in forward mode however it is asked for."""

        @jax.custom_vjp
        def cost(z: Any) -> Any:
            return self.cost_of(*self.values(z, scenarios))[0]

        def forth(z: Any) -> tuple[Any, Any]:
            score, gradient = self._weigh(*self.jacobian(z, scenarios))
            return score.cost, gradient

        cost.defvjp(forth, lambda gradient, change: (change * gradient,))
        return cost

    def try_update(self, z: Any) -> Any:
        """One step along z itself, to see whether this optimiser can be driven by a cost and its gradient."""
        return first_order.update(self.chain, z, self.chain.init(z), z, jnp.sum(z), jnp.sum)

    @property
    def forward(self) -> bool:
        """Whether gradients are taken in forward mode."""
        return self.sequential or mode(self.gradient, len(self.free.names)) == "forward"

    @property
    def sequential(self) -> bool:
        """Whether steps are quadratic programmes and not an optax optimiser's."""
        return self.optimizer == SEQUENTIAL

    def begin(self, z: Any = None) -> Progress:
        """Before the first iteration: the starting gains, or those at z, which are also the best so far."""
        z = self.free.coordinates(self.controller) if z is None else jnp.asarray(z)
        sizes = (z.size, len(self.objective.names), self.batch.size, self.objective.penalty)
        state = sqp.State.begin(*sizes) if self.sequential else self.chain.init(z)
        return Progress(0, z, state, z, z, (np.inf, np.inf), 0, 0, 0, 0, [])

    def look(self, z: Any, iteration: int, model: Any = None) -> Look:
        """What there is to see at z; `model` if it is known."""
        scenarios = self.scenarios if self.fresh is None else self.fresh(iteration)
        if self.sequential:
            model = self.push(z, scenarios) if model is None else model
            return Look(*self.weigh(*model), model=model)
        look = Look(*(self.gradient_of(z, scenarios) if model is None else self.weigh(*model)))
        if self.fresh is None:
            return look
        return look._replace(rank=self.cost_of(*self.roll(z, self.scenarios))[1])

    def advance(self, p: Progress, model: Any = None) -> Progress:
        """One iteration: look, the best so far, step. `model` is what `push` returns at p.z, if that is known."""
        look = self.look(p.z, p.iteration, model)
        norm = float(jnp.linalg.norm(look.gradient))
        sound = bool(np.isfinite(norm)) and int(look.score.latched) < self.batch.size
        sound = sound and (not self.sequential or sqp.usable(look.model, self.objective.scale(self.reference)))
        clips = not self.sequential and self.optimizer != first_order.QUASI_NEWTON
        clipped = p.clipped + (sound and norm > self.clip and clips)
        score = look.rank or look.score
        over = np.asarray(score.levels)[len(self.objective.goals) :] - 1
        rank = (float(np.maximum(over - FEASIBLE, 0).sum()), float(score.goal))
        better = sound and rank < p.best
        rollouts = p.rollouts + 1 + p.z.size + (look.rank is not None)
        row = (p.iteration, *(float(s) for s in score[:4]), norm, clipped, p.backed_out + (not sound), rollouts)
        z, state = self._step(p, look, sound)
        return Progress(
            iteration=p.iteration + 1,
            z=z,
            optimiser=state,
            sound_z=p.z if sound else p.sound_z,
            best_z=p.z if better else p.best_z,
            best=rank if better else p.best,
            best_iteration=p.iteration if better else p.best_iteration,
            clipped=clipped,
            backed_out=p.backed_out + (not sound),
            rollouts=rollouts + (0 if self.sequential else first_order.looks(state) * (1 + p.z.size)),
            history=[*p.history, (*row, *self.gains(p.z))],
        )

    def _step(self, p: Progress, look: Look, sound: bool) -> tuple[Any, Any]:
        """The next point and the optimiser's state; after a point of no use half the way back."""
        if self.sequential:
            levels = look.score.levels if sound else None
            z, state = sqp.step(p.optimiser, p.z, levels, look.model, self.objective, self.reference)
            return jnp.asarray(z, p.z.dtype), state
        if not sound:
            return (p.z + p.sound_z) / 2 if bool(jnp.all(jnp.isfinite(p.z))) else p.sound_z, p.optimiser
        scenarios = self.scenarios if self.fresh is None else self.fresh(p.iteration)
        return self.update(look.gradient, p.optimiser, p.z, look.score.cost, scenarios)

    def advance_all(self, searches: list[Progress]) -> list[Progress]:
        """One iteration of every search that has not finished; all look in one batch."""
        if len(searches) == 1 or not self.forward or self.fresh is not None:
            return [p if self.finished(p) else self.advance(p) for p in searches]
        values, ok, slopes = self.push_all(jnp.stack([p.z for p in searches]), self.scenarios)
        models = [(values[i], ok[i], slopes[i]) for i in range(len(searches))]
        return [p if self.finished(p) else self.advance(p, m) for p, m in zip(searches, models, strict=True)]

    def gains(self, z: Any) -> list[float]:
        """The tuned gains at z, in the order of their names."""
        leaves = agvjax.leaves(self.free.controller(z, self.controller))
        return [float(leaves[name]) for name in self.free.names]

    def finished(self, p: Progress) -> bool:
        """All iterations done, no step left that is worth taking, or no better gains for `patience` iterations.

        Also where the very first point is of no use: there is nothing to back out to.
        """
        if (self.sequential and p.optimiser.converged) or (p.iteration and np.isinf(p.best[1])):
            return True
        return p.iteration >= self.iterations or p.iteration - p.best_iteration > self.patience

    def best(self, p: Progress) -> Any:
        """The controller with the best gains so far: limits met first, then the goal."""
        return self.free.controller(p.best_z, self.controller)


def _placeless(compute: Callable[..., Any]) -> Callable[..., Any]:
    """Z may come from anywhere without compiling anew."""
    return lambda z, *more: compute(np.asarray(z), *more)


def mode(gradient: str, gains: int) -> str:
    """What `auto` means for so many gains."""
    return gradient if gradient != "auto" else "forward" if gains <= MOST_FORWARD else "reverse"
