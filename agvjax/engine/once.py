"""Operations on scalars, each bound once, and those that differ from JAX's own."""

from __future__ import annotations

import functools
from collections.abc import Callable, Hashable
from typing import Any

import jax
import numpy as np
from jax import lax
from jax.extend import core

Scalar = jax.Array | np.ndarray | np.generic


def _token(x: Scalar) -> Hashable:
    """Equal for equal numbers; a tracer, which `Once` keeps alive, is equal to itself alone."""
    return (np.dtype(x.dtype).str, x.tobytes()) if isinstance(x, (np.generic, np.ndarray)) else id(x)


class Once:
    """Scalar operations, each bound once: a law asked twice at one instant costs no second trace."""

    def __init__(self) -> None:
        self.known: dict[Hashable, tuple[Any, tuple[Scalar, ...]]] = {}

    def bind(
        self,
        primitive: core.Primitive,
        params: dict[str, object],
        inputs: tuple[Scalar, ...],
        function: Callable[..., Any] | None = None,
    ) -> Any:
        """The primitive, or the `function` that stands for it, on these numbers."""
        function = functools.partial(primitive.bind, **params) if function is None else function
        try:
            key = (primitive, tuple(params.items()), tuple(map(_token, inputs)))
            hash(key)
        except (TypeError, AttributeError):  # parameters or numbers that cannot be compared
            return function(*inputs)
        if key not in self.known:
            self.known[key] = (function(*inputs), inputs)
        return self.known[key][0]


def plain(primitive: core.Primitive) -> Callable[..., Scalar]:
    """An operation on two numbers as it is."""
    return lambda once, x, y: once.bind(primitive, {}, (x, y))


def extreme(primitive: core.Primitive, beyond: core.Primitive) -> Callable[..., Scalar]:
    """Max or min whose slope is that of the number chosen, by a comparison; NaN on either side goes on as before.

    JAX's own derivative asks which of both equals the result. The compiler may compute a number twice, rounded in two
    ways, and then neither does: the slope would be 0, without a word. With a constant the value is a choice, too, which
    is cheaper than XLA's, that asks for NaN on either side.
    """

    @jax.custom_jvp
    def chosen(x: jax.Array, y: jax.Array) -> jax.Array:
        return primitive.bind(x, y)

    @chosen.defjvp
    def _(numbers: tuple[jax.Array, jax.Array], changes: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        return chosen(*numbers), lax.select(beyond.bind(*numbers), *changes)

    def bind(once: Once, x: Scalar, y: Scalar) -> Scalar:
        if isinstance(x, np.ndarray):
            x, y = y, x
        if isinstance(x, np.ndarray) or (isinstance(y, np.ndarray) and np.isnan(y)):
            return once.bind(primitive, {}, (x, y))
        if isinstance(y, np.ndarray):
            return once.bind(lax.select_n_p, {}, (once.bind(beyond, {}, (y, x)), x, y))
        return once.bind(primitive, {}, (x, y), chosen if np.issubdtype(x.dtype, np.inexact) else None)

    return bind
