"""Pseudo-random numbers that a loop can afford: a hash of a seed and a place."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from ._pytree import Real


def uniform(seed: Real, count: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """A number in [0, 1) of its seed and place, by a hash of both: cheap enough for a loop."""
    bits = jnp.asarray(count).astype(jnp.uint32) * jnp.uint32(0x9E3779B9) + jnp.asarray(seed).astype(jnp.uint32)
    for shift, factor in ((16, 0x7FEB352D), (15, 0x846CA68B)):
        bits = (bits ^ (bits >> shift)) * jnp.uint32(factor)
    bits = bits ^ (bits >> 16)
    return (bits >> 9).astype(jnp.result_type(count)) / 2**23
