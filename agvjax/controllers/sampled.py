"""The digital loop: a law that runs once a period, on what it measured then, and holds what it asked for."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._pytree import POSITIVE, number, pytree, structure
from ..messages import Command, Measurement, Reference
from ..plants import Decoupled
from .neuro_backstepping import NeuroBackstepping


@pytree
class NoAntiWindup:
    """The law asks for whatever it likes."""

    speed = None

    def applied(self, inputs: dict[str, Array]) -> dict[str, Array]:
        """All of it."""
        return inputs


@pytree
class BackCalculation:
    """The law knows what it may ask for, and takes back from its own state what it may not."""

    speed: float = number(1.0, "m/s", POSITIVE, "bound of |alpha1 - chi1_d'|")
    limits: Float[Array, " m"] = number((4.0, 4.0), "of each input, in the vehicle's order", POSITIVE, shape=(None,))

    def applied(self, inputs: dict[str, Array]) -> dict[str, Array]:
        """The inputs within their limits."""
        limits = jnp.asarray(self.limits)
        return {name: jnp.clip(u, -limits[i], limits[i]) for i, (name, u) in enumerate(inputs.items())}


@pytree
class Computed:
    """What the computer remembers from one period to the next."""

    law: Any  # state of the law inside
    command: Command  # in force, with its inputs
    limited: Bool[Array, ""]  # whether the law kept something back


@pytree
class Sampled:
    """A law run every `period`, its inputs held in between (zero-order hold).

    `vehicle` is what the computer takes the vehicle for: a plant, whose `allocate` turns the law's command into inputs
    of actuators, from what was measured at that instant. A law with a `step` of its own is stepped by it, others and
    with `euler` all by Euler's method. Nothing is asked of the actuators before the first instant.
    """

    inner: Any = NeuroBackstepping()
    vehicle: Any = Decoupled()
    period: float = number(0.02, "s", POSITIVE)
    anti_windup: NoAntiWindup | BackCalculation = NoAntiWindup()
    euler: bool = structure(False)

    def step(self, state: Any, measurement: Measurement, reference: Reference) -> Computed:
        """One period: pure, and all that the computer does. `state` is that of the law inside, see `inner.init`."""
        speed, period = self.anti_windup.speed, self.period
        if self.euler or not hasattr(self.inner, "step"):
            asked, rate = self.inner.law(state, (), measurement, reference)
            later, limited = jax.tree.map(lambda x, dx: x + period * dx, state, rate), jnp.zeros((), bool)
        else:
            asked, later, limited = self.inner.step(state, measurement, reference, period, speed)
        inputs = self.vehicle.allocate(asked, measurement)
        applied = self.anti_windup.applied(inputs)
        if speed is not None and hasattr(self.inner, "relieved"):
            limited = limited | jnp.any(jnp.stack([jnp.any(applied[name] != inputs[name]) for name in inputs]))
            missing = asked.position - self.vehicle.achieved(applied, measurement)
            later = self.inner.relieved(state, later, missing, limited, period)
        command = Command(position=asked.position, heading=asked.heading, inputs=applied)
        return Computed(law=later, command=command, limited=limited)

    def init(self, measurement: Measurement, reference: Reference) -> tuple[()]:
        """Nothing flows."""
        return ()

    def hold(self, measurement: Measurement, reference: Reference) -> Computed:
        """Before the first instant."""
        state = self.inner.init(measurement, reference)
        first = self.step(state, measurement, reference)
        nothing = jax.tree.map(jnp.zeros_like, first.command)
        return Computed(law=state, command=nothing, limited=jnp.zeros((), bool))

    def jump(self, flow: Any, held: Computed, measurement: Measurement, reference: Reference, h: Any) -> Computed:
        """At an instant."""
        return self.step(held.law, measurement, reference)

    def law(self, flow: Any, held: Computed, measurement: Measurement, reference: Reference) -> tuple[Command, Any]:
        """What is held."""
        return held.command, ()

    def limited(self, held: Computed) -> Bool[Array, ""]:
        """Whether the law keeps back something that it would like to ask for."""
        return held.limited

    def state(self, flow: Any, held: Computed) -> Any:
        """The state of the law inside."""
        return held.law

    @property
    def weight_norms(self) -> Any:
        """Those of the law inside."""
        return self.inner.weight_norms

    @property
    def tunable(self) -> tuple[str, ...]:
        """Those of the law inside, the heading's only where the vehicle lets it be commanded; the bound on speed."""
        heading = getattr(self.vehicle, "commands_heading", True)
        own = [name for name in self.inner.tunable if heading or name not in getattr(self.inner, "of_heading", ())]
        return (*(f"inner.{name}" for name in own), *(("anti_windup.speed",) if self.anti_windup.speed else ()))

    def upper_bounds(self, stable: Any) -> dict[str, float]:
        """What a period can hold: a rate of 2 / period is where a held proportional loop ends to be stable."""
        fastest = 2 / float(self.period)
        bounds = {"k1": fastest, "k2": fastest, "k3": fastest, "omega_n": np.pi * fastest, "zeta": 3.0}
        return {f"inner.{name}": limit for name, limit in bounds.items() if hasattr(self.inner, name)}
