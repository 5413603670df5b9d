"""The search for gains: looks at an ensemble, steps, backs out of what diverges, keeps the best so far."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import agvjax
from agvjax.leaves import swap

from ..compute.processes import gathered, joined
from ..config.old import gathered_keywords
from ..config.settings import Tune
from . import loops
from .gains import Gains
from .methods import Method, method
from .methods.method import Look, Model, Progress, Scenarios
from .methods.objective import Objective, Score

T = TypeVar("T")
BLOCK, LEAST = 64, 16  # scenarios in a block and on a device: fewer than in a rollout, since each carries its tangents
HISTORY = ("iteration", "cost", "goal", "excess", "latched", "gradient_norm", "clipped", "backed_out", "rollouts")


@gathered_keywords(timing=agvjax.Timing, settings=Tune)
@dataclasses.dataclass(frozen=True)
class Tuner:
    """A search for gains, to be stepped by a method: what to tune, on which scenarios, to what end.

    Attributes:
        controller: with the starting gains.
        batch: the ensemble.
        gains: which are tuned, within which bounds.
        objective: goals and limits.
        settings: of [tune]; its defaults are those that did best on the default problem.
        timing: of the rollouts.
        budget: (3, M), what goals and limits are multiples of; None for what the starting gains achieve.
        fresh: iteration -> leaves of its scenarios; None for those of the batch in every iteration.
        compiled: `jacobian` of this very problem, compiled before.
    """

    controller: agvjax.Law
    batch: agvjax.Batch
    gains: Gains
    objective: Objective = Objective()
    settings: Tune = Tune()
    timing: agvjax.Timing = agvjax.Timing(dt=5e-3, n_steps=2400)
    budget: np.ndarray | None = None
    fresh: Callable[[int], Mapping[str, np.ndarray]] | None = None
    compiled: Callable[[Array, Scenarios], Model] | None = None

    @functools.cached_property
    def method(self) -> Method:
        """The method of `tune.optimizer`."""
        return method(self.settings.optimizer)(self.settings, self.objective, self._cost_along)

    def values(self, z: Array, scenarios: Scenarios) -> tuple[Array, Array]:
        """The metrics of runs that matter of every scenario (M, B), and which runs are worth having (B,).

        `z` is (K,), or (B, K) where every scenario has gains of its own.
        """
        varied = {name: scenarios[name] for name in self.batch.names}
        batch = agvjax.Batch(scenario=swap(self.batch.scenario, varied), names=self.batch.names)
        objective = self.objective.of_runs()
        metrics = agvjax.evaluate(
            self.law_at(z, scenarios),
            batch,
            criteria=objective.criteria,
            dtype=z.dtype.type,
            block=BLOCK,
            devices=None if joined() else max(1, min(jax.local_device_count(), batch.size // LEAST)),
            **self.timing,
        )
        return objective.values(metrics)

    def law_at(self, z: Array, scenarios: Scenarios) -> agvjax.Law | agvjax.Batch:
        """The law at z (K,), or the laws at z (B, K), one for each scenario."""
        return (self.gains.controllers if z.ndim == 2 else self.gains.controller)(z, self.controller)

    def jacobian(self, z: Array, scenarios: Scenarios) -> Model:
        """Values, ok and slopes (K, M, B) at z: one rollout carries all tangents, memory flat in the horizon."""
        along = jax.vmap(
            lambda v: jax.jvp(lambda z: self.values(z, scenarios), (z,), (v,)), out_axes=((None, None), (0, None))
        )
        (values, ok), (slopes, _) = along(jnp.eye(z.size, dtype=z.dtype))
        return values, ok, jnp.where(ok, slopes, 0.0)  # a run that diverged steers nothing

    def scenarios(self, iteration: int | None = None) -> Scenarios:
        """The leaves that vary, of an iteration or, without, of the batch: arguments of what is compiled."""
        if self.fresh is not None and iteration is not None:
            return self.fresh(iteration)
        return {name: np.asarray(value) for name, value in self.batch.values.items()}

    @functools.cached_property
    def pushed(self) -> Callable[[Array, Scenarios], Model]:
        """`jacobian`, jitted; what it returns is on one device, however many took part."""
        return self.compiled or _placeless(gathered(jax.jit(self.jacobian)))

    @functools.cached_property
    def push(self) -> Callable[[Array, Scenarios], Model]:
        """The same, with the columns of the linearised loop behind where there are limits on these."""
        if not self.objective.loop:
            return self.pushed
        return lambda z, scenarios: loops.beside(self, self.pushed(z, scenarios), z, scenarios)

    @functools.cached_property
    def push_all(self) -> Callable[[Array, Scenarios], Model]:
        """`push` at several points (S, K), runs in one batch."""
        pushed = _placeless(gathered(jax.jit(jax.vmap(self.jacobian, in_axes=(0, None)))))
        if not self.objective.loop:
            return pushed

        def beside(z: Array, scenarios: Scenarios) -> Model:
            rows = zip(*pushed(z, scenarios), z, strict=True)
            found = [loops.beside(self, (values, ok, slopes), at, scenarios) for values, ok, slopes, at in rows]
            values, ok, slopes = (jnp.stack(x) for x in zip(*found, strict=True))
            return values, ok, slopes

        return beside

    @functools.cached_property
    def roll(self) -> Callable[[Array, Scenarios], tuple[Array, Array]]:
        """`values`, jitted, with the columns of the loop as in `push`."""
        return self.with_loops(_placeless(gathered(jax.jit(self.values))))

    def with_loops(
        self, roll: Callable[[Array, Scenarios], tuple[Array, Array]]
    ) -> Callable[[Array, Scenarios], tuple[Array, Array]]:
        """What rolls runs out, with the columns of the loop behind where there are limits on these."""
        if not self.objective.loop:
            return roll

        def beside(z: Array, scenarios: Scenarios) -> tuple[Array, Array]:
            values, ok = roll(z, scenarios)
            return jnp.concatenate([values, jnp.asarray(loops.values(self, z, scenarios), values.dtype)]), ok

        return beside

    def judged(self, z: Array) -> tuple[Array, Array]:
        """Metrics (M, B) and ok (B,) of the ensemble at z, by what is compiled already."""
        compiled = self.push if self.forward else self.roll
        return compiled(z, self.scenarios())[:2]

    def worst(self, z: Array) -> np.ndarray:
        """The worst of every metric (M,) in the ensemble at z; infinite where a run diverges."""
        values, ok = self.judged(z)
        return np.where(ok, values, np.inf).max(axis=1)

    @functools.cached_property
    def baseline(self) -> np.ndarray:
        """(3, M), what goals and limits are multiples of; raises `RuntimeError` where every run diverges."""
        if self.budget is not None:
            return np.asarray(self.budget)
        return self.objective.baseline(*self.judged(self.gains.coordinates(self.controller)))

    def cost_of(self, values: Array, ok: Array) -> tuple[Array, Score]:
        """Cost of an ensemble's metrics, and what it is made of."""
        score = self.objective.score(values, ok, self.baseline)
        return score.cost, score

    @functools.cached_property
    def score_all(self) -> Callable[[Array, Array], Score]:
        """Values (N, M, B) and ok (N, B) of gain sets in the scenarios that were drawn, none added -> their scores."""
        objective, baseline = self.objective._replace(weights=None), self.baseline
        return jax.jit(jax.vmap(lambda values, ok: objective.score(values, ok, baseline)))

    @functools.cached_property
    def weigh(self) -> Callable[[Array, Array, Array], tuple[Score, Array]]:
        """What `push` returns -> score and the gradient of its cost."""
        _ = self.baseline  # a number: computed before anything is traced

        def weigh(values: Array, ok: Array, slopes: Array) -> tuple[Score, Array]:
            weights, score = jax.grad(self.cost_of, has_aux=True)(values, ok)
            return score, jnp.tensordot(slopes, weights, axes=2)

        return jax.jit(weigh)

    @functools.cached_property
    def gradient_of(self) -> Callable[[Array, Scenarios], tuple[Score, Array]]:
        """(z, scenarios) -> score and the gradient of its cost, by the mode of `tune.gradient`."""
        _ = self.baseline  # as above

        def reverse(z: Array, scenarios: Scenarios) -> tuple[Score, Array]:
            gradient, score = jax.grad(lambda z: self.cost_of(*self.values(z, scenarios)), has_aux=True)(z)
            return score, gradient

        if self.forward:
            return lambda z, scenarios: self.weigh(*self.push(z, scenarios))
        return _placeless(gathered(jax.jit(reverse)))

    def _cost_along(self, scenarios: Scenarios) -> Callable[[Array], Array]:
        """The cost as a function of z whose gradient is taken in forward mode however it is asked for."""

        @jax.custom_vjp
        def cost(z: Array) -> Array:
            return self.cost_of(*self.values(z, scenarios))[0]

        def forth(z: Array) -> tuple[Array, Array]:
            score, gradient = self.weigh(*self.jacobian(z, scenarios))
            return score.cost, gradient

        cost.defvjp(forth, lambda gradient, change: (change * gradient,))
        return cost

    @property
    def forward(self) -> bool:
        """Whether gradients are taken in forward mode."""
        return self.method.forward(self.settings, len(self.gains.names))

    def begin(self, z: Array | None = None, moving: np.ndarray | None = None) -> Progress:
        """Before the first iteration: the starting gains, or those at z, which are also the best so far.

        Only the gains that are `moving` (K,) will change; None: all.
        """
        z = self.gains.coordinates(self.controller) if z is None else jnp.asarray(z)
        state = self.method.begin(z, self.batch.size)
        free = np.ones(z.size, bool) if moving is None else np.asarray(moving, bool)
        return Progress(0, z, state, z, z, (np.inf, np.inf), 0, 0, 0, 0, [], free)

    def look(self, z: Array, iteration: int, model: Model | None = None) -> Look:
        """What there is to see at z; `model` if it is known."""
        look = self.method.look(self, z, self.scenarios(iteration), model)
        if self.fresh is None:
            return look
        return look._replace(rank=self.cost_of(*self.roll(z, self.scenarios()))[1])

    def advance(self, p: Progress, model: Model | None = None) -> Progress:
        """One iteration: look, the best so far, step. `model` is what `push` returns at p.z, if that is known."""
        look = _held(self.look(p.z, p.iteration, model), p.moving)
        norm = float(jnp.linalg.norm(look.gradient))
        sound = bool(np.isfinite(norm)) and int(look.score.latched) < self.batch.size
        sound = sound and self.method.usable(look, self.baseline)
        clipped = p.clipped + (sound and self.method.clips(norm))
        score = look.rank or look.score
        excess, goal = self.objective.ranks(score)
        rank = (float(excess), float(goal))
        better = sound and rank < p.best
        rollouts = p.rollouts + self.method.look_rollouts(p.z.size) + (look.rank is not None)
        row = (p.iteration, *(float(s) for s in score[:4]), norm, clipped, p.backed_out + (not sound), rollouts)
        z, state = self.method.step(p, look, sound, self.baseline, self.scenarios(p.iteration))
        z = z if p.moving.all() else jnp.where(p.moving, z, p.z)
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
            rollouts=rollouts + self.method.step_rollouts(state, p.z.size),
            history=[*p.history, (*row, *self.gains.values(p.z, self.controller))],
            moving=p.moving,
        )

    def advance_all(self, searches: list[Progress]) -> list[Progress]:
        """One iteration of every search that has not finished; all look in one batch, unless one alone goes on."""
        going = sum(not self.finished(p) for p in searches)
        if going == 1 or not self.forward or self.fresh is not None:
            return [p if self.finished(p) else self.advance(p) for p in searches]
        values, ok, slopes = self.push_all(jnp.stack([p.z for p in searches]), self.scenarios())
        models = [(values[i], ok[i], slopes[i]) for i in range(len(searches))]
        return [p if self.finished(p) else self.advance(p, m) for p, m in zip(searches, models, strict=True)]

    def finished(self, p: Progress) -> bool:
        """All iterations done, no step left that is worth taking, or no better gains for `patience` iterations.

        Also where the very first point is of no use: there is nothing to back out to.
        """
        if self.method.converged(p.optimiser) or (p.iteration and np.isinf(p.best[1])):
            return True
        return p.iteration >= self.settings.iterations or p.iteration - p.best_iteration > self.settings.patience

    def best(self, p: Progress) -> agvjax.Law:
        """The controller with the best gains so far: limits met first, then the goal."""
        return self.gains.controller(p.best_z, self.controller).canonical()


def _held(look: Look, moving: np.ndarray) -> Look:
    """The look as if nothing changed with the gains that do not move."""
    if moving.all():
        return look
    model = look.model
    if model is not None:
        values, ok, slopes = model
        model = (values, ok, jnp.where(moving[:, None, None], slopes, 0.0))
    return look._replace(gradient=jnp.where(moving, look.gradient, 0.0), model=model)


def _placeless(compute: Callable[..., T]) -> Callable[..., T]:
    """Z may come from anywhere without compiling anew."""
    return lambda z, *more: compute(np.asarray(z), *more)
