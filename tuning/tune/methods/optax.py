"""The optimisers of optax as methods of tuning."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, PyTree

from agvjax import Fault

from ...compute.processes import gathered
from .method import Look, Method, Progress, Scenarios, halfway

if TYPE_CHECKING:
    import numpy as np

    from ...config.settings import Config

LINE_SEARCH = "lbfgs"  # searches along a line by itself: nothing is clipped and no rate decays


class Optax(Method):
    """An optimiser of optax by its name: the gradient clipped, then a cosine decay of the learning rate."""

    @functools.cached_property
    def transformation(self) -> optax.GradientTransformationExtraArgs:
        """Of optax: clipping, then the optimiser with a cosine decay of its learning rate over the run."""
        settings = self.settings
        maker = find_optimizer(settings.optimizer)
        if settings.optimizer == LINE_SEARCH:
            return maker(**settings.options)
        schedule = optax.cosine_decay_schedule(settings.learning_rate, max(1, settings.iterations))
        return optax.chain(optax.clip_by_global_norm(settings.clip), maker(schedule, **settings.options))

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

    def further_looks(self, state: PyTree) -> int:
        """Those of a search along a line."""
        return sum(int(steps) for _, steps in optax.tree_utils.tree_get_all_with_path(state, "num_linesearch_steps"))

    def note(self, clipped: int) -> str:
        """How many gradients were clipped."""
        return f" {clipped} gradients clipped to norm {self.settings.clip:g},"

    @classmethod
    def faults(cls, config: Config) -> list[Fault]:
        """An optimiser that optax lacks, or that more than a cost, its gradient and the options would have to drive."""
        name, options = config.tune.optimizer, config.tune.options
        try:
            maker = find_optimizer(name)(1.0, **options)
        except Exception as error:  # optax and its optimisers raise whatever they meet
            rule = f"sqp, or an optimiser of optax that takes a learning rate, and options it knows ({error})"
            return [Fault("tune.optimizer", name, rule)]
        point = jax.ShapeDtypeStruct((2,), jnp.result_type(float))  # not an array: processes meet before JAX computes
        try:
            jax.eval_shape(lambda z: _updated(maker, z, maker.init(z), z, jnp.sum(z), jnp.sum), point)
        except Exception as error:  # as above
            rule = f"an optimiser of optax that needs no more than a cost, its gradient and these options ({error})"
            return [Fault("tune.optimizer", name, rule)]
        return []


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
