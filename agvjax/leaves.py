"""Dotted names of the leaves of controllers and scenarios: `deadzone.position.threshold_right`."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp


def cast(tree: Any, dtype: Any) -> Any:
    """The tree with its real numbers (Python and NumPy integers too) in `dtype`; keys, counts and flags as they are."""

    def one(leaf: Any) -> Any:
        real = jnp.issubdtype(jnp.result_type(leaf), jnp.floating) or jnp.issubdtype(
            jnp.result_type(leaf), jnp.signedinteger
        )
        return jnp.asarray(leaf, dtype) if real else leaf

    return jax.tree.map(one, tree)


def children(node: Any) -> dict[str, Any]:
    """The named parts of a dataclass or a dictionary; empty for a leaf."""
    if dataclasses.is_dataclass(node):
        return {f.name: getattr(node, f.name) for f in dataclasses.fields(node) if not f.metadata.get("static")}
    return dict(node) if isinstance(node, Mapping) else {}


def leaves(tree: Any, prefix: str = "") -> dict[str, Any]:
    """Every leaf by its dotted name."""
    named = {}
    for name, part in children(tree).items():
        if children(part):
            named |= leaves(part, f"{prefix}{name}.")
        elif part is not None and not dataclasses.is_dataclass(part) and not isinstance(part, Mapping):
            named[prefix + name] = part
    return named


def replace(tree: Any, values: Mapping[str, Any]) -> Any:
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


def get(tree: Any, name: str) -> Any:
    """The leaf of a dotted name."""
    for part in name.split("."):
        tree = children(tree)[part]
    return tree


def rule_of(tree: Any, name: str) -> Any:
    """The rule written beside the field of a dotted name; None where there is none."""
    return _metadata(tree, name).get("rule")


def unit_of(tree: Any, name: str) -> str:
    """The unit written beside the field of a dotted name; empty where there is none."""
    return _metadata(tree, name).get("unit", "")


def _metadata(tree: Any, name: str) -> Mapping[str, Any]:
    *parents, last = name.split(".")
    holder = get(tree, ".".join(parents)) if parents else tree
    fields = dataclasses.fields(holder) if dataclasses.is_dataclass(holder) else ()
    return next((f.metadata for f in fields if f.name == last), {})


def swap(node: Any, values: Mapping[str, Any]) -> Any:
    """`replace` for names known to exist."""
    heads: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        head, _, tail = name.partition(".")
        heads.setdefault(head, {})[tail] = value
    parts = children(node)
    new = {h: tails[""] if "" in tails else swap(parts[h], tails) for h, tails in heads.items()}
    return type(node)(**{**node, **new}) if isinstance(node, Mapping) else dataclasses.replace(node, **new)
