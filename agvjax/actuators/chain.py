"""Several elements in a row, which are an element again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import jax
import jax.numpy as jnp


class Chain(Mapping[str, Any]):
    """Elements by name, in the order in which the signal runs: `Chain(delay=Delay(), saturation=Saturation())`.

    A JAX pytree whose leaves are named `delay.time`, `saturation.upper` and so on. Itself an element.
    """

    def __init__(self, **parts: Any):
        self._parts = parts

    def __getitem__(self, name: str) -> Any:
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

    def _run(self, flows: Any, memories: Any, u: Any) -> tuple[Any, dict[str, Any], list[Any]]:
        """What the last one delivers, the derivatives, and the inputs of each."""
        rates, inputs = {}, []
        for name, part in self.items():
            inputs.append(u)
            u, rates[name] = deliver(part, flows[name], memories[name], u)
        return u, rates, inputs

    def init(self, u: Any) -> dict[str, Any]:
        """The continuous states."""
        return self._begin(u)[0]

    def hold(self, u: Any) -> dict[str, Any]:
        """The memories."""
        return self._begin(u)[1]

    def _begin(self, u: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        flows, memories = {}, {}
        for name, part in self.items():
            flows[name], memories[name] = begin(part, u)
            u, _ = deliver(part, flows[name], memories[name], u)
        return flows, memories

    def deliver(self, flow: Any, held: Any, u: Any) -> tuple[Any, dict[str, Any]]:
        """What the last one delivers, and the derivatives of all."""
        return self._run(flow, held, u)[:2]

    def jump(self, flow: Any, held: Any, u: Any, h: Any) -> dict[str, Any]:
        """The memories after the start of a step."""
        memories = {}
        for name, part in self.items():
            memories[name] = part.jump(flow[name], held[name], u, h) if hasattr(part, "jump") else held[name]
            u, _ = deliver(part, flow[name], memories[name], u)
        return memories

    def limited(self, flow: Any, held: Any, u: Any) -> Any:
        """Whether one of them is at its limit."""
        inputs = self._run(flow, held, u)[2]
        found = [at_limit(self[n], flow[n], held[n], x) for n, x in zip(self, inputs, strict=True)]
        return jnp.any(jnp.stack(found))

    def poles(self) -> list[float]:
        """Poles [1/s] of those that have some."""
        return [pole for part in self.values() if hasattr(part, "poles") for pole in part.poles()]


def deliver(part: Any, flow: Any, held: Any, u: Any) -> tuple[Any, Any]:
    """What any element delivers, and the derivative of its state."""
    return part.deliver(flow, held, u) if hasattr(part, "deliver") else (part(u), ())


def at_limit(part: Any, flow: Any, held: Any, u: Any) -> Any:
    """Whether any element is at its limit."""
    if isinstance(part, Chain):
        return part.limited(flow, held, u)
    return part.limited(u) if hasattr(part, "limited") else jnp.zeros((), bool)


def begin(part: Any, u: Any) -> tuple[Any, Any]:
    """State and memory of any element at the start."""
    flow = part.init(u) if hasattr(part, "init") else ()
    return flow, part.hold(u) if hasattr(part, "hold") else ()


def _flatten(chain: Chain) -> tuple[tuple[Any, ...], tuple[str, ...]]:
    return tuple(chain.values()), tuple(chain)


def _flatten_with_keys(chain: Chain) -> tuple[Any, tuple[str, ...]]:
    return tuple((jax.tree_util.DictKey(name), part) for name, part in chain.items()), tuple(chain)


jax.tree_util.register_pytree_with_keys(
    Chain, _flatten_with_keys, lambda names, parts: Chain(**dict(zip(names, parts, strict=True))), _flatten
)
