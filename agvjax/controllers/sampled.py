"""The digital loop: a law that runs once a period, on what it measured then, and holds what it asked for."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PyTree

from .._pytree import POSITIVE, Real, number, pytree, structure
from ..errors import Fault
from ..leaves import leaves
from ..messages import Command, Measurement, Reference
from ..plants import Decoupled
from ..protocols import Element, Inputs, Law, Plant, Stable
from .compensation import Compensation, NoCompensation
from .neuro_backstepping import NeuroBackstepping
from .predictor import NoPrediction, Prediction
from .wrapping import Allocating


class AntiWindup:
    """What the law is told of the limits of its inputs; by default nothing, so that it asks for whatever it likes."""

    speed: Real | None = None  # m/s, bound of |alpha1 - chi1_d'|
    limits: Float[Array, " m"] | None = None  # of each input, in the vehicle's order

    def applied(self, inputs: Inputs) -> Inputs:
        """The inputs within their limits."""
        return inputs


@pytree
class NoAntiWindup(AntiWindup):
    """The law's commands are not limited."""


@pytree
class BackCalculation(AntiWindup):
    """The law knows the limits of its inputs, and back-calculates its own state from what they cut off.

    Attributes:
        speed: bound of the correction |alpha1 - chi1_d'| of the virtual control.
        limits: largest size of each input, in the vehicle's order.
    """

    speed: Real | None = number(1.0, "m/s", POSITIVE)
    limits: Float[Array, " m"] | None = number(
        (4.0, 4.0), "of each input, in the vehicle's order", POSITIVE, shape=(None,)
    )

    def applied(self, inputs: Inputs) -> Inputs:
        """The inputs within their limits."""
        limits = jnp.asarray(self.limits)
        return {name: jnp.clip(u, -limits[i], limits[i]) for i, (name, u) in enumerate(inputs.items())}


@pytree
class Remembered:
    """The computer's memory besides the law's state; empty without compensation and prediction."""

    compensation: PyTree
    prediction: PyTree


@pytree
class Computed:
    """The computer's memory from one period to the next."""

    law: PyTree  # state of the law inside
    command: Command  # in force, with its inputs
    limited: Bool[Array, ""]  # whether the law kept something back
    memory: Remembered = Remembered(compensation=(), prediction=())


