"""A law in continuous time whose commands go through the inverse of the deadzones that are believed in."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import PyTree

from .._pytree import pytree
from ..errors import Fault
from ..messages import Command, Measurement, Reference
from ..plants import Decoupled
from ..protocols import Law, Plant
from .compensation import Inverse
from .neuro_backstepping import NeuroBackstepping
from .wrapping import Wrapping


@pytree
class Compensated(Wrapping):
    """A law, what it takes the vehicle for, and the inverse; `Sampled` has its own place for one.

    What the law wants is turned into inputs by the `vehicle`'s allocation and then inverted. A lead needs a period to
    look back on and so a computer: it must be 0 here.
    """

    inner: Law = NeuroBackstepping()
    vehicle: Plant = Decoupled()
    compensation: Inverse = dataclasses.field(default_factory=lambda: Inverse(believed=Decoupled().deadzones()))

    def law(
        self, flow: PyTree, memory: PyTree, measurement: Measurement, reference: Reference
    ) -> tuple[Command, PyTree]:
        """The inner law's command with inputs of its own."""
        asked, rate = self.inner.law(flow, memory, measurement, reference)
        inputs = self.compensation.inverted(self.vehicle.allocate(asked, measurement))
        return dataclasses.replace(asked, inputs=inputs), rate

    def gains_to_tune(self, heading: bool = True) -> tuple[str, ...]:
        """The inner law's, the heading's only where it can be commanded, and the inverse's."""
        rest = (f"compensation.{name}" for name in self.compensation.tunable)
        return (*super().gains_to_tune(self.vehicle.commands_heading), *rest)

    def believing(self, plant: Plant) -> Law:
        """With this plant as its vehicle, if it takes the vehicle for one of this kind."""
        return dataclasses.replace(self, vehicle=plant) if type(self.vehicle) is type(plant) else self

    def faults(self, plant: Plant) -> list[Fault]:
        """A vehicle of another kind than the plant, beliefs about no actuator of it, or a lead."""
        found = super().faults(plant) + self.compensation.faults(self.vehicle, "compensation.")
        if self.vehicle.actuators != plant.actuators:
            rule = f"a vehicle with the actuators of scenario.plant, {', '.join(plant.actuators)}"
            found.append(Fault("vehicle", type(self.vehicle).__name__, rule))
        if np.any(np.asarray(self.compensation.lead) != 0):
            rule = "0 in continuous time: put the law into a computer (sampled)"
            found.append(Fault("compensation.lead", float(np.max(self.compensation.lead)), rule))
        return found
