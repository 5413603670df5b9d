"""What a computer does about deadzones: between what a law wants delivered and what is sent to the actuators."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from .._pytree import NONNEGATIVE, POSITIVE, Real, number, pytree
from ..actuators.deadzone import Deadzone
from ..errors import Fault
from ..messages import Measurement
from ..protocols import Element, Inputs, Plant


class Compensation:
    """What is sent for what is wanted; by default what is wanted."""

    tunable: ClassVar[tuple[str, ...]] = ()

    def hold(self, wanted: Inputs, measurement: Measurement) -> PyTree:
        """The memory before the first instant; `wanted` has the shapes."""
        return ()

    def learnt(self, memory: PyTree, vehicle: Plant, measurement: Measurement, period: Real) -> PyTree:
        """The memory after what was measured, a period [s] after the last instant."""
        return memory

    def sent(self, memory: PyTree, wanted: Inputs, period: Real) -> tuple[Inputs, PyTree]:
        """What to send for a period [s], and the next memory."""
        return wanted, memory

    def remembering(self, memory: PyTree, sent: Inputs) -> PyTree:
        """The memory with what was sent, within its limits."""
        return memory

    def inverted(self, wanted: Inputs) -> Inputs:
        """What to send by what is wanted alone."""
        return wanted

    def delivered(self, memory: PyTree, sent: Inputs) -> Inputs:
        """The outputs that it expects of the actuators."""
        return sent

    def believing(self, deadzone: Mapping[str, Element]) -> Compensation:
        """The same with these deadzones in place of the assumed ones."""
        return self

    def upper_bounds(self, period: float) -> dict[str, float]:
        """By number what it must stay below in a computer of this period [s]."""
        return {}

    def faults(self, vehicle: Plant, period: float | None) -> list[Fault]:
        """What of it does not suit a vehicle and a computer's period [s]; keys are relative to it.

        A period of None is a law in continuous time.
        """
        return []


@pytree
class NoCompensation(Compensation):
    """No compensation: deadzones are left to the law."""


@pytree
class Inverse(Compensation):
    """The smooth inverse of the assumed deadzones: u = d / m + s tanh((|d| - q) / w) sign(d).

    The slope m = `slope` m_b and the threshold s = `threshold` s_b are those of the side that d is on, eq. (11), with
    the assumed m_b and s_b; the step rises over w = `width` s_b. Up to q = `quiet` s_b it is 0, so that a demand around
    zero does not make an actuator chatter across its whole deadzone. A `lead` first adds lead x d' (by differences),
    which compensates a lag. The limits of the computer's anti-windup follow. There is no step if the threshold is
    0; an actuator not named in `believed` receives d unchanged.

    Source: Tao and Kokotovic, Adaptive control of plants with unknown dead-zones, IEEE TAC 39(1), 1994, for the inverse
    with the step; smoothed as is usual.

    Attributes:
        believed: the assumed deadzones, which it inverts; by default the scenario's.
        slope: factor on the assumed slopes.
        threshold: factor on the assumed thresholds.
        width: demand over which the step rises, times the assumed threshold.
        quiet: demand up to which there is no step, times the assumed threshold.
        lead: time constant of the lag that it compensates.
    """

    believed: Mapping[str, Deadzone] = dataclasses.field(default_factory=dict)
    slope: Real = number(1.0, "of the assumed slopes", POSITIVE)
    threshold: Real = number(1.0, "of the assumed thresholds", POSITIVE)
    width: Real = number(0.2, "of the assumed thresholds", POSITIVE)
    quiet: Real = number(0.1, "of the assumed thresholds", NONNEGATIVE)
    lead: Real = number(0.0, "s", NONNEGATIVE)

    tunable = ("slope", "threshold", "width", "quiet")

    def hold(self, wanted: Inputs, measurement: Measurement) -> PyTree:
        """Nothing was wanted before."""
        return {name: jnp.zeros_like(d) for name, d in wanted.items()}

    def sent(self, memory: PyTree, wanted: Inputs, period: Real) -> tuple[Inputs, PyTree]:
        """Lead, then inverse."""
        return self.inverted(self.led(memory, wanted, period)), wanted

    def led(self, before: Inputs, wanted: Inputs, period: Real) -> Inputs:
        """What is wanted, ahead of a lag."""
        return {n: d + self.lead / period * (d - before[n]) for n, d in wanted.items()}

    def inverted(self, wanted: Inputs) -> Inputs:
        """What must be sent for the wanted outputs, by the assumed deadzones."""
        zones = believed_of(self.believed, wanted)
        return {name: self._step(zones[name], d) if name in zones else d for name, d in wanted.items()}

    def _step(self, zone: Deadzone, d: Float[Array, "*n"]) -> Float[Array, "*n"]:
        right = d > 0
        m = self.slope * jnp.where(right, zone.slope_right, zone.slope_left)
        s = jnp.asarray(jnp.where(right, zone.threshold_right, zone.threshold_left))
        there = s > 0
        beyond = jnp.maximum(jnp.abs(d) - self.quiet * s, 0) / jnp.where(there, self.width * s, 1.0)
        return d / m + jnp.where(there, self.threshold * s * jnp.tanh(beyond), 0.0) * jnp.sign(d)

    def delivered(self, memory: PyTree, sent: Inputs) -> Inputs:
        """The output of the assumed deadzones."""
        return {n: self.believed[n](u) if n in self.believed else u for n, u in sent.items()}

    def believing(self, deadzone: Mapping[str, Element]) -> Compensation:
        """Only for the actuators with an assumed deadzone."""
        return dataclasses.replace(self, believed={n: deadzone.get(n, own) for n, own in self.believed.items()})

    def faults(self, vehicle: Plant, period: float | None) -> list[Fault]:
        """A deadzone of no actuator of the vehicle, or none at all; a lead without a sampling period."""
        found, rule = [], f"by actuator of the vehicle, {', '.join(vehicle.actuators)}, at least one"
        if not (self.believed and set(self.believed) <= set(vehicle.actuators)):
            found.append(Fault("believed", ", ".join(self.believed) or "nothing", rule))
        if period is None and np.any(np.asarray(self.lead) != 0):
            rule = "0 in continuous time: put the law into a computer (sampled)"
            found.append(Fault("lead", float(np.max(np.asarray(self.lead))), rule))
        return found


def believed_of(believed: Mapping[str, Deadzone], inputs: Inputs) -> Mapping[str, Deadzone]:
    """The assumed deadzones.

    Raises:
        ValueError: there are none, or one is of no actuator that has an input.
    """
    if not believed or not set(believed) <= set(inputs):
        known = f"the actuators are {', '.join(inputs)}, the deadzones given those of {', '.join(believed) or 'none'}"
        raise ValueError(f"believed must map actuators to deadzones, for example believed=scenario.deadzone: {known}")
    return believed
