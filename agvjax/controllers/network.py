"""Gaussian radial-basis network, eqs. (19)-(20)."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._pytree import ANY, POSITIVE, Numbers, Real, number, pytree


@pytree
class RadialBasis:
    """Eq. (20). Nodes on the diagonal of the input space: node i is at centers[i] in every coordinate (reading R11).

    Attributes:
        centers: centre of each node.
        width: width of the nodes: activations are exp(-distance^2 / width).
    """

    centers: Float[Numbers, " N"] = number(
        (-3.0, -1.5, 0.0, 1.5, 3.0), "unit of the input", ANY, "sec. 4", shape=(None,)
    )
    width: Real = number(0.5, "unit of the input, squared", POSITIVE, "eq. (20), the divisor as printed (reading R11)")

    def __call__(self, chi: Float[Array, "*q"]) -> Float[Array, " N"]:
        """Eq. (20). Activations S of the N nodes for an input of shape () or (q,)."""
        return jnp.exp(self._exponent(chi))

    def energy(self, chi: Float[Array, "*q"]) -> Float[Array, ""]:
        """S'S, the only form in which the one-parameter laws (41), (45), (63), (67) use the network."""
        return jnp.sum(jnp.exp(2 * self._exponent(chi)))

    def _exponent(self, chi: Float[Array, "*q"]) -> Float[Array, " N"]:
        offset = jnp.atleast_1d(chi)[:, None] - jnp.asarray(self.centers)[None, :]
        return jnp.sum(offset**2, axis=0) * (
            -1 / self.width
        )  # the reciprocal leaves the hot loop, a division would not
