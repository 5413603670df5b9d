"""Gradients in the mode that costs less."""

from __future__ import annotations

import os
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import PyTree

from .engine.xla import FAST

MOST_FORWARD = 30  # numbers up to which forward mode costs less than reverse mode; see benchmarks/gradient.py
MOST_FAST = 500  # the same with the options for forward mode, under which reverse mode is ten times slower


def value_and_grad(function: Callable[..., PyTree], *, has_aux: bool = False) -> Callable[..., tuple[PyTree, PyTree]]:
    """As `jax.value_and_grad` in the first argument, by the mode that costs less.

    Forward mode, which carries all tangents through one rollout, for up to 30 numbers in that argument, or up to 500
    with the compiler options for forward mode, as `import agvjax` sets them. For the weights of a large network begin
    the process with `tune_xla(reverse=True)`: reverse mode is then taken from 31 numbers on, at full speed.

    Args:
        function: of a tree whose leaves are real numbers, as gains by name or a controller; returns a number, or that
            number and whatever else.
        has_aux: whether it returns something else too.

    Returns:
        A function of the same arguments that returns the value (with `has_aux` the pair) and the gradient, a tree like
        the first argument.
    """

    def both(tree: PyTree, *more: PyTree, **named: PyTree) -> tuple[PyTree, PyTree]:
        flat, shaped = ravel_pytree(tree)
        if flat.size > (MOST_FAST if FAST in os.environ.get("XLA_FLAGS", "") else MOST_FORWARD):
            return jax.value_and_grad(function, has_aux=has_aux)(tree, *more, **named)

        def along(change: jax.Array) -> tuple[PyTree, jax.Array]:
            value, slope, *aux = jax.jvp(
                lambda x: function(shaped(x), *more, **named), (flat,), (change,), has_aux=has_aux
            )
            return (value, *aux) if has_aux else value, slope

        value, slopes = jax.vmap(along, out_axes=(None, 0))(jnp.eye(flat.size, dtype=flat.dtype))
        return value, shaped(slopes)

    return both
