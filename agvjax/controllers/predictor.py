"""What a computer does about delay: it acts on where the vehicle will be when its command arrives."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from .._pytree import NONNEGATIVE, Real, number, pytree, structure
from ..actuators.deadzone import Deadzone
from ..errors import Fault
from ..messages import Measurement, Reference
from ..protocols import Element, Inputs, Plant
from .replay import MOST_SLOTS, joined, memoryless, stepped, under_way


class Prediction:
    """What the law is told for what was measured; by default just that."""

    def hold(self, sent: Inputs) -> PyTree:
        """The memory before anything was sent; `sent` has the shapes."""
        return ()

    def ahead(self, memory: PyTree, vehicle: Plant, measurement: Measurement, period: Real) -> Measurement:
        """What will be measured when what is sent now arrives."""
        return measurement

    def asked(self, reference: Reference) -> Reference:
        """What the path will ask for then."""
        return reference

    def remembering(self, memory: PyTree, sent: Inputs) -> PyTree:
        """The memory with one more input."""
        return memory

    def believing(self, deadzone: Mapping[str, Element]) -> Prediction:
        """The same with these deadzones in place of the assumed ones."""
        return self

    def upper_bounds(self, period: float) -> dict[str, float]:
        """By number what it must stay below in a computer of this period [s]."""
        return {}

    def faults(self, vehicle: Plant, period: float) -> list[Fault]:
        """What does not suit the computer's model of the vehicle; keys are relative to it."""
        return []


@pytree
class NoPrediction(Prediction):
    """No prediction: the law acts on the measurement."""


@pytree
class Predictor(Prediction):
    """Replays the inputs that are under way through the computer's model of the vehicle, from the measurement.

    With a delay T, an input sent j periods ago acts from T - j periods to T - (j - 1) periods ahead; each such interval
    is one step of RK4 of the computer's `vehicle` behind the `believed` deadzones, without disturbance. The path
    reference is extrapolated by its derivatives. Each prediction begins with the measurement, so model errors do not
    accumulate; measurement noise passes through.

    Source: Smith, Closer control of loops with dead time, Chem. Eng. Progress 53, 1957, in the form of Astrom and
    Wittenmark, Computer-Controlled Systems, sec. 4.7: prediction of the state over the delay.

    Attributes:
        delay: from the instant of a command until it takes effect.
        believed: the assumed deadzones; by default the scenario's.
        slots: inputs stored, at least the delay in periods.
    """

    delay: Real = number(0.1, "s", NONNEGATIVE)
    believed: Mapping[str, Deadzone] = dataclasses.field(default_factory=dict)
    slots: int = structure(4)

    def hold(self, sent: Inputs) -> dict[str, Array]:
        """No inputs under way: zeros for each actuator, the newest first."""
        return under_way(sent, self.slots)

    def ahead(self, memory: dict[str, Array], vehicle: Plant, measurement: Measurement, period: Real) -> Measurement:
        """RK4 of the model of the vehicle over the delay."""
        state = vehicle.seen(measurement)
        delivered = {name: jnp.zeros_like(line[0]) for name, line in memory.items()}
        for j in reversed(range(self.slots)):  # written out: a loop of so few steps would cost more
            delivered = {n: self.believed[n](x[j]) if n in self.believed else x[j] for n, x in memory.items()}
            h = jnp.clip(self.delay - j * period, 0.0) - jnp.clip(self.delay - (j + 1) * period, 0.0)
            state = stepped(vehicle, state, delivered, h)
        return vehicle.output(state, delivered)

    def asked(self, reference: Reference) -> Reference:
        """Continued by velocity, acceleration and heading rate."""
        T, v, a = self.delay, reference.velocity, reference.acceleration
        return dataclasses.replace(
            reference,
            position=reference.position + T * v + T**2 / 2 * a,
            velocity=v + T * a,
            heading=reference.heading + T * reference.heading_rate,
        )

    def remembering(self, memory: dict[str, Array], sent: Inputs) -> dict[str, Array]:
        """The newest first."""
        return joined(memory, sent)

    def believing(self, deadzone: Mapping[str, Element]) -> Prediction:
        """Only for the actuators with an assumed deadzone."""
        return dataclasses.replace(self, believed={n: deadzone.get(n, own) for n, own in self.believed.items()})

    def upper_bounds(self, period: float) -> dict[str, float]:
        """A delay is no longer than the inputs stored."""
        return {"delay": self.slots * period}

    def faults(self, vehicle: Plant, period: float) -> list[Fault]:
        """Too few slots or too many, a deadzone of no actuator, or a vehicle with memory."""
        found, longest = [], float(np.max(np.asarray(self.delay)))
        needed = int(np.ceil(longest / period - 1e-9))
        if not needed <= self.slots <= MOST_SLOTS:
            rule = f"at least {needed}, the delay of {longest:g} s in periods of {period:g} s, at most {MOST_SLOTS}"
            found.append(Fault("slots", self.slots, rule))
        if not set(self.believed) <= set(vehicle.actuators):
            rule = f"by actuator of the vehicle, {', '.join(vehicle.actuators)}"
            found.append(Fault("believed", ", ".join(self.believed), rule))
        return [*found, *memoryless(vehicle, self)]
