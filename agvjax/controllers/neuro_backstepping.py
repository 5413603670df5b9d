"""The paper's law: command-filtered integral backstepping with one adapted weight norm per channel."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._pytree import NONNEGATIVE, POSITIVE, Real, number, pytree
from ..messages import Measurement
from .backstepping import Backstepping, BacksteppingState
from .network import RadialBasis


@pytree
class WeightNorms:
    """What the network of the one-parameter law adapts."""

    varphi: Real  # estimated squared weight norm, position, eq. (45)
    varphi_psi: Real  # estimated squared weight norm, heading, eq. (67)


@pytree
class NeuroBackstepping(Backstepping):
    """The paper's controller with the paper's gains.

    Attributes:
        gamma1: adaptation gain of the position network's weight norm.
        gamma2: adaptation gain of the heading network's weight norm.
        eta1: leakage of the position network's adaptation.
        eta2: leakage of the heading network's adaptation.
        b1: scale of the position network's term: a smaller b1 gives a larger network gain.
        b2: scale of the heading network's term: a smaller b2 gives a larger network gain.
        varphi_start: initial estimate of the position network's squared weight norm.
        varphi_psi_start: initial estimate of the heading network's squared weight norm.
        position_network: the radial-basis network of the position, whose input is the velocity.
        heading_network: the radial-basis network of the heading.
    """

    gamma1: Real = number(0.1, "s^2/m^2", POSITIVE, "eq. (45)")
    gamma2: Real = number(0.1, "1/rad^2", POSITIVE, "eq. (67)")
    eta1: Real = number(0.001, "1/s", POSITIVE, "eq. (45)")
    eta2: Real = number(0.001, "1/s", POSITIVE, "eq. (67)")
    b1: Real = number(1.0, "s^0.5", POSITIVE, "eq. (41), reading R10")
    b2: Real = number(1.0, "s^0.5", POSITIVE, "eq. (63), reading R10")
    varphi_start: Real = number(0.1, "1", NONNEGATIVE, "sec. 4")
    varphi_psi_start: Real = number(0.1, "1", NONNEGATIVE, "sec. 4")
    position_network: RadialBasis = RadialBasis()
    heading_network: RadialBasis = RadialBasis()

    def start_network(self, zero: Float[Array, ""]) -> WeightNorms:
        """Both estimates at their start."""
        return WeightNorms(varphi=zero + self.varphi_start, varphi_psi=zero + self.varphi_psi_start)

    def network_terms(
        self, network: WeightNorms, measurement: Measurement, Zb2: Array, Z3: Array
    ) -> tuple[Array, Array]:
        """Zb2 varphi S'S / (2 b1^2) of eq. (41) and Z3 varphi_psi S'S / (2 b2^2) of eq. (63)."""
        share, share_psi = self.shares(measurement)
        return Zb2 * network.varphi * share, Z3 * network.varphi_psi * share_psi

    def adapt(
        self, network: WeightNorms, measurement: Measurement, Zb2: Array, Z3: Array, inverse: Real, inverse_psi: Real
    ) -> WeightNorms:
        """Eqs. (45) and (67), one estimate for both axes of the position (reading R12)."""
        share, share_psi = self.shares(measurement)
        return WeightNorms(
            varphi=self.gamma1 * jnp.sum(Zb2**2 * inverse) * share - self.eta1 * network.varphi,
            varphi_psi=self.gamma2 * Z3**2 * share_psi * inverse_psi - self.eta2 * network.varphi_psi,
        )

    def decay(self) -> WeightNorms:
        """How fast the estimates forget [1/s]."""
        return WeightNorms(varphi=self.eta1, varphi_psi=self.eta2)

    def shares(self, measurement: Measurement) -> tuple[Array, Array]:
        """S'S / (2 b1^2) of the position network, whose input is chi2, and of the heading network (reading R11)."""
        share = self.position_network.energy(measurement.velocity) * (0.5 / self.b1**2)
        return share, self.heading_network.energy(measurement.heading) * (0.5 / self.b2**2)

    def weight_norms(self, flow: BacksteppingState) -> Float[Array, "2"]:
        """The two adapted estimates, position and heading (Figs. 10, 11)."""
        return jnp.stack([flow.network.varphi, flow.network.varphi_psi])
