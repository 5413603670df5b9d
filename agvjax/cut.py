"""A loop cut open at its actuators: what delivers in their place, what of them stays, and its state as one array."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ._pytree import pytree
from .actuators.chain import Chain
from .actuators.deadzone import Deadzone
from .actuators.elements import Backlash, Delay, Quantisation
from .engine.rollout import Carry
from .protocols import Element


@pytree
class Cut(Element):
    """Delivers a value, whatever it is asked for."""

    value: Array

    def __call__(self, u: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """The value."""
        return self.value


def numbers(carry: Carry) -> tuple[Array, Callable[[Array], Carry]]:
    """All that may vary a little, as one array, and back."""
    leaves, tree = jax.tree.flatten((carry.flow, carry.memory))
    moves = [jnp.issubdtype(x.dtype, jnp.floating) for x in leaves]

    def whole(x: Array) -> Carry:
        found, at = [], 0
        for leaf, m in zip(leaves, moves, strict=True):
            found.append(x[at : at + leaf.size].reshape(leaf.shape) if m else leaf)
            at += leaf.size if m else 0
        flow, memory = jax.tree.unflatten(tree, found)
        return dataclasses.replace(carry, flow=flow, memory=memory)

    return jnp.concatenate([jnp.ravel(x) for x, m in zip(leaves, moves, strict=True) if m]), whole


def tangent(zone: Element, u: Array) -> tuple[Array, Array]:
    """What is delivered of an input, and its slope: that of its side within a threshold too."""
    slope = zone.slope(u) if isinstance(zone, Deadzone) else jax.jvp(zone, (u,), (jnp.ones_like(u),))[1]
    return zone(u), slope + jnp.zeros_like(u)


def late(element: Element) -> Any:
    """How late [s] all delays of an element together are, with their jitter."""
    return sum(part.time + part.jitter for _, part in element.elements("") if isinstance(part, Delay))


def without(element: Element | None) -> Element | None:
    """An element without what is linearised elsewhere, or counts as 1; None where nothing is left."""
    if isinstance(element, Chain):
        parts = {name: without(part) for name, part in element.items()}
        kept = {name: part for name, part in parts.items() if part is not None}
        return Chain(**kept) if kept else None
    return None if isinstance(element, (Delay, Backlash, Quantisation)) else element


def _part(kept: Element, tree: PyTree) -> PyTree:
    """State or memory of what is kept of an element."""
    return {name: _part(part, tree[name]) for name, part in kept.items()} if isinstance(kept, Chain) else tree


def carried(carry: Carry, chains: dict[str, Element | None]) -> Carry:
    """States and memories of the parts that are kept."""

    def of(tree: dict[str, PyTree]) -> dict[str, PyTree]:
        return {
            name: () if kept is None else {"deadzone": (), "rest": _part(kept, tree[name]["rest"])}
            for name, kept in chains.items()
        }

    flow = dataclasses.replace(carry.flow, actuators=of(carry.flow.actuators))
    return dataclasses.replace(
        carry, flow=flow, memory=dataclasses.replace(carry.memory, actuators=of(carry.memory.actuators))
    )
