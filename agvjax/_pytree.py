"""The dataclass every object of the package is made with: frozen, a JAX pytree, its numbers documented in place."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, dataclass_transform

import jax
import numpy as np
from jaxtyping import Array, Float

T = TypeVar("T")
Real = float | Float[Array, ""]  # a number of an object: as a person writes it, or traced
Numbers = Array | np.ndarray  # several


class Rule(NamedTuple):
    """What a number must satisfy: the words for a person, the test on a NumPy array, and the interval it means."""

    text: str
    holds: Callable[[np.ndarray], Any]
    low: float = -np.inf
    high: float = np.inf


POSITIVE = Rule("> 0", lambda x: x > 0, 0.0)
NONNEGATIVE = Rule(">= 0", lambda x: x >= 0, 0.0)
FRACTION = Rule("> 0 and < 1", lambda x: (x > 0) & (x < 1), 0.0, 1.0)
ANY = Rule("finite", lambda x: np.isfinite(x))


def number(
    default: Any,
    unit: str = "1",
    rule: Rule = ANY,
    source: str = "",
    shape: tuple[int | None, ...] = (),
    above: str = "",
) -> Any:
    """A traced leaf: its default, unit, rule and source; `shape` names the array it may be besides a scalar.

    A `None` in `shape` stands for any length. A leaf whose default is an array must be one, and the default is copied
    for each object. `above` names another field of the object that this one must lie above.
    """
    several = isinstance(default, (list, tuple))
    metadata = {"unit": unit, "rule": rule, "source": source, "above": above}
    metadata["shapes"] = (shape,) if several else ((), shape)
    if several:
        return dataclasses.field(default_factory=lambda: np.array(default, float), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def structure(default: Any) -> Any:
    """A static field: a choice of form or a count, part of the tree's structure and never traced."""
    return dataclasses.field(default=default, metadata={"static": True})


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(dataclasses.field,))
def pytree(cls: type[T]) -> type[T]:
    """Make a class a frozen keyword-only dataclass that JAX treats as a tree of its fields.

    Nothing is validated or cast on construction: JAX rebuilds these objects around tracers. See `agvjax.check`.

    Not by `jax.tree_util.register_dataclass`: JAX from 0.10 to 0.12 takes trees for equal that differ only in the
    types of such nodes, so that now and then `jit` runs on one vehicle what was compiled for another.

    NumPy arrays are handed to JAX as views: it keeps what it makes of an array under the array itself (0.10), and while
    that is in use, by a jitted function or an exception, single precision would be given what was made in double.
    """
    made: Any = dataclasses.dataclass(frozen=True, eq=False, kw_only=True)(cls)
    fields = dataclasses.fields(made)
    leaves = tuple(f.name for f in fields if not f.metadata.get("static"))
    statics = tuple(f.name for f in fields if f.metadata.get("static"))
    keys = tuple(map(jax.tree_util.GetAttrKey, leaves))

    def flatten(x: Any) -> Any:
        values = [value.view() if type(value := getattr(x, name)) is np.ndarray else value for name in leaves]
        return tuple(values), tuple(getattr(x, name) for name in statics)

    def flatten_with_keys(x: Any) -> Any:
        children, static = flatten(x)
        return tuple(zip(keys, children, strict=True)), static

    def unflatten(static: Any, children: Any) -> T:
        return made(**dict(zip(leaves, children, strict=True)), **dict(zip(statics, static, strict=True)))

    jax.tree_util.register_pytree_with_keys(made, flatten_with_keys, unflatten, flatten)
    return made
