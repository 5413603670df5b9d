"""The paper's law: command-filtered integral backstepping with one adapted weight norm per channel."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._pytree import NONNEGATIVE, POSITIVE, number, pytree, structure
from ..angle import wrap
from ..path import Reference
from ..plant import Command, Measurement
from ..rbf import RadialBasis


@pytree
class BacksteppingState:
    """Continuous state of the law."""

    phi1: Float[Array, "2"]  # m/s, filtered virtual control, eq. (22)
    phi2: Float[Array, "2"]  # m/s, eq. (22)
    xi1: Float[Array, "2"]  # m, filtering-error compensation, eq. (23)
    xi2: Float[Array, "2"]  # m/s, eq. (23)
    beta1: Float[Array, "2"]  # m s, integral of Z1, eq. (25)
    varphi: Float[Array, ""]  # estimated squared weight norm, position, eq. (45)
    beta2: Float[Array, ""]  # rad s, integral of Z3, eq. (57)
    varphi_psi: Float[Array, ""]  # estimated squared weight norm, heading, eq. (67)


@pytree
class CommandFilter:
    """Eq. (22) as the standard command filter: natural frequency omega_n, damping zeta (reading R5, the default)."""

    def __call__(self, phi1: Array, phi2: Array, alpha1: Array, omega_n: Array, zeta: Array) -> tuple[Array, Array]:
        """Derivatives of phi1 and phi2."""
        return omega_n * phi2, -2 * zeta * omega_n * phi2 - omega_n * (phi1 - alpha1)

    def poles(self, omega_n: float, zeta: float) -> np.ndarray:
        """Roots of s^2 + 2 zeta omega_n s + omega_n^2 [1/s]."""
        return np.roots([1.0, 2 * zeta * omega_n, omega_n**2])


@pytree
class LiteralFilter:
    """Eq. (22) as printed: natural frequency omega_n^1.5, damping zeta / omega_n^0.5 (reading R5, selectable)."""

    def __call__(self, phi1: Array, phi2: Array, alpha1: Array, omega_n: Array, zeta: Array) -> tuple[Array, Array]:
        """Derivatives of phi1 and phi2."""
        return omega_n * phi2, -2 * zeta * omega_n * phi2 - omega_n**2 * (phi1 - alpha1)

    def poles(self, omega_n: float, zeta: float) -> np.ndarray:
        """Roots of s^2 + 2 zeta omega_n s + omega_n^3 [1/s]."""
        return np.roots([1.0, 2 * zeta * omega_n, omega_n**3])


@pytree
class NeuroBackstepping:
    """The paper's controller with the paper's gains.

    `Pi_hat` and `Pi_psi_hat` are the controller's belief of the deadzone slopes, apart from the plant's truth
    (readings R2, R3); `Pi_hat` may have shape (2,), one belief per axis.
    """

    k1: float = number(20.0, "1/s", POSITIVE, "after eq. (32)")
    k2: float = number(20.0, "1/s", POSITIVE, "eq. (41)")
    k3: float = number(12.0, "1/s", POSITIVE, "eq. (63)")
    Lam: float = number(16.0, "1/s^2", NONNEGATIVE, "after eq. (32)")
    Lam_psi: float = number(9.0, "1/s^2", NONNEGATIVE, "eq. (63)")
    omega_n: float = number(90.0, "rad/s", POSITIVE, "eq. (22)")
    zeta: float = number(0.75, "1", POSITIVE, "eq. (22), reading R6")
    gamma1: float = number(0.1, "s^2/m^2", POSITIVE, "eq. (45)")
    gamma2: float = number(0.1, "1/rad^2", POSITIVE, "eq. (67)")
    eta1: float = number(0.001, "1/s", POSITIVE, "eq. (45)")
    eta2: float = number(0.001, "1/s", POSITIVE, "eq. (67)")
    b1: float = number(1.0, "s^0.5", POSITIVE, "eq. (41), reading R10")
    b2: float = number(1.0, "s^0.5", POSITIVE, "eq. (63), reading R10")
    Pi_hat: float = number(1.0, "1", POSITIVE, "eqs. (41), (45), readings R2, R3", shape=(2,))
    Pi_psi_hat: float = number(1.0, "1", POSITIVE, "eqs. (63), (67), readings R2, R3")
    varphi_start: float = number(0.1, "1", NONNEGATIVE, "sec. 4")
    varphi_psi_start: float = number(0.1, "1", NONNEGATIVE, "sec. 4")
    position_network: RadialBasis = RadialBasis()
    heading_network: RadialBasis = RadialBasis()
    filter: CommandFilter | LiteralFilter = CommandFilter()
    wrapped: bool = structure(True)  # reading R17: the paper never wraps Z3

    def init(self, measurement: Measurement, reference: Reference) -> BacksteppingState:
        """The state of a law that starts now: the filter at its input, integrals and compensation at 0."""
        zero, none = jnp.zeros_like(measurement.position), jnp.zeros_like(measurement.heading)
        return BacksteppingState(
            phi1=self.virtual_control(measurement.position - reference.position, zero, reference),  # after (22)
            phi2=zero,
            xi1=zero,
            xi2=zero,
            beta1=zero,
            varphi=none + self.varphi_start,
            beta2=none,
            varphi_psi=none + self.varphi_psi_start,
        )

    def virtual_control(self, Z1: Array, beta1: Array, reference: Reference) -> Float[Array, "2"]:
        """After eq. (32). The velocity that would close the position error [m/s]."""
        return -self.k1 * Z1 + reference.velocity - self.Lam * beta1

    def law(
        self, flow: BacksteppingState, held: object, measurement: Measurement, reference: Reference
    ) -> tuple[Command, BacksteppingState]:
        """Commands before the deadzone, and the derivative of the law's own state."""
        s = flow
        Z1 = measurement.position - reference.position  # (21)
        Z2 = measurement.velocity - s.phi1  # (21)
        alpha1 = self.virtual_control(Z1, s.beta1, reference)
        phi1_rate, phi2_rate = self.filter(s.phi1, s.phi2, alpha1, self.omega_n, self.zeta)  # (22)  # pyright: ignore
        xi1_rate = s.xi2 + (s.phi1 - alpha1) - self.k1 * s.xi1  # (23)
        xi2_rate = -self.k2 * s.xi2  # (23); 0 forever from its start at 0 (reading R7)
        Zb2 = Z2 - s.xi2  # (24); Zb1 = Z1 - xi1 enters no law

        # one reciprocal a gain leaves the hot loop, a division by it would not
        inverse, inverse_psi = 1 / self.Pi_hat, 1 / self.Pi_psi_hat
        share = self.position_network.energy(measurement.velocity) * (0.5 / self.b1**2)  # S'S / (2 b1^2), reading R11
        U_bar = -self.k2 * Zb2 - Zb2 * s.varphi * share * inverse + phi1_rate * inverse  # (41)
        varphi_rate = self.gamma1 * jnp.sum(Zb2**2 * inverse) * share - self.eta1 * s.varphi  # (45), reading R12

        Z3 = measurement.heading - reference.heading  # (57)
        Z3 = wrap(Z3) if self.wrapped else Z3
        share = self.heading_network.energy(measurement.heading) * (0.5 / self.b2**2)
        pull = Z3 * s.varphi_psi * share - reference.heading_rate + self.Lam_psi * s.beta2
        omega_bar = -self.k3 * Z3 - pull * inverse_psi  # (63)
        varphi_psi_rate = self.gamma2 * Z3**2 * share * inverse_psi - self.eta2 * s.varphi_psi  # (67)

        rate = BacksteppingState(
            phi1=phi1_rate,
            phi2=phi2_rate,
            xi1=xi1_rate,
            xi2=xi2_rate,
            beta1=Z1,  # (25)
            varphi=varphi_rate,
            beta2=Z3,  # (57)
            varphi_psi=varphi_psi_rate,
        )
        return Command(position=U_bar, heading=omega_bar), rate

    def weight_norms(self, flow: BacksteppingState) -> Float[Array, "2"]:
        """The two adapted estimates, position and heading (Figs. 10, 11)."""
        return jnp.stack([flow.varphi, flow.varphi_psi])

    def poles(self) -> np.ndarray:
        """Poles of the fastest part, the command filter [1/s]; the integrator's step must suit them."""
        return self.filter.poles(float(self.omega_n), float(self.zeta))

    def stability_bounds(self, Pi_min: float, Pi_psi_min: float) -> dict[str, float]:
        """What k1, k2 and k3 must exceed, from eqs. (48), (52) and (70), for the smallest true deadzone slopes."""
        return {"k1": 1.0, "k2": max(0.5, 0.5 / Pi_min), "k3": 0.5 / Pi_psi_min}
