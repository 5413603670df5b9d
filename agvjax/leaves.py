"""Dotted names of the leaves of controllers and scenarios: `deadzone.position.threshold_right`."""

from __future__ import annotations

import dataclasses
import difflib
import functools
from collections.abc import Iterable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike, DTypeLike
from jaxtyping import PyTree

from ._pytree import Rule
from .schedule import Schedule


def cast(tree: PyTree, dtype: DTypeLike) -> PyTree:
    """The tree with its real numbers (Python and NumPy integers too) in `dtype`; keys, counts and flags as they are."""

    def one(leaf: ArrayLike) -> ArrayLike:
        real = jnp.issubdtype(jnp.result_type(leaf), jnp.floating) or jnp.issubdtype(
            jnp.result_type(leaf), jnp.signedinteger
        )
        return jnp.asarray(leaf, dtype) if real else leaf

    return jax.tree.map(one, with_arrays(tree))


def with_arrays(tree: PyTree) -> PyTree:
    """The tree with an array wherever a field for numbers holds a list or a tuple of them, as a person writes it."""
    written = {}
    for name, value in children(tree).items():
        if isinstance(value, (list, tuple)) and "rule" in metadata_of(tree, name):
            written[name] = jnp.asarray(value)
        elif children(value):
            written[name] = with_arrays(value)
    return swap(tree, written) if written else tree


def children(node: PyTree) -> dict[str, PyTree]:
    """The named parts of a dataclass or a dictionary; empty for a leaf."""
    if dataclasses.is_dataclass(node):
        return {name: getattr(node, name) for name, beside in _fields(type(node)).items() if not beside.get("static")}
    return dict(node) if isinstance(node, Mapping) else {}


@functools.cache
def _fields(kind: type) -> dict[str, Mapping[str, Any]]:
    """What is written beside each field of a dataclass; empty of any other class."""
    return {f.name: f.metadata for f in dataclasses.fields(kind)} if dataclasses.is_dataclass(kind) else {}


def leaves(tree: PyTree, prefix: str = "") -> dict[str, PyTree]:
    """Every leaf by its dotted name."""
    named = {}
    for name, part in children(tree).items():
        if children(part):
            named |= leaves(part, f"{prefix}{name}.")
        elif part is not None and not dataclasses.is_dataclass(part) and not isinstance(part, Mapping):
            named[prefix + name] = part
    return named


def replace(tree: PyTree, values: Mapping[str, PyTree]) -> PyTree:
    """A copy of the tree with the named leaves replaced.

    Raises:
        KeyError: a name is no leaf of the tree; the message names the nearest ones.
    """
    known = leaves(tree)
    for name in values:
        if name not in known:
            near = difflib.get_close_matches(name, known, 3, 0.4) or sorted(known)
            raise KeyError(f"{name} is no leaf of {type(tree).__name__}; did you mean {' or '.join(near)}?")
    return swap(tree, values)


def get(tree: PyTree, name: str) -> PyTree:
    """The leaf of a dotted name."""
    for part in name.split("."):
        tree = children(tree)[part]
    return tree


def element(name: str) -> tuple[str, int | None]:
    """`position_network.centers[0]` -> the name of the leaf, and which element of it; None: the leaf itself."""
    leaf, bracket, place = name.removesuffix("]").partition("[")
    return (leaf, int(place)) if bracket and place.isdecimal() else (name, None)


def rule_of(tree: PyTree, name: str) -> Rule | None:
    """The rule written beside the field of a dotted name; None where there is none."""
    return metadata_of(tree, name).get("rule")


def fits(tree: PyTree, name: str, shape: tuple[int, ...]) -> bool:
    """Whether the leaf of a dotted name may be an array of this shape; where no shapes are written, any."""
    return any(
        s == shape or (s == (None,) and len(shape) == 1) for s in metadata_of(tree, name).get("shapes", (shape,))
    )


def misshapen(tree: PyTree) -> str:
    """Name, shape and what it may be of the first number that has another shape than its field; empty without one."""
    for name, value in leaves(tree).items():
        shape = np.shape(value)
        if not fits(tree, name, shape):
            allowed = " or ".join(str(s).replace("None", "N") for s in metadata_of(tree, name)["shapes"])
            return f"{name} must have the shape {allowed}; got {shape}"
    return ""


def spread(tree: PyTree, names: Iterable[str]) -> tuple[str, ...]:
    """Names of single numbers, of a schedule those of all its values: `k1` -> `k1.values[0]`, `k1.values[1]`."""
    known, each = leaves(tree), []
    for name in names:
        values = known.get(f"{name}.values")
        each += [name] if values is None else [f"{name}.values[{i}]" for i in range(np.size(values))]
    return tuple(each)


def stands_for(tree: PyTree, name: str) -> str:
    """`k1.values[0]` -> `k1`, the number that a schedule with this value stands for; any other name is its own."""
    leaf, _ = element(name)
    holder = leaf.removesuffix(".values")
    return holder if holder != leaf and isinstance(get(tree, holder), Schedule) else name


def unit_of(tree: PyTree, name: str) -> str:
    """The unit written beside the field of a dotted name; empty where there is none."""
    return metadata_of(tree, name).get("unit", "")


def metadata_of(tree: PyTree, name: str) -> Mapping[str, Any]:
    """What is written beside the field of a dotted name: rule, unit, source; empty where there is no such field."""
    *parents, last = [name] if name in children(tree) else name.split(".")  # a dictionary's name may have dots
    holder = get(tree, ".".join(parents)) if parents else tree
    found = _fields(type(holder)).get(last, {})
    if parents and isinstance(holder, Schedule) and last == "values":  # their rule and unit are those of the number
        return {**found, **metadata_of(tree, ".".join(parents)), "shapes": found["shapes"], "above": ""}
    return found


def swap(node: PyTree, values: Mapping[str, PyTree]) -> PyTree:
    """`replace` for names known to exist."""
    heads: dict[str, dict[str, PyTree]] = {}
    for name, value in values.items():
        head, _, tail = name.partition(".")
        heads.setdefault(head, {})[tail] = value
    parts = children(node)
    new = {h: tails[""] if "" in tails else swap(parts[h], tails) for h, tails in heads.items()}
    return type(node)(**{**node, **new}) if isinstance(node, Mapping) else dataclasses.replace(node, **new)
