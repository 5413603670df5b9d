"""Fractional-order integral action, the paper's future work: Lam I^lam in the place of Lam I."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PyTree

from .._pytree import POSITIVE, Real, Rule, number, pytree, structure
from ..errors import Fault
from ..messages import Command, Measurement, Reference
from ..protocols import Law, Plant
from .backstepping import Backstepping, BacksteppingState
from .neuro_backstepping import NeuroBackstepping
from .wrapping import Wrapping

ORDER = Rule("> 0 and <= 1", lambda x: (x > 0) & (x <= 1), 0.0, 1.0)


@pytree
class Oustaloup:
    """s^order between two frequencies by 2 N + 1 real poles and zeros, in diagonal form.

    y = gain u + sum(residues z), z' = poles z + u. With an input held over a step the states are exact:
    z <- exp(poles h) z + (exp(poles h) - 1) / poles u. The band is wider than 0.05 to 50 rad/s, where the realisation
    is to hold, by the decades it takes: from 0.01 to 1000 rad/s the phase of s^0.5 would be wrong by 5 degrees.
    """

    low: Real = number(1e-3, "rad/s", POSITIVE, "Oustaloup")
    high: Real = number(3e3, "rad/s", POSITIVE, "Oustaloup", above="low")
    N: int = structure(4)

    def modes(self, order: Real) -> tuple[Array, Array, Array]:
        """Poles (2N+1,) [1/s], residues (2N+1,) and the direct gain of s^order, order between 0 and 1."""
        count = 2 * self.N + 1
        k = jnp.asarray(np.arange(count) + 0.5, jnp.result_type(order))
        ratio = self.high / self.low
        zeros = -self.low * ratio ** ((k - 0.5 * order) / count)
        poles = -self.low * ratio ** ((k + 0.5 * order) / count)
        gain = self.high**order  # the product below tends to 1 as s grows
        above = poles[:, None] - zeros[None, :]
        below = poles[:, None] - poles[None, :] + jnp.eye(count, dtype=poles.dtype)
        return poles, gain * jnp.prod(above, axis=1) / jnp.prod(below, axis=1), gain


@pytree
class FractionalMemory:
    """What the realisation remembers of e_x, e_y, e_psi, one column each."""

    z: Float[Array, "2N+1 3"]  # its states
    mean: Float[Array, "2N+1 3"]  # their mean over the step to come, which is what an integral of them sees
    last: Float[Array, "3"]  # the errors at the last control instant, held since
    inner: PyTree  # memory of the inner law


@pytree
class FractionalBackstepping(Wrapping):
    """The backstepping law inside, with the integrals of (25) and (57) of order lam: beta' = s^(1-lam) Z.

    I^lam = s^-1 s^(1-lam), and s^(1-lam) by Oustaloup: so the integrator stays, and with it the vanishing error under
    a constant disturbance. lam = 1 is the law inside. Its stability conditions are proved for lam = 1 only. The
    realisation's own states are exact at any step.

    Attributes:
        inner: the backstepping law.
        lam: order of the integral.
        realisation: the rational approximation of the fractional derivative.
    """

    inner: Law = NeuroBackstepping()
    lam: Real = number(0.8, "1", ORDER)
    realisation: Oustaloup = Oustaloup()

    def gains_to_tune(self, heading: bool = True) -> tuple[str, ...]:
        """The inner law's gains, and the order."""
        return (*super().gains_to_tune(heading), "lam")

    def faults(self, plant: Plant) -> list[Fault]:
        """A law inside that has no integrals, and what of it does not suit the plant."""
        inner = self.inner
        while isinstance(inner, Wrapping):
            inner = inner.inner
        if isinstance(inner, Backstepping):
            return super().faults(plant)
        rule = "a backstepping law, with integrals of the errors for this order"
        return [Fault("inner", type(inner).__name__, rule, "eqs. (25), (57)")]

    def hold(self, measurement: Measurement, reference: Reference) -> FractionalMemory:
        """States 0, as if there had been no error before."""
        zero = jnp.zeros((3,), measurement.heading.dtype)
        none = jnp.zeros((2 * self.realisation.N + 1, 3), zero.dtype)
        return FractionalMemory(z=none, mean=none, last=zero, inner=self.inner.hold(measurement, reference))

    def jump(
        self,
        flow: PyTree,
        memory: FractionalMemory,
        measurement: Measurement,
        reference: Reference,
        h: Float[Array, ""],
    ) -> FractionalMemory:
        """The states now, exact for errors that were constant since the last control instant."""
        inner = self.inner.jump(flow, memory.inner, measurement, reference, h)
        poles, _, _ = self.realisation.modes(1 - self.lam)
        now = _errors(self.inner.law(flow, inner, measurement, reference)[1])
        decay = jnp.exp(poles * h)
        share = (decay - 1) / (poles * h)  # mean of exp(poles t) over a step
        z = decay[:, None] * memory.z + (share * h)[:, None] * memory.last[None, :]
        mean = share[:, None] * z + ((share - 1) / poles)[:, None] * now[None, :]
        return FractionalMemory(z=z, mean=mean, last=now, inner=inner)

    def law(
        self, flow: PyTree, memory: FractionalMemory, measurement: Measurement, reference: Reference
    ) -> tuple[Command, PyTree]:
        """The command of the law inside, and its derivative with the fractional integrals."""
        command, rate = self.inner.law(flow, memory.inner, measurement, reference)
        _, residues, gain = self.realisation.modes(1 - self.lam)
        beta_rate = gain * _errors(rate) + jnp.sum(residues[:, None] * memory.mean, axis=0)
        return command, dataclasses.replace(rate, beta1=beta_rate[:2], beta2=beta_rate[2])

    def limited(self, memory: FractionalMemory) -> Bool[Array, ""]:
        """Whether the inner law keeps something back."""
        return self.inner.limited(memory.inner)

    def state(self, flow: PyTree, memory: FractionalMemory) -> PyTree:
        """What the inner law shows."""
        return self.inner.state(flow, memory.inner)


def _errors(rate: PyTree) -> Float[Array, "3"]:
    if not isinstance(rate, BacksteppingState):
        kind = type(rate).__name__
        raise TypeError(f"FractionalBackstepping needs an inner law with the integrals (25), (57); its state is {kind}")
    return jnp.concatenate([rate.beta1, rate.beta2[None]])  # the rates of the plain integrals are the errors