@pytree
class Sampled(Allocating):
    """A law run every `period`, its inputs held in between (zero-order hold).

    `vehicle` is the computer's own model of the vehicle: a plant whose `allocate` turns the law's command into actuator
    inputs, from the measurement at that instant. The law is stepped by its own `advance`, with `euler` by Euler's
    method. The inputs are 0 before the first instant. The integrator steps nothing of the law, so the poles and rates
    of the law in continuous time, and the stability conditions on them, do not apply.

    With a `prediction` the law acts on where the vehicle will be when its command arrives. Its command passes through
    `vehicle.allocate`, then `compensation` of the deadzones, then the limits of `anti_windup`; what these cut off is
    fed back to the law, in terms of what the rest is expected to deliver.

    Attributes:
        inner: the law that it runs.
        vehicle: the computer's model of the vehicle; by default that of the scenario.
        period: sampling period, the time between two commands.
        anti_windup: how the law takes the limits of its inputs into account.
        compensation: the inverse of the deadzones.
        prediction: the compensation of delay.
        euler: whether the law is stepped by Euler's method.
    """

    inner: Law = NeuroBackstepping()
    vehicle: Plant = Decoupled()
    period: Real = number(0.02, "s", POSITIVE)
    anti_windup: AntiWindup = NoAntiWindup()
    compensation: Compensation = NoCompensation()
    prediction: Prediction = NoPrediction()
    euler: bool = structure(False)

    def step(
        self, state: PyTree, measurement: Measurement, reference: Reference, memory: Remembered | None = None
    ) -> Computed:
        """One period: a pure function, and everything that the computer does.

        `state` is that of the law inside, see `inner.init`; `memory` what else it remembers, None before the first.
        """
        speed, period, law = self.anti_windup.speed, self.period, self.inner
        memory = self._begun(state, measurement, reference).memory if memory is None else memory
        known = self.compensation.learnt(memory.compensation, self.vehicle, measurement, period)
        measurement = self.prediction.ahead(memory.prediction, self.vehicle, measurement, period)
        reference = self.prediction.asked(reference)
        advance = functools.partial(Law.advance, law) if self.euler else law.advance
        asked, later, limited = advance(state, measurement, reference, period, speed)
        wanted = self.vehicle.allocate(asked, measurement)
        sent, kept = self.compensation.sent(known, wanted, period)
        applied = self.anti_windup.applied(sent)
        if speed is not None and law.relieves:
            cut = {name: applied[name] != sent[name] for name in sent}
            limited = limited | jnp.any(jnp.stack([jnp.any(c) for c in cut.values()]))
            rest = self.compensation.delivered(kept, applied)
            reached = {name: jnp.where(cut[name], rest[name], wanted[name]) for name in cut}
            missing = asked.position - self.vehicle.achieved(reached, measurement)
            later = law.relieved(state, later, missing, limited, period)
        command = Command(position=asked.position, heading=asked.heading, inputs=applied)
        way = self.prediction.remembering(memory.prediction, applied)
        memory = Remembered(compensation=self.compensation.remembering(kept, applied), prediction=way)
        return Computed(law=later, command=command, limited=limited, memory=memory)

    def _begun(self, state: PyTree, measurement: Measurement, reference: Reference) -> Computed:
        """Nothing was wanted or sent yet."""

        def first() -> Command:
            asked = self.inner.advance(state, measurement, reference, self.period)[0]
            inputs = self.vehicle.allocate(asked, measurement)
            return Command(position=asked.position, heading=asked.heading, inputs=inputs)

        nothing = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(first))
        parts = self.compensation.hold(nothing.inputs, measurement), self.prediction.hold(nothing.inputs)
        memory = Remembered(compensation=parts[0], prediction=parts[1])
        return Computed(law=state, command=nothing, limited=jnp.zeros((), bool), memory=memory)

    def init(self, measurement: Measurement, reference: Reference) -> tuple[()]:
        """No continuous state: the state of the inner law jumps."""
        return ()

    def hold(self, measurement: Measurement, reference: Reference) -> Computed:
        """The inner law at its start, and no command yet.

        Raises:
            ValueError: the inner law has a memory that jumps, which only a loop in continuous time can keep.
        """
        if jax.tree.leaves(self.inner.hold(measurement, reference)):
            raise ValueError(f"Sampled runs laws without memory; {type(self.inner).__name__} has some: put it outside")
        return self._begun(self.inner.init(measurement, reference), measurement, reference)

    def jump(
        self, flow: tuple[()], memory: Computed, measurement: Measurement, reference: Reference, h: Float[Array, ""]
    ) -> Computed:
        """The computer's work at one instant."""
        return self.step(memory.law, measurement, reference, memory.memory)

    def law(
        self, flow: tuple[()], memory: Computed, measurement: Measurement, reference: Reference
    ) -> tuple[Command, tuple[()]]:
        """The command in force."""
        return memory.command, ()

    def control_period(self) -> Real:
        """Time [s] between instants."""
        return self.period

    def limited(self, memory: Computed) -> Bool[Array, ""]:
        """Whether the law's command is limited."""
        return memory.limited

    def state(self, flow: tuple[()], memory: Computed) -> PyTree:
        """The state of the law inside."""
        return memory.law

    def gains_to_tune(self, heading: bool = True) -> tuple[str, ...]:
        """Those of the inner law and the compensation, and the bound on speed."""
        return (*super().gains_to_tune(heading), *(("anti_windup.speed",) if self.anti_windup.speed else ()))

    def poles(self) -> np.ndarray:
        """No poles that the integrator's step must suit."""
        return np.array([])

    def rates(self) -> dict[str, np.ndarray]:
        """No modes that the integrator's step must suit."""
        return {}

    def upper_bounds(self, stable: Stable) -> dict[str, float]:
        """Limits set by the period: with a zero-order hold a proportional loop is stable up to a rate of 2 / period."""
        fastest = 2 / float(self.period)
        bounds = {"k1": fastest, "k2": fastest, "k3": fastest, "omega_n": np.pi * fastest, "zeta": 3.0}
        parts, period = {"prediction": self.prediction, "compensation": self.compensation}, float(self.period)
        own = {f"{part}.{name}": x for part, held in parts.items() for name, x in held.upper_bounds(period).items()}
        return own | {f"inner.{name}": bounds[name] for name in leaves(self.inner) if name in bounds}

    def stability_bounds(self, Pi_min: float, Pi_psi_min: float) -> dict[str, float]:
        """No conditions: those of the inner law are proved in continuous time only."""
        return {}

    def input_limits(self) -> Float[Array, " m"] | None:
        """Those of its anti-windup."""
        return self.anti_windup.limits

    def believing(self, plant: Plant, deadzone: Mapping[str, Element]) -> Law:
        """With this plant as its vehicle, if it takes the vehicle for one of this kind; a predictor's delay stays."""
        if type(self.vehicle) is not type(plant):
            return self
        knowing = dataclasses.replace(self, prediction=self.prediction.believing(deadzone))
        return Allocating.believing(knowing, plant, deadzone)

    def faults(self, plant: Plant) -> list[Fault]:
        """What does not suit the vehicle, or limits that are not one for each input."""
        found, prediction = super().faults(plant), self.prediction
        found += [f._replace(key=f"prediction.{f.key}") for f in prediction.faults(self.vehicle, float(self.period))]
        names, limits = ", ".join(self.vehicle.actuators), self.anti_windup.limits
        if limits is not None and np.size(limits) != len(self.vehicle.actuators):
            found.append(Fault("anti_windup.limits", np.asarray(limits).tolist(), f"one for each of {names}"))
        return found
