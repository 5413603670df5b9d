"""A law around another: whatever it does not do itself, the inner one does."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import numpy as np
from jaxtyping import Array, Bool, Float, PyTree

from .._pytree import Real
from ..errors import Fault
from ..leaves import swap
from ..messages import Command, Measurement, Reference
from ..protocols import Element, Law, Plant, Stable
from .compensation import Compensation

T = TypeVar("T")


class Wrapping(Law):
    """A law around another, `inner`; every method not overridden is forwarded to it. Its gains are named `inner.`."""

    inner: Law

    def init(self, measurement: Measurement, reference: Reference) -> PyTree:
        """The state of the inner law."""
        return self.inner.init(measurement, reference)

    def law(
        self, flow: PyTree, memory: PyTree, measurement: Measurement, reference: Reference
    ) -> tuple[Command, PyTree]:
        """Command and derivative of the inner law."""
        return self.inner.law(flow, memory, measurement, reference)

    def hold(self, measurement: Measurement, reference: Reference) -> PyTree:
        """The memory of the inner law."""
        return self.inner.hold(measurement, reference)

    def jump(
        self, flow: PyTree, memory: PyTree, measurement: Measurement, reference: Reference, h: Float[Array, ""]
    ) -> PyTree:
        """The memory of the inner law after a control instant."""
        return self.inner.jump(flow, memory, measurement, reference, h)

    def follows(self) -> bool:
        """Whether the inner law follows a route."""
        return self.inner.follows()

    def faster(self, factor: float) -> Law:
        """The same around the inner law for a path that is driven so many times as fast."""
        return swap(self, {"inner": self.inner.faster(factor)})

    def canonical(self) -> Law:
        """The same around the inner law, without numbers that other programs read differently."""
        return swap(self, {"inner": self.inner.canonical()})

    def control_period(self) -> Real | None:
        """The inner law's clock [s]."""
        return self.inner.control_period()

    def limited(self, memory: PyTree) -> Bool[Array, ""]:
        """Whether the inner law keeps something back."""
        return self.inner.limited(memory)

    def state(self, flow: PyTree, memory: PyTree) -> PyTree:
        """What the inner law shows."""
        return self.inner.state(flow, memory)

    def weight_norms(self, flow: PyTree) -> Float[Array, "2"] | None:
        """Squared norms of the inner law's weights."""
        return self.inner.weight_norms(flow)

    def gains_to_tune(self, heading: bool = True) -> tuple[str, ...]:
        """The inner law's gains."""
        return tuple(f"inner.{name}" for name in self.inner.gains_to_tune(heading))

    def poles(self) -> np.ndarray:
        """The inner law's poles [1/s]."""
        return self.inner.poles()

    @property
    def fastest(self) -> tuple[str, str]:
        """What has these poles, and its source."""
        return self.inner.fastest

    def rates(self) -> dict[str, np.ndarray]:
        """Poles [1/s] by the inner law's gains."""
        return _prefixed(self.inner.rates())

    def upper_bounds(self, stable: Stable) -> dict[str, float]:
        """Bounds of the inner law's gains."""
        return _prefixed(self.inner.upper_bounds(stable))

    def stability_bounds(self, Pi_min: float, Pi_psi_min: float) -> dict[str, float]:
        """Stability conditions of the inner law."""
        return _prefixed(self.inner.stability_bounds(Pi_min, Pi_psi_min))

    def input_limits(self) -> Float[Array, " m"] | None:
        """How large each input may be that the inner law asks for."""
        return self.inner.input_limits()

    def believing(self, plant: Plant, deadzone: Mapping[str, Element]) -> Law:
        """The same around the inner law with this plant as its model."""
        return swap(self, {"inner": self.inner.believing(plant, deadzone)})

    def faults(self, plant: Plant) -> list[Fault]:
        """What of the inner law does not suit a plant."""
        return [fault._replace(key=f"inner.{fault.key}") for fault in self.inner.faults(plant)]


class Allocating(Wrapping):
    """A law around another that turns its command into inputs, by what it takes the `vehicle` for."""

    vehicle: Plant
    compensation: Compensation

    def gains_to_tune(self, heading: bool = True) -> tuple[str, ...]:
        """The inner law's, the heading's only where it can be commanded, and the compensation's."""
        rest = (f"compensation.{name}" for name in self.compensation.tunable)
        return (*super().gains_to_tune(self.vehicle.commands_heading), *rest)

    def believing(self, plant: Plant, deadzone: Mapping[str, Element]) -> Law:
        """With this plant and its deadzones as its model, if the model is of this kind."""
        if type(self.vehicle) is not type(plant):
            return self
        return swap(self, {"vehicle": plant, "compensation": self.compensation.believing(deadzone)})

    def faults(self, plant: Plant) -> list[Fault]:
        """A vehicle of another kind than the plant, or assumed deadzones that do not suit it."""
        found = super().faults(plant)
        period = self.control_period()
        wrong = self.compensation.faults(self.vehicle, None if period is None else float(period))
        found += [f._replace(key=f"compensation.{f.key}") for f in wrong]
        if self.vehicle.actuators != plant.actuators:
            rule = f"a vehicle with the actuators of scenario.plant, {', '.join(plant.actuators)}"
            found.append(Fault("vehicle", type(self.vehicle).__name__, rule))
        return found


def _prefixed(named: Mapping[str, T]) -> dict[str, T]:
    return {f"inner.{name}": value for name, value in named.items()}
