"""What lets a law that asks for accelerations drive a base: an inner reference of speed and yaw rate."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree

from .._pytree import POSITIVE, Real, number, pytree
from ..geometry import into_body, into_plane
from ..messages import Command, Measurement, Reference
from ..protocols import Law
from .neuro_backstepping import NeuroBackstepping
from .wrapping import Wrapping


@pytree
class Referred:
    """What it remembers."""

    inner: PyTree
    twist: Float[Array, "2"]  # m/s, rad/s, in force


@pytree
class VelocityReference(Wrapping):
    """A law of the paper's kind on a base: its acceleration, eq. (4), integrated to the twist that is sent.

    The law controls the point `L` ahead of the axle, eq. (2), by its acceleration U_bar. Its component along the body
    changes the speed, its lateral component, by the lever L, the yaw rate: v' = a + L w^2, w' = (u_t - v w) / L of the
    reference itself, kept within `largest`. It runs in a computer, `Sampled`.

    Attributes:
        inner: the law.
        L: how far ahead of the axle the law's reference point lies.
        largest: largest speed and yaw rate of the reference.
    """

    inner: Law = NeuroBackstepping()
    L: Real = number(0.3, "m", POSITIVE, "eq. (2)")
    largest: Array = number((1.2, 1.5), "m/s, rad/s: speed and yaw rate of the reference", POSITIVE, shape=(2,))

    def _ahead(self, measurement: Measurement) -> Measurement:
        """The point ahead, and its velocity."""
        along, _ = into_body(measurement.velocity, measurement.heading)
        zero = jnp.zeros_like(measurement.heading)
        position = measurement.position + into_plane(zero + self.L, zero, measurement.heading)
        velocity = into_plane(along, self.L * measurement.yaw_rate, measurement.heading)
        return dataclasses.replace(measurement, position=position, velocity=velocity)

    def init(self, measurement: Measurement, reference: Reference) -> Referred:
        """At rest."""
        inner = self.inner.init(self._ahead(measurement), reference)
        return Referred(inner=inner, twist=jnp.zeros_like(measurement.position))

    def advance(
        self, state: Referred, measurement: Measurement, reference: Reference, period: Real, limit: Real | None = None
    ) -> tuple[Command, Referred, Bool[Array, ""]]:
        """One period: the law's acceleration, and the twist a period later."""
        command, later, limited = self.inner.advance(state.inner, self._ahead(measurement), reference, period, limit)
        along, across = into_body(command.position, measurement.heading)
        v, w = state.twist
        rate = jnp.stack([along + self.L * w**2, (across - v * w) / self.L])
        most = jnp.asarray(self.largest)
        twist = jnp.clip(state.twist + period * rate, -most, most)
        command = Command(position=twist, heading=jnp.zeros_like(measurement.heading), twist=twist)
        return command, Referred(inner=later, twist=twist), limited | jnp.any(jnp.abs(twist) >= most)
