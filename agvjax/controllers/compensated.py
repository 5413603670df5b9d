"""A law in continuous time whose commands pass through the inverse of the assumed deadzones."""

from __future__ import annotations

import dataclasses

from jaxtyping import PyTree

from .._pytree import pytree
from ..messages import Command, Measurement, Reference
from ..plants import Decoupled
from ..protocols import Law, Plant
from .compensation import Compensation, Inverse
from .neuro_backstepping import NeuroBackstepping
from .wrapping import Allocating


@pytree
class Compensated(Allocating):
    """A law, its model of the vehicle, and the inverse; `Sampled` has its own field for one.

    The law's command is converted into inputs by the allocation of `vehicle` and then inverted. A lead needs a sampling
    period, and so a computer: it must be 0 here.
    """

    inner: Law = NeuroBackstepping()
    vehicle: Plant = Decoupled()
    compensation: Compensation = dataclasses.field(default_factory=lambda: Inverse(believed=Decoupled().deadzones()))

    def law(
        self, flow: PyTree, memory: PyTree, measurement: Measurement, reference: Reference
    ) -> tuple[Command, PyTree]:
        """The inner law's command with inputs of its own."""
        asked, rate = self.inner.law(flow, memory, measurement, reference)
        inputs = self.compensation.inverted(self.vehicle.allocate(asked, measurement))
        return dataclasses.replace(asked, inputs=inputs), rate
