"""The paper's law with every weight of its networks adapted, its rival in Table 1."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._pytree import POSITIVE, Real, number, pytree
from ..messages import Measurement
from .backstepping import Backstepping, BacksteppingState
from .network import RadialBasis


@pytree
class Weights:
    """What the networks of the full-weight law adapt; N and M nodes."""

    W: Float[Array, "N 2"]  # m/s^2, position
    W_psi: Float[Array, " M"]  # rad/s, heading


@pytree
class FullWeightBackstepping(Backstepping):
    """Class law of Table 1 (reading R18): W' = gamma S Zb2' - eta W from W = 0, the network's output cancelled.

    Attributes:
        gamma1: adaptation gain of the position network's weights.
        gamma2: adaptation gain of the heading network's weights.
        eta1: leakage of the position network's adaptation.
        eta2: leakage of the heading network's adaptation.
        position_network: the radial-basis network of the position, whose input is the velocity.
        heading_network: the radial-basis network of the heading.
    """

    gamma1: Real = number(0.1, "1/s^2", POSITIVE, "reading R18")
    gamma2: Real = number(0.1, "1/s^2", POSITIVE, "reading R18")
    eta1: Real = number(0.001, "1/s", POSITIVE, "reading R18")
    eta2: Real = number(0.001, "1/s", POSITIVE, "reading R18")
    position_network: RadialBasis = RadialBasis()
    heading_network: RadialBasis = RadialBasis()

    @classmethod
    def with_nodes(cls, nodes: int, **gains: Any) -> FullWeightBackstepping:
        """Networks of so many nodes, equally spaced from -3 to 3."""
        network = RadialBasis(centers=np.linspace(-3.0, 3.0, nodes))
        return cls(position_network=network, heading_network=network, **gains)

    def start_network(self, zero: Float[Array, ""]) -> Weights:
        """All weights 0."""
        nodes, nodes_psi = (jnp.shape(n.centers)[0] for n in (self.position_network, self.heading_network))
        return Weights(W=jnp.broadcast_to(zero, (nodes, 2)), W_psi=jnp.broadcast_to(zero, (nodes_psi,)))

    def network_terms(self, network: Weights, measurement: Measurement, Zb2: Array, Z3: Array) -> tuple[Array, Array]:
        """W'S, the networks' outputs, eqs. (37) and (60)."""
        S, S_psi = self.position_network(measurement.velocity), self.heading_network(measurement.heading)
        return jnp.sum(network.W * S[:, None], axis=0), jnp.sum(network.W_psi * S_psi)

    def adapt(
        self, network: Weights, measurement: Measurement, Zb2: Array, Z3: Array, inverse: Real, inverse_psi: Real
    ) -> Weights:
        """Reading R18."""
        S, S_psi = self.position_network(measurement.velocity), self.heading_network(measurement.heading)
        return Weights(
            W=self.gamma1 * S[:, None] * Zb2[None, :] - self.eta1 * network.W,
            W_psi=self.gamma2 * S_psi * Z3 - self.eta2 * network.W_psi,
        )

    def decay(self) -> Weights:
        """How fast the weights forget [1/s]."""
        return Weights(W=self.eta1, W_psi=self.eta2)  # pyright: ignore[reportArgumentType]

    def weight_norms(self, flow: BacksteppingState) -> Float[Array, "2"]:
        """Squared norms of the weights, position and heading."""
        return jnp.stack([jnp.sum(flow.network.W**2), jnp.sum(flow.network.W_psi**2)])
