"""The optax loop: gradients of the ensemble's cost in the free coordinates, checkpoints, the best gains so far."""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

import agvjax

from . import slp
from .free import Free
from .objective import Objective, Score

BLOCK, LEAST = 64, 16  # scenarios in a block and on a device: fewer than in a rollout, since each carries its tangents
MOST_FORWARD = 30  # gains up to which forward mode costs less than reverse mode; see benchmarks/gradient.py
FEASIBLE = 1e-3  # a limit counts as met up to a tenth of a percent
SEQUENTIAL = "slp"  # an optimiser of our own, beside those of optax
HISTORY = ("iteration", "cost", "goal", "excess", "latched", "gradient_norm", "clipped", "skipped")


class Progress(NamedTuple):
    """Everything a run needs to go on from where it stands."""

    iteration: int
    z: Any  # free coordinates
    optimiser: Any  # state of the optax chain, or of the sequential linear programme
    best_z: Any
    best: tuple[float, float]  # (excess beyond tolerance, cost) of best_z, compared in this order
    best_iteration: int
    clipped: int  # gradients cut to the allowed norm so far
    skipped: int  # iterations without a step, their gradient not finite or the slopes of no use
    history: list[tuple[float, ...]]  # a row an iteration: HISTORY, then the gains


@dataclasses.dataclass(frozen=True)
class Tuner:
    """A tuning problem and how to solve it; the defaults are those that did best on the default problem."""

    controller: Any
    batch: agvjax.Batch
    free: Free
    objective: Objective = Objective()
    dt: float = 5e-3
    n_steps: int = 2400
    integrator: agvjax.Integrator = agvjax.RK4
    iterations: int = 300
    optimizer: str = "adam"
    learning_rate: float = 0.1
    options: dict[str, Any] = dataclasses.field(default_factory=dict)  # further arguments of the optax optimiser
    clip: float = 1.0
    patience: int = 100
    gradient: str = "auto"
    budget: Any = None  # (2, M), what the ratios are taken to; None for what the starting gains achieve
    prepared: Callable[[Any], tuple[Any, Any, Any]] | None = None  # `jacobian` of this very problem, compiled before

    @functools.cached_property
    def chain(self) -> optax.GradientTransformation:
        """Clipping, then the optimiser with a cosine decay of its learning rate over the run."""
        schedule = optax.cosine_decay_schedule(self.learning_rate, max(1, self.iterations))
        return optax.chain(
            optax.clip_by_global_norm(self.clip), find_optimizer(self.optimizer)(schedule, **self.options)
        )

    def values(self, z: Any) -> tuple[Any, Any]:
        """The metrics that matter of every scenario (M, B), and which runs are worth having (B,)."""
        controller = self.free.controller(z, self.controller)
        metrics = agvjax.evaluate(
            controller,
            self.batch,
            dt=self.dt,
            n_steps=self.n_steps,
            integrator=self.integrator,
            dtype=z.dtype.type,
            block=BLOCK,
            devices=max(1, min(jax.local_device_count(), self.batch.size // LEAST)),
        )
        return self.objective.values(metrics)

    def jacobian(self, z: Any) -> tuple[Any, Any, Any]:
        """Values, ok and slopes (K, M, B) at z: one rollout carries all tangents, memory flat in the horizon."""
        along = jax.vmap(lambda v: jax.jvp(self.values, (z,), (v,)), out_axes=((None, None), (0, None)))
        (values, ok), (slopes, _) = along(jnp.eye(z.size, dtype=z.dtype))
        return values, ok, jnp.where(ok, slopes, 0.0)  # a run that diverged steers nothing

    @functools.cached_property
    def push(self) -> Callable[[Any], tuple[Any, Any, Any]]:
        """`jacobian`, jitted; what it returns is on one device, however many took part."""
        compute = jax.jit(self.jacobian)
        return self.prepared or (lambda z: jax.device_put(compute(z), jax.local_devices()[0]))

    @functools.cached_property
    def reference(self) -> np.ndarray:
        """Mean and worst of those metrics that count as 1; raises `RuntimeError` where every run diverges."""
        if self.budget is not None:
            return np.asarray(self.budget)
        start = self.free.coordinates(self.controller)
        values, ok = self.push(start)[:2] if self.forward else jax.jit(self.values)(start)
        if not np.any(ok):
            raise RuntimeError(
                f"every one of the {self.batch.size} runs diverges with the starting gains: nothing to tune from"
            )
        return self.objective.reference(values, ok)

    def cost_of(self, values: Any, ok: Any) -> tuple[Any, Score]:
        """Cost of an ensemble's metrics, and what it is made of."""
        score = self.objective.score(values, ok, self.reference)
        return score.cost, score

    @functools.cached_property
    def weigh(self) -> Callable[[Any, Any, Any], tuple[Score, Any]]:
        """What `push` returns -> score and the gradient of its cost."""
        _ = self.reference  # a number: computed before anything is traced

        def weigh(values: Any, ok: Any, slopes: Any) -> tuple[Score, Any]:
            weights, score = jax.grad(self.cost_of, has_aux=True)(values, ok)
            return score, jnp.tensordot(slopes, weights, axes=2)

        return jax.jit(weigh)

    @functools.cached_property
    def gradient_of(self) -> Callable[[Any], tuple[Score, Any]]:
        """Z -> score and the gradient of its cost, by the mode of `gradient`."""
        _ = self.reference  # as above

        def reverse(z: Any) -> tuple[Score, Any]:
            gradient, score = jax.grad(lambda z: self.cost_of(*self.values(z)), has_aux=True)(z)
            return score, gradient

        if self.forward:
            return lambda z: self.weigh(*self.push(z))
        compute = jax.jit(reverse)
        return lambda z: jax.device_put(compute(z), jax.local_devices()[0])

    @functools.cached_property
    def update(self) -> Callable[[Any, Any, Any], tuple[Any, Any]]:
        """gradient, optimiser state, z -> (z, state)."""

        def step(gradient: Any, state: Any, z: Any) -> tuple[Any, Any]:
            with jax.numpy_dtype_promotion("standard"):  # optax counts in integers, whatever a process is strict about
                change, state = self.chain.update(gradient, state, z)
                return optax.apply_updates(z, change), state

        return jax.jit(step)

    def try_update(self, z: Any) -> Any:
        """One step along z itself, to see whether this optimiser can be driven by gradients alone."""
        return self.update(z, self.chain.init(z), z)

    @property
    def forward(self) -> bool:
        """Whether gradients are taken in forward mode."""
        return self.sequential or mode(self.gradient, len(self.free.names)) == "forward"

    @property
    def sequential(self) -> bool:
        """Whether steps are linear programmes and not an optax optimiser's."""
        return self.optimizer == SEQUENTIAL

    def begin(self) -> Progress:
        """Before the first iteration: the starting gains, which are also the best so far."""
        z = self.free.coordinates(self.controller)
        sizes = (z.size, len(self.objective.names), self.batch.size)
        state = slp.State.begin(*sizes) if self.sequential else self.chain.init(z)
        return Progress(0, z, state, z, (np.inf, np.inf), 0, 0, 0, [])

    def advance(self, p: Progress) -> Progress:
        """One iteration: gradient, the best so far, step."""
        model = self.push(p.z) if self.sequential else None
        score, gradient = self.weigh(*model) if model else self.gradient_of(p.z)
        norm = float(jnp.linalg.norm(gradient))
        finite = bool(np.isfinite(norm)) and (not self.sequential or slp.usable(model, self.reference))
        clipped = p.clipped + (finite and norm > self.clip and not self.sequential)
        skipped = p.skipped + (not finite)
        rank = (max(0.0, float(score.excess) - FEASIBLE), float(score.cost))
        better = rank < p.best
        row = (p.iteration, *(float(s) for s in score), norm, clipped, skipped, *self.gains(p.z))
        if self.sequential:
            cost = float(score.cost) if finite else np.nan
            z, state = slp.step(p.optimiser, p.z, cost, model, self.objective, self.reference)
            z = jnp.asarray(z, p.z.dtype)
        else:
            z, state = self.update(gradient, p.optimiser, p.z) if finite else (p.z, p.optimiser)
        return Progress(
            iteration=p.iteration + 1,
            z=z,
            optimiser=state,
            best_z=p.z if better else p.best_z,
            best=rank if better else p.best,
            best_iteration=p.iteration if better else p.best_iteration,
            clipped=clipped,
            skipped=skipped,
            history=[*p.history, row],
        )

    def gains(self, z: Any) -> list[float]:
        """The tuned gains at z, in the order of their names."""
        leaves = agvjax.leaves(self.free.controller(z, self.controller))
        return [float(leaves[name]) for name in self.free.names]

    def finished(self, p: Progress) -> bool:
        """All iterations done, no step left that is worth taking, or no better gains for `patience` iterations."""
        if self.sequential and p.optimiser.converged:
            return True
        return p.iteration >= self.iterations or p.iteration - p.best_iteration > self.patience

    def best(self, p: Progress) -> Any:
        """The controller with the best gains so far: limits met first, then cost."""
        return self.free.controller(p.best_z, self.controller)


def mode(gradient: str, gains: int) -> str:
    """What `auto` means for so many gains."""
    return gradient if gradient != "auto" else "forward" if gains <= MOST_FORWARD else "reverse"


def find_optimizer(name: str) -> Callable[..., Any]:
    """An optimiser of optax by its name; KeyError where there is none that takes a learning rate."""
    maker = getattr(optax, name, None) or getattr(optax.contrib, name, None)
    try:
        known = inspect.signature(maker).parameters  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError):
        known = {}
    if "learning_rate" not in known:
        raise KeyError(f"optax has no optimiser {name} with a learning rate")
    return maker  # pyright: ignore[reportReturnType]
