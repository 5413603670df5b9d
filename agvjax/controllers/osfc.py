"""OSFC class: state feedback on the estimates of an extended-state observer."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._pytree import POSITIVE, Real, number, pytree
from ..geometry import wrap
from ..integrate import largest
from ..messages import Command, Measurement, Reference
from ..protocols import Law, Stable


@pytree
class ObserverState:
    """The states of the observers."""

    z1: Float[Array, "2"]  # m, position
    z2: Float[Array, "2"]  # m/s, velocity
    z3: Float[Array, "2"]  # m/s^2, lumped disturbance of the position
    q1: Float[Array, ""]  # rad, heading
    q2: Float[Array, ""]  # rad/s, lumped disturbance of the heading


@pytree
class OSFC(Law):
    """Observer-based state feedback, as a class law: it knows one nominal slope per channel, and no threshold.

    Attributes:
        kp: gain on the position error.
        kd: gain on the velocity error.
        wo: bandwidth of the position observer.
        b0: deadzone slope that the law assumes for the position.
        kpsi: gain on the heading error.
        wow: bandwidth of the heading observer.
        b0w: deadzone slope that the law assumes for the heading.
    """

    kp: Real = number(5.0, "1/s^2", POSITIVE, "OSFC class")
    kd: Real = number(4.5, "1/s", POSITIVE, "OSFC class")
    wo: Real = number(20.0, "rad/s", POSITIVE, "OSFC class")
    b0: Real = number(0.7, "1", POSITIVE, "OSFC class")
    kpsi: Real = number(2.0, "1/s", POSITIVE, "OSFC class")
    wow: Real = number(40.0, "rad/s", POSITIVE, "OSFC class")
    b0w: Real = number(0.8, "1", POSITIVE, "OSFC class")

    tunable = ("kp", "kd", "wo", "b0", "kpsi", "wow", "b0w")

    def init(self, measurement: Measurement, reference: Reference) -> ObserverState:
        """Observers at the measured state, disturbances 0."""
        return ObserverState(
            z1=measurement.position,
            z2=measurement.velocity,
            z3=jnp.zeros_like(measurement.position),
            q1=measurement.heading,
            q2=jnp.zeros_like(measurement.heading),
        )

    def law(
        self, flow: ObserverState, memory: tuple[()], measurement: Measurement, reference: Reference
    ) -> tuple[Command, ObserverState]:
        """Commands before the deadzone, and the derivative of the observers."""
        s, wo, wow = flow, self.wo, self.wow
        desired = reference.acceleration - self.kp * (s.z1 - reference.position) - self.kd * (s.z2 - reference.velocity)
        u = (desired - s.z3) / self.b0
        omega = (reference.heading_rate - self.kpsi * wrap(s.q1 - reference.heading) - s.q2) / self.b0w
        e = measurement.position - s.z1
        e_psi = wrap(measurement.heading - s.q1)
        rate = ObserverState(
            z1=s.z2 + 3 * wo * e,
            z2=s.z3 + self.b0 * u + 3 * wo**2 * e,
            z3=wo**3 * e,
            q1=s.q2 + self.b0w * omega + 2 * wow * e_psi,
            q2=wow**2 * e_psi,
        )
        return Command(position=u, heading=omega), rate

    def poles(self) -> np.ndarray:
        """Poles of the observers [1/s]."""
        return np.array([-float(self.wo), -float(self.wow)])

    @property
    def fastest(self) -> tuple[str, str]:
        """What has these poles, and its source."""
        return "observer", "OSFC class"

    def upper_bounds(self, stable: Stable) -> dict[str, float]:
        """What the bandwidths must stay below for a step to integrate the observers."""
        limit = largest(lambda w: stable(np.array([-w])), 1e6)
        return {"wo": limit, "wow": limit}
