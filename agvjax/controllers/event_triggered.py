"""Event-triggered control, the paper's future work: a command is sent only when it has changed enough."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree

from .._pytree import NONNEGATIVE, POSITIVE, Real, number, pytree
from ..messages import Command, Measurement, Reference
from ..protocols import Law
from .neuro_backstepping import NeuroBackstepping
from .wrapping import Wrapping


@pytree
class Sent:
    """The memory of event-triggered control."""

    command: Command  # in force
    inner: PyTree  # memory of the inner law


@pytree
class EventTriggered(Wrapping):
    """A law whose command of each channel is held until it differs from the law's by more than `delta` |held| + `m`.

    The trigger is checked at every control instant. The interval between two updates is at least m / sup |u'|, so there
    are never infinitely many in finite time. It cannot be tuned by gradient, because the update times jump with the
    gains. Tune `inner` and evaluate this one.

    Attributes:
        inner: the law.
        delta: relative threshold of an update.
        m: absolute threshold of an update, for each channel.
    """

    inner: Law = NeuroBackstepping()
    delta: Real = number(0.1, "1", NONNEGATIVE)
    m: Real = number(0.1, "m/s^2, m/s^2, rad/s", POSITIVE, shape=(3,))

    def gains_to_tune(self, heading: bool = True) -> tuple[str, ...]:
        """None: the update times jump with the gains."""
        return ()

    def hold(self, measurement: Measurement, reference: Reference) -> Sent:
        """The first command, sent as it is."""
        state, memory = self.init(measurement, reference), self.inner.hold(measurement, reference)
        return Sent(command=self.inner.law(state, memory, measurement, reference)[0], inner=memory)

    def jump(
        self, flow: PyTree, memory: Sent, measurement: Measurement, reference: Reference, h: Float[Array, ""]
    ) -> Sent:
        """The command in force after this control instant."""
        inner, sent = self.inner.jump(flow, memory.inner, measurement, reference, h), memory.command
        asked, _ = self.inner.law(flow, inner, measurement, reference)
        m = jnp.broadcast_to(self.m, (3,))

        def renewed(new: Array, old: Array, m: Array) -> Array:
            return jnp.where(jnp.abs(new - old) >= self.delta * jnp.abs(old) + m, new, old)

        command = Command(
            position=renewed(asked.position, sent.position, m[:2]), heading=renewed(asked.heading, sent.heading, m[2])
        )
        return Sent(command=command, inner=inner)

    def law(self, flow: PyTree, memory: Sent, measurement: Measurement, reference: Reference) -> tuple[Command, PyTree]:
        """The command in force, and the derivative of the inner law."""
        return memory.command, self.inner.law(flow, memory.inner, measurement, reference)[1]

    def limited(self, memory: Sent) -> Bool[Array, ""]:
        """Whether the inner law keeps something back."""
        return self.inner.limited(memory.inner)

    def state(self, flow: PyTree, memory: Sent) -> PyTree:
        """What the inner law shows."""
        return self.inner.state(flow, memory.inner)
