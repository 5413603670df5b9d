"""FTSMC class: a fast terminal sliding surface, reached by a power-rate or a super-twisting law."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._pytree import FRACTION, POSITIVE, Real, number, pytree
from ..geometry import turned, wrap
from ..messages import Command, Measurement, Reference
from ..protocols import Law


def signed_power(x: Array, exponent: Real) -> Array:
    """|x|^exponent sign(x), with slope 0 at x = 0, where the true one is infinite."""
    size = jnp.where(x == 0, 1.0, jnp.abs(x))
    return jnp.sign(x) * size**exponent


@pytree
class TerminalSurface:
    """The surface s = e' + a e + b |e|^g sign(e), and what holds the nominal model on it.

    Attributes:
        a: linear gain on the position error in the sliding variable.
        b: gain on the power of the position error in the sliding variable.
        g: power of the position error in the sliding variable.
        margin: error below which the slope of that power is kept constant, so that it stays finite.
    """

    a: Real = number(0.8, "1/s", POSITIVE, "FTSMC class")
    b: Real = number(0.8, "m^(1-g)/s", POSITIVE, "FTSMC class")
    g: Real = number(0.6, "1", FRACTION, "FTSMC class")
    margin: Real = number(0.01, "m", POSITIVE, "FTSMC class")

    def __call__(self, measurement: Measurement, reference: Reference) -> tuple[Array, Array]:
        """The surface's s [m/s] and the equivalent command [m/s^2]."""
        e, e_rate = measurement.position - reference.position, measurement.velocity - reference.velocity
        s = e_rate + self.a * e + self.b * signed_power(e, self.g)
        steep = self.b * self.g * jnp.maximum(jnp.abs(e), self.margin) ** (self.g - 1)
        F = turned(measurement.velocity, measurement.yaw_rate)
        return s, reference.acceleration - F - self.a * e_rate - steep * e_rate


@pytree
class FTSMC(TerminalSurface, Law):
    """Finite-time sliding mode, as a class law: it knows the model and nothing of deadzone or disturbance.

    Attributes:
        k1: linear gain on the position's sliding variable.
        k2: gain on the power of the position's sliding variable.
        rho: power of the sliding variables in the reaching law.
        kw1: linear gain on the heading error.
        kw2: gain on the power of the heading error.
    """

    k1: Real = number(1.0, "1/s", POSITIVE, "FTSMC class")
    k2: Real = number(0.8, "m^(1-rho)/s^(2-rho)", POSITIVE, "FTSMC class")
    rho: Real = number(0.6, "1", FRACTION, "FTSMC class")
    kw1: Real = number(2.0, "1/s", POSITIVE, "FTSMC class")
    kw2: Real = number(1.0, "rad^(1-rho)/s", POSITIVE, "FTSMC class")

    tunable = ("a", "b", "g", "k1", "k2", "rho", "kw1", "kw2")

    def init(self, measurement: Measurement, reference: Reference) -> tuple[()]:
        """No state."""
        return ()

    def law(
        self, flow: tuple[()], memory: tuple[()], measurement: Measurement, reference: Reference
    ) -> tuple[Command, tuple[()]]:
        """Commands before the deadzone."""
        s, u = self(measurement, reference)
        u = u - self.k1 * s - self.k2 * signed_power(s, self.rho)
        e_psi = wrap(measurement.heading - reference.heading)
        omega = reference.heading_rate - self.kw1 * e_psi - self.kw2 * signed_power(e_psi, self.rho)
        return Command(position=u, heading=omega), ()


@pytree
class TwistingState:
    """The integrals of the super-twisting law."""

    v: Float[Array, "2"]  # m/s^2
    v_psi: Float[Array, ""]  # rad/s


@pytree
class SuperTwistingFTSMC(TerminalSurface, Law):
    """An extra, not in the paper: the same surface, reached by super-twisting, whose integral cancels disturbances.

    Attributes:
        eps: boundary layer of position and heading: wider chatters less.
        k1: gain on the square root of the position's sliding variable.
        k2: gain of the integral of the position's sliding variable's sign.
        kw1: gain on the square root of the heading error.
        kw2: gain of the integral of the heading error's sign.
    """

    eps: Real = number(0.05, "m/s, rad", POSITIVE, "super-twisting")
    k1: Real = number(3.0, "m^0.5/s^1.5", POSITIVE, "super-twisting")
    k2: Real = number(2.0, "m/s^3", POSITIVE, "super-twisting")
    kw1: Real = number(2.0, "rad^0.5/s", POSITIVE, "super-twisting")
    kw2: Real = number(2.0, "rad/s^2", POSITIVE, "super-twisting")

    tunable = ("a", "b", "g", "eps", "k1", "k2", "kw1", "kw2")

    def init(self, measurement: Measurement, reference: Reference) -> TwistingState:
        """Integrals 0."""
        return TwistingState(v=jnp.zeros_like(measurement.position), v_psi=jnp.zeros_like(measurement.heading))

    def law(
        self, flow: TwistingState, memory: tuple[()], measurement: Measurement, reference: Reference
    ) -> tuple[Command, TwistingState]:
        """Commands before the deadzone, and the derivative of the integrals."""
        s, u = self(measurement, reference)
        e_psi = wrap(measurement.heading - reference.heading)
        half = jnp.asarray(0.5, measurement.heading.dtype)
        sign, sign_psi = jnp.clip(s / self.eps, -1, 1), jnp.clip(e_psi / self.eps, -1, 1)
        u = u - self.k1 * signed_power(s, half) * jnp.abs(sign) + flow.v
        omega = reference.heading_rate - self.kw1 * signed_power(e_psi, half) * jnp.abs(sign_psi) + flow.v_psi
        return Command(position=u, heading=omega), TwistingState(v=-self.k2 * sign, v_psi=-self.kw2 * sign_psi)
