"""The skeleton of the paper's law: command-filtered integral backstepping, with a place for a network.

`Backstepping` itself has no network: it is the paper's law with (41) and (63) cut short, one of its ablations.
`NeuroBackstepping` and `FullWeightBackstepping` fill the place.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PyTree

from .._pytree import NONNEGATIVE, POSITIVE, Real, number, pytree, structure
from ..geometry import wrap
from ..integrate import largest
from ..messages import Command, Measurement, Reference
from ..protocols import Law, Stable
from .filters import CommandFilter, Filtered, LiteralFilter, NoFilter


@pytree
class BacksteppingState:
    """Continuous state of the law."""

    phi1: Float[Array, "2"]  # m/s, filtered virtual control, eq. (22)
    phi2: Float[Array, "2"]  # m/s, eq. (22)
    xi1: Float[Array, "2"]  # m, filtering-error compensation, eq. (23)
    xi2: Float[Array, "2"]  # m/s, eq. (23)
    beta1: Float[Array, "2"]  # m s, integral of Z1, eq. (25)
    beta2: Float[Array, ""]  # rad s, integral of Z3, eq. (57)
    network: PyTree  # what is adapted; () without a network


@pytree
class KnownSlopes:
    """The true slopes of a deadzone, known to the law; the sign of the command selects one (readings R2, R3).

    The sign depends on the slope and the slope on the sign. Where both signs are consistent the right one is taken,
    where neither is, the command is 0.
    """

    right: Real = number(1.0, "1", POSITIVE, "eq. (13)")
    left: Real = number(1.0, "1", POSITIVE, "eq. (13)")


def _divided(belief: Real | KnownSlopes, feedback: Array, rest: Array) -> tuple[Array, Real]:
    """The command feedback + rest / Pi, and 1 / Pi, for a slope Pi that is assumed constant or known by sign."""
    if not isinstance(belief, KnownSlopes):
        inverse = 1 / belief  # one reciprocal a gain leaves the hot loop, a division by it would not
        return feedback + rest * inverse, inverse
    inverse_right, inverse_left = 1 / belief.right, 1 / belief.left
    right, left = feedback + rest * inverse_right, feedback + rest * inverse_left
    u = jnp.where(right > 0, right, jnp.minimum(left, 0))
    return u, jnp.where(u > 0, inverse_right, inverse_left)


def _bounded(alpha1: Array, velocity: Array, limit: Real | None) -> tuple[Array, Bool[Array, ""]]:
    """alpha1 with its correction to the path's velocity no longer than `limit`, and whether it was."""
    if limit is None:
        return alpha1, jnp.zeros((), bool)
    correction = alpha1 - velocity
    square = jnp.sum(correction**2)
    met = square > limit**2
    return velocity + correction * jnp.where(met, limit / jnp.sqrt(jnp.where(met, square, 1.0)), 1.0), met


