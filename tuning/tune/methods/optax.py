"""The optimisers of optax, and the state that one of them keeps."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any

import jax
import optax

QUASI_NEWTON = "lbfgs"  # searches along a line by itself, so nothing is clipped and no rate decays


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


def chain(name: str, options: Mapping[str, Any], learning_rate: float, iterations: int, clip: float) -> Any:
    """Clipping, then the optimiser with a cosine decay of its learning rate over the run."""
    maker = find_optimizer(name)
    if name == QUASI_NEWTON:
        return maker(**options)
    schedule = optax.cosine_decay_schedule(learning_rate, max(1, iterations))
    return optax.chain(optax.clip_by_global_norm(clip), maker(schedule, **options))


def update(transformation: Any, gradient: Any, state: Any, z: Any, value: Any, cost: Callable[[Any], Any]) -> Any:
    """(z, state) after one step; `cost` is looked at by a method that searches along a line."""
    with jax.numpy_dtype_promotion("standard"):  # optax counts in integers, whatever a process is strict about
        change, state = transformation.update(gradient, state, z, value=value, grad=gradient, value_fn=cost)
        return optax.apply_updates(z, change), state


def looks(state: Any) -> int:
    """How many gradients the last step took beyond the one it was given, in a search along a line."""
    return sum(int(steps) for _, steps in optax.tree_utils.tree_get_all_with_path(state, "num_linesearch_steps"))
