"""Several elements in a row, which are an element again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree

from ..protocols import Element, Reach


class Chain(Element, Mapping[str, Element]):
    """Elements by name, in the order in which the signal runs: `Chain(delay=Delay(), saturation=Saturation())`.

    A JAX pytree whose leaves are named `delay.time`, `saturation.upper` and so on. States and memories are dictionaries
    with the same names.
    """

    def __init__(self, /, **parts: Element):  # an element may be called self
        self._parts = parts

    def __getitem__(self, name: str) -> Element:
        """The element of a name."""
        return self._parts[name]

    def __iter__(self) -> Iterator[str]:
        """Names in order."""
        return iter(self._parts)

    def __len__(self) -> int:
        """Number of elements."""
        return len(self._parts)

    def __repr__(self) -> str:
        """As it is written."""
        return f"Chain({', '.join(f'{name}={part!r}' for name, part in self.items())})"

    def init(self, u: Float[Array, "*n"]) -> dict[str, PyTree]:
        """The states at the start."""
        return self._begin(u)[0]

    def hold(self, u: Float[Array, "*n"]) -> dict[str, PyTree]:
        """The memories before the first step."""
        return self._begin(u)[1]

    def _begin(self, u: Array) -> tuple[dict[str, PyTree], dict[str, PyTree]]:
        flows, memories = {}, {}
        for name, part in self.items():
            flows[name], memories[name] = part.init(u), part.hold(u)
            u, _ = part.deliver(flows[name], memories[name], u)
        return flows, memories

    def deliver(
        self, flow: dict[str, PyTree], memory: dict[str, PyTree], u: Float[Array, "*n"]
    ) -> tuple[Float[Array, "*n"], dict[str, PyTree]]:
        """What the last one delivers, and the derivatives of all."""
        rates = {}
        for name, part in self.items():
            u, rates[name] = part.deliver(flow[name], memory[name], u)
        return u, rates

    def jump(
        self, flow: dict[str, PyTree], memory: dict[str, PyTree], u: Float[Array, "*n"], h: Array
    ) -> dict[str, PyTree]:
        """The memories for the step that begins; each element sees what the renewed ones before it deliver."""
        memories = {}
        for name, part in self.items():
            memories[name] = part.jump(flow[name], memory[name], u, h)
            u, _ = part.deliver(flow[name], memories[name], u)
        return memories

    def limited(self, flow: dict[str, PyTree], memory: dict[str, PyTree], u: Float[Array, "*n"]) -> Bool[Array, ""]:
        """Whether one of them is at its limit."""
        limited = []
        for name, part in self.items():
            limited.append(part.limited(flow[name], memory[name], u))
            u, _ = part.deliver(flow[name], memory[name], u)
        return jnp.any(jnp.stack(limited))

    def elements(self, key: str) -> Iterator[tuple[str, Element]]:
        """All of them, also those of chains in the chain."""
        for name, part in self.items():
            yield from part.elements(f"{key}.{name}")

    def reach(self, asked: Reach) -> Reach:
        """Through one after the other."""
        for part in self.values():
            asked = part.reach(asked)
        return asked


def _flatten(chain: Chain) -> tuple[tuple[Element, ...], tuple[str, ...]]:
    return tuple(chain.values()), tuple(chain)


def _flatten_with_keys(chain: Chain) -> tuple[tuple[tuple[PyTree, Element], ...], tuple[str, ...]]:
    return tuple((jax.tree_util.DictKey(name), part) for name, part in chain.items()), tuple(chain)


jax.tree_util.register_pytree_with_keys(
    Chain, _flatten_with_keys, lambda names, parts: Chain(**dict(zip(names, parts, strict=True))), _flatten
)