@pytree
class Backstepping(Law):
    """Eqs. (21)-(25), (41), (57), (63) without the network, with the paper's gains.

    `Pi_hat` and `Pi_psi_hat` are the deadzone slopes that the controller assumes, independent of the plant's true ones
    (readings R2, R3): a number, for `Pi_hat` also one per axis with shape (2,), or `KnownSlopes`.

    Attributes:
        k1: gain on the position error; how fast it decays.
        k2: gain on the velocity error.
        k3: gain on the heading error; how fast it decays.
        Lam: gain on the integral of the position error.
        Lam_psi: gain on the integral of the heading error.
        omega_n: natural frequency of the command filter.
        zeta: damping of the command filter.
        Pi_hat: deadzone slope that the law assumes for the position.
        Pi_psi_hat: deadzone slope that the law assumes for the heading.
        filter: the command filter, which provides the derivative of the virtual control.
        wrapped: whether the heading error is wrapped to -pi .. pi (reading R17).
    """

    k1: Real = number(20.0, "1/s", POSITIVE, "after eq. (32)")
    k2: Real = number(20.0, "1/s", POSITIVE, "eq. (41)")
    k3: Real = number(12.0, "1/s", POSITIVE, "eq. (63)")
    Lam: Real = number(16.0, "1/s^2", NONNEGATIVE, "after eq. (32)")
    Lam_psi: Real = number(9.0, "1/s^2", NONNEGATIVE, "eq. (63)")
    omega_n: Real = number(90.0, "rad/s", POSITIVE, "eq. (22)")
    zeta: Real = number(0.75, "1", POSITIVE, "eq. (22), reading R6")
    Pi_hat: Real | KnownSlopes = number(1.0, "1", POSITIVE, "eqs. (41), (45), readings R2, R3", shape=(2,))
    Pi_psi_hat: Real | KnownSlopes = number(1.0, "1", POSITIVE, "eqs. (63), (67), readings R2, R3")
    filter: CommandFilter | LiteralFilter | NoFilter = CommandFilter()
    wrapped: bool = structure(True)  # reading R17: the paper never wraps Z3

    tunable = ("k1", "k2", "k3", "Lam", "Lam_psi", "omega_n", "zeta")
    heading_gains = ("k3", "Lam_psi")
    relieves = True

    def init(self, measurement: Measurement, reference: Reference) -> BacksteppingState:
        """The state of a law that starts now: the filter at its input, integrals and compensation at 0."""
        zero, none = jnp.zeros_like(measurement.position), jnp.zeros_like(measurement.heading)
        return BacksteppingState(
            phi1=self.virtual_control(measurement.position - reference.position, zero, reference.velocity),  # (22)
            phi2=zero,
            xi1=zero,
            xi2=zero,
            beta1=zero,
            beta2=none,
            network=self.start_network(none),
        )

    def virtual_control(self, Z1: Array, beta1: Array, velocity: Array) -> Float[Array, "2"]:
        """After eq. (32). The velocity that would close the position error [m/s]; linear, so also its own rate."""
        return -self.k1 * Z1 + velocity - self.Lam * beta1

    def law(
        self, flow: BacksteppingState, memory: tuple[()], measurement: Measurement, reference: Reference
    ) -> tuple[Command, BacksteppingState]:
        """Commands before the deadzone, and the derivative of the law's own state."""
        alpha1, alpha1_rate = self._virtual(flow, measurement, reference)
        moved = self.filter(self._filtered(flow, alpha1, alpha1_rate))  # (22)
        return self._respond(flow, measurement, reference, alpha1, moved)

    def _filtered(self, s: BacksteppingState, alpha1: Array, alpha1_rate: Array) -> Filtered:
        """What the command filter works on."""
        return Filtered(s.phi1, s.phi2, alpha1, alpha1_rate, self.omega_n, self.zeta)

    def _virtual(self, s: BacksteppingState, measurement: Measurement, reference: Reference) -> tuple[Array, Array]:
        """alpha1 and its derivative."""
        Z1 = measurement.position - reference.position  # (21)
        alpha1 = self.virtual_control(Z1, s.beta1, reference.velocity)
        return alpha1, self.virtual_control(measurement.velocity - reference.velocity, Z1, reference.acceleration)

    def _respond(
        self,
        s: BacksteppingState,
        measurement: Measurement,
        reference: Reference,
        alpha1: Array,
        filter_rate: tuple[Array, Array],
    ) -> tuple[Command, BacksteppingState]:
        """The law once the filter's input and the derivatives of phi1 and phi2 are known."""
        phi1_rate, phi2_rate = filter_rate  # (22)
        Z1 = measurement.position - reference.position  # (21)
        Z2 = measurement.velocity - s.phi1  # (21)
        xi1_rate = s.xi2 + (s.phi1 - alpha1) - self.k1 * s.xi1  # (23)
        xi2_rate = -self.k2 * s.xi2  # (23); 0 forever from its start at 0 (reading R7)
        Zb2 = Z2 - s.xi2  # (24); Zb1 = Z1 - xi1 enters no law

        Z3 = measurement.heading - reference.heading  # (57)
        Z3 = wrap(Z3) if self.wrapped else Z3
        term, term_psi = self.network_terms(s.network, measurement, Zb2, Z3)
        U_bar, inverse = _divided(self.Pi_hat, -self.k2 * Zb2, phi1_rate - term)  # (41)
        rest = reference.heading_rate - self.Lam_psi * s.beta2 - term_psi
        omega_bar, inverse_psi = _divided(self.Pi_psi_hat, -self.k3 * Z3, rest)  # (63)

        rate = BacksteppingState(
            phi1=phi1_rate,
            phi2=phi2_rate,
            xi1=xi1_rate,
            xi2=xi2_rate,
            beta1=Z1,  # (25)
            beta2=Z3,  # (57)
            network=self.adapt(s.network, measurement, Zb2, Z3, inverse, inverse_psi),
        )
        return Command(position=U_bar, heading=omega_bar), rate

    def advance(
        self,
        state: BacksteppingState,
        measurement: Measurement,
        reference: Reference,
        period: Real,
        limit: Real | None = None,
    ) -> tuple[Command, BacksteppingState, Bool[Array, ""]]:
        """One period of a digital loop, measurement and reference held over it.

        The filter (22), the compensation (23) and the adapted weights (45), (67), all linear in themselves, are stepped
        exactly; phi1' in (41) is the mean over the period. `limit` [m/s] bounds the norm of alpha1 - chi1_d'.

        Returns:
            The command, the state a `period` [s] later, and whether the limit was met.
        """
        s = state
        alpha1, alpha1_rate = self._virtual(s, measurement, reference)
        alpha1, met = _bounded(alpha1, reference.velocity, limit)
        moved1, moved2 = self.filter.over_period(self._filtered(s, alpha1, alpha1_rate), period)
        command, rate = self._respond(s, measurement, reference, alpha1, (moved1 / period, moved2))

        def faded(x: PyTree, slope: PyTree, decay: PyTree) -> PyTree:
            return jax.tree.map(lambda x, dx, k: x - jnp.expm1(-k * period) / k * dx, x, slope, decay)

        later = BacksteppingState(
            phi1=s.phi1 + moved1,
            phi2=s.phi2 + moved2,
            xi1=faded(s.xi1, rate.xi1, self.k1),
            xi2=faded(s.xi2, rate.xi2, self.k2),
            beta1=s.beta1 + period * rate.beta1,
            beta2=s.beta2 + period * rate.beta2,
            network=faded(s.network, rate.network, self.decay()),
        )
        return command, later, met

    def relieved(
        self, before: BacksteppingState, later: BacksteppingState, missing: Array, limited: Array, period: Real
    ) -> BacksteppingState:
        """Anti-windup: the state after a period in which `missing` (2,) [m/s^2] of the command was not applied.

        The filter moves by what would have asked for the applied command, (41) being -k2 (chi2 - phi1) + phi1'; the
        integral of the position error is frozen while anything is `limited`.
        """
        return dataclasses.replace(
            later,
            phi1=later.phi1 - missing / (1 / period + self.k2),
            beta1=jnp.where(limited, before.beta1, later.beta1),
        )

    def decay(self) -> PyTree:
        """How fast what is adapted forgets [1/s], a tree like the network's."""
        return ()

    def start_network(self, zero: Float[Array, ""]) -> PyTree:
        """What is adapted, at its start."""
        return ()

    def network_terms(self, network: PyTree, measurement: Measurement, Zb2: Array, Z3: Array) -> tuple[Array, Array]:
        """What the network adds to what U_bar (2,) and omega_bar () must cancel, times the slope."""
        return jnp.zeros_like(Zb2), jnp.zeros_like(Z3)

    def adapt(
        self, network: PyTree, measurement: Measurement, Zb2: Array, Z3: Array, inverse: Real, inverse_psi: Real
    ) -> PyTree:
        """Derivative of what is adapted; `inverse` and `inverse_psi` are 1 / Pi_hat and 1 / Pi_psi_hat."""
        return ()

    def poles(self) -> np.ndarray:
        """Poles of the fastest part, the command filter [1/s], which the integrator's step must resolve."""
        return self.filter.poles(float(self.omega_n), float(self.zeta))

    @property
    def fastest(self) -> tuple[str, str]:
        """What has these poles, and its source."""
        return "command filter", "eq. (22)"

    def rates(self) -> dict[str, np.ndarray]:
        """Poles of the modes whose speed a gain sets [1/s], by that gain: filter, and eqs. (32), (41), (63)."""
        return {
            "omega_n": self.poles(),
            "k1": np.array([-float(self.k1)]),
            "k2": np.array([-float(self.k2)]),
            "k3": np.array([-float(self.k3)]),
        }

    def upper_bounds(self, stable: Stable) -> dict[str, float]:
        """What gains must stay below: `stable(poles)` says whether a step integrates modes with these poles.

        The damping stays at most 1 (after eq. (22)), and the filter stable at any damping from .05 to that.
        """
        dampings = np.linspace(0.05, 1.0, 20)
        fits = lambda omega_n: all(stable(self.filter.poles(omega_n, zeta)) for zeta in dampings)  # noqa: E731
        return {"zeta": 1.0, "omega_n": largest(fits, 1e6)}

    def stability_bounds(self, Pi_min: float, Pi_psi_min: float) -> dict[str, float]:
        """What k1, k2 and k3 must exceed, from eqs. (48), (52) and (70), for the smallest true deadzone slopes."""
        return {"k1": 1.0, "k2": max(0.5, 0.5 / Pi_min), "k3": 0.5 / Pi_psi_min}
