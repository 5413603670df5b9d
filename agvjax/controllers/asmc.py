"""ASMC class: sliding mode whose gains adapt to bounds it does not know."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._pytree import NONNEGATIVE, POSITIVE, Real, number, pytree
from ..geometry import turned, wrap
from ..messages import Command, Measurement, Reference
from ..protocols import Law


@pytree
class Bounds:
    """The bounds of the uncertainty that the law adapts: |disturbance| <= th |w| + D, by channel."""

    th: Float[Array, "2"]
    D: Float[Array, "2"]  # m/s^2
    th_psi: Float[Array, ""]
    D_psi: Float[Array, ""]  # rad/s


@pytree
class ASMC(Law):
    """Adaptive sliding mode, as a class law: it knows nothing of the deadzone.

    Attributes:
        c: gain on the position error in the sliding variable e' + c e.
        k: gain on the position's sliding variable.
        gT: adaptation gain of the bound th of the position's uncertainty.
        gD: adaptation gain of the bound D of the position's disturbance.
        sg: leakage of the adapted bounds D.
        eps: boundary layer of the position's sliding variable: wider chatters less.
        kw: gain on the heading error.
        gTw: adaptation gain of the bound th of the heading's uncertainty.
        gDw: adaptation gain of the bound D of the heading's disturbance.
        epsw: boundary layer of the heading error: wider chatters less.
        th_start: initial bounds th.
        th_max: largest bounds th (projection).
    """

    c: Real = number(1.0, "1/s", POSITIVE, "ASMC class")
    k: Real = number(3.0, "1/s", POSITIVE, "ASMC class")
    gT: Real = number(0.5, "s^3/m^2", NONNEGATIVE, "ASMC class")
    gD: Real = number(2.0, "1/s^2", NONNEGATIVE, "ASMC class")
    sg: Real = number(0.02, "1/s", NONNEGATIVE, "ASMC class")
    eps: Real = number(0.05, "m/s", POSITIVE, "ASMC class")
    kw: Real = number(2.0, "1/s", POSITIVE, "ASMC class")
    gTw: Real = number(0.5, "s/rad^2", NONNEGATIVE, "ASMC class")
    gDw: Real = number(3.0, "1/s^2", NONNEGATIVE, "ASMC class")
    epsw: Real = number(0.05, "rad", POSITIVE, "ASMC class")
    th_start: Real = number(1.0, "1", NONNEGATIVE, "ASMC class")
    th_max: Real = number(5.0, "1", POSITIVE, "ASMC class")

    tunable = ("c", "k", "gT", "gD", "sg", "eps", "kw", "gTw", "gDw", "epsw")

    def init(self, measurement: Measurement, reference: Reference) -> Bounds:
        """Bounds at their start."""
        none = jnp.zeros_like(measurement.heading)
        both = jnp.zeros_like(measurement.position)
        return Bounds(th=both + self.th_start, D=both, th_psi=none + self.th_start, D_psi=none)

    def law(
        self, flow: Bounds, memory: tuple[()], measurement: Measurement, reference: Reference
    ) -> tuple[Command, Bounds]:
        """Commands before the deadzone, and the derivative of the bounds."""
        error_rate = measurement.velocity - reference.velocity
        s = error_rate + self.c * (measurement.position - reference.position)
        w = self.c * error_rate - reference.acceleration + turned(measurement.velocity, measurement.yaw_rate)
        u = -self.k * s - (flow.th * jnp.abs(w) + flow.D) * _saturated(s / self.eps)
        s_psi = wrap(measurement.heading - reference.heading)
        w_psi = -reference.heading_rate
        omega = -self.kw * s_psi - (flow.th_psi * jnp.abs(w_psi) + flow.D_psi) * _saturated(s_psi / self.epsw)
        rate = Bounds(
            th=self._projected(flow.th, self.gT * jnp.abs(s) * jnp.abs(w)),
            D=self.gD * jnp.abs(s) - self.sg * flow.D,
            th_psi=self._projected(flow.th_psi, self.gTw * jnp.abs(s_psi) * jnp.abs(w_psi)),
            D_psi=self.gDw * jnp.abs(s_psi) - self.sg * flow.D_psi,
        )
        return Command(position=u, heading=omega), rate

    def _projected(self, th: Array, rate: Array) -> Array:
        """`th` only grows, and stops at its largest value."""
        return jnp.where(th < self.th_max, rate, 0.0)


def _saturated(x: Array) -> Array:
    return jnp.clip(x, -1, 1)
