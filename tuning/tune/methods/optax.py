"""The optimisers of optax as methods of tuning."""

from __future__ import annotations

import functools
import inspect
import math
import sys
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, PyTree

from agvjax import Fault

from ...compute.processes import gathered
from .method import Look, Method, Progress, Scenarios, halfway

if TYPE_CHECKING:
    from ...config.settings import Config, Tune

ANY = (-sys.float_info.max, math.inf, "finite")
OPTIONS = {  # from, below, in words: options of one name mean the same in all of optax
    ("b1", "b2", "b3", "beta3", "betas", "decay", "rho", "momentum", "decay_rate"): (0.0, 1.0, "from 0, below 1"),
    ("eps", "eps_root", "weight_decay", "weight_decay_rate", "initial_accumulator_value"): (0.0, math.inf, ">= 0"),
    ("memory_size", "update_interval", "rank", "ns_steps"): (1, math.inf, ">= 1"),
}
LINE_SEARCH = "lbfgs"  # searches along a line by itself: nothing is clipped and no rate decays


class Optax(Method):
    """An optimiser of optax by its name: the gradient clipped, then a cosine decay of the learning rate."""

    @functools.cached_property
    def transformation(self) -> optax.GradientTransformationExtraArgs:
        """Of optax: clipping, then the optimiser with a cosine decay of its learning rate over the run."""
        return _transformation(self.settings)

    def begin(self, z: Array, scenarios: int) -> PyTree:
        """The state of the transformation."""
        return self.transformation.init(z)

    @functools.cached_property
    def update(self) -> Callable[[Array, PyTree, Array, Array, Scenarios], tuple[Array, PyTree]]:
        """(gradient, state, z, cost, scenarios) -> (z, state), jitted."""

        def step(gradient: Array, state: PyTree, z: Array, value: Array, scenarios: Scenarios) -> tuple[Array, PyTree]:
            return _updated(self.transformation, gradient, state, z, value, self.cost(scenarios))

        return gathered(jax.jit(step))

    def step(
        self, p: Progress, look: Look, sound: bool, baseline: np.ndarray, scenarios: Scenarios
    ) -> tuple[Array, PyTree]:
        """One update; from a point of no use half the way back."""
        if not sound:
            return halfway(p), p.optimiser
        return self.update(look.gradient, p.optimiser, p.z, look.score.cost, scenarios)

    def clips(self, norm: float) -> bool:
        """Whether the norm is beyond `tune.clip`."""
        return norm > self.settings.clip and self.settings.optimizer != LINE_SEARCH

    def step_rollouts(self, state: PyTree, gains: int) -> int:
        """Those of a search along a line."""
        looks = optax.tree_utils.tree_get_all_with_path(state, "num_linesearch_steps")
        return (1 + gains) * sum(int(steps) for _, steps in looks)

    def note(self, clipped: int) -> str:
        """How many gradients were clipped."""
        return f" {clipped} gradients clipped to norm {self.settings.clip:g},"

    @classmethod
    def faults(cls, config: Config) -> list[Fault]:
        """An optimiser that optax lacks, or that needs more than a cost, its gradient and options, or that forgets."""
        name, wrong = config.tune.optimizer, _options(config.tune.options)
        if wrong:
            return wrong
        try:
            maker = _transformation(config.tune)
        except Exception as error:  # optax and its optimisers raise whatever they meet
            rule = f"sqp, or an optimiser of optax that takes a learning rate, and options it knows ({error})"
            return [Fault("tune.optimizer", name, rule)]
        point = jax.ShapeDtypeStruct((2,), jnp.result_type(float))  # not an array: processes meet before JAX computes
        try:
            _, state = jax.eval_shape(lambda z: _updated(maker, z, maker.init(z), z, jnp.sum(z), jnp.sum), point)
        except Exception as error:  # as above
            rule = f"an optimiser of optax that needs no more than a cost, its gradient and these options ({error})"
            return [Fault("tune.optimizer", name, rule)]
        kinds = {str(leaf.dtype) for leaf in jax.tree.leaves(state) if not _plain(leaf.dtype)}
        if kinds:
            rule = f"an optimiser of optax whose state a checkpoint can keep; it holds {', '.join(sorted(kinds))}"
            return [Fault("tune.optimizer", name, rule)]
        return []


def _transformation(settings: Tune) -> optax.GradientTransformationExtraArgs:
    maker = find_optimizer(settings.optimizer)
    if settings.optimizer == LINE_SEARCH:
        return maker(**settings.options)
    schedule = optax.cosine_decay_schedule(settings.learning_rate, max(1, settings.iterations))
    return optax.chain(optax.clip_by_global_norm(settings.clip), maker(schedule, **settings.options))


def _plain(dtype: np.dtype) -> bool:
    """Whether arrays of this dtype are the same after a file: no keys of random numbers, no halves of jax's own."""
    return not jnp.issubdtype(dtype, jax.dtypes.extended) and np.dtype(dtype).isbuiltin == 1


def _options(options: Mapping[str, Any]) -> list[Fault]:
    """Numbers that no optimiser means: it would begin, and never leave the starting gains or go astray."""
    wrong = []
    for name, value in options.items():
        numbers = [x for x in (value if isinstance(value, list) else [value]) if isinstance(x, (int, float))]
        low, high, rule = next((r for names, r in OPTIONS.items() if name.removeprefix("adam_") in names), ANY)
        if not all(low <= x < high for x in numbers):
            wrong.append(Fault(f"tune.options.{name}", value, rule))
    return wrong


def find_optimizer(name: str) -> Callable[..., Any]:
    """An optimiser of optax by its name; KeyError where there is none that takes a learning rate."""
    maker = getattr(optax, name, None) or getattr(optax.contrib, name, None)
    try:
        known: Mapping[str, object] = inspect.signature(maker).parameters if callable(maker) else {}
    except (TypeError, ValueError):
        known = {}
    if maker is None or "learning_rate" not in known:
        raise KeyError(f"optax has no optimiser {name} with a learning rate")
    return maker


def _updated(
    transformation: optax.GradientTransformationExtraArgs,
    gradient: Array,
    state: PyTree,
    z: Array,
    value: Array,
    cost: Callable[[Array], Array],
) -> tuple[Any, PyTree]:
    """(z, state) after one step; `cost` is computed by a method that searches along a line."""
    with jax.numpy_dtype_promotion("standard"):  # optax counts in integers, whatever a process is strict about
        change, state = transformation.update(gradient, state, z, value=value, grad=gradient, value_fn=cost)
        return optax.apply_updates(z, change), state
