"""Fractional-order integral action, the paper's future work: Lam I^lam in the place of Lam I."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._pytree import POSITIVE, Rule, number, pytree, structure
from ..messages import Command, Measurement, Reference
from .neuro_backstepping import NeuroBackstepping

ORDER = Rule("> 0 and <= 1", lambda x: (x > 0) & (x <= 1), 0.0, 1.0)


@pytree
class Oustaloup:
    """s^order between two frequencies by 2 N + 1 real poles and zeros, in diagonal form.

    y = gain u + sum(residues z), z' = poles z + u. With an input held over a step the states are exact:
    z <- exp(poles h) z + (exp(poles h) - 1) / poles u. The band is wider than 0.05 to 50 rad/s, where the realisation
    is to hold, by the decades it takes: from 0.01 to 1000 rad/s the phase of s^0.5 would be wrong by 5 degrees.
    """

    low: float = number(1e-3, "rad/s", POSITIVE, "Oustaloup")
    high: float = number(3e3, "rad/s", POSITIVE, "Oustaloup")
    N: int = structure(4)

    def modes(self, order: Any) -> tuple[Array, Array, Array]:
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


@pytree
class FractionalBackstepping:
    """The backstepping law inside, with the integrals of (25) and (57) of order lam: beta' = s^(1-lam) Z.

    I^lam = s^-1 s^(1-lam), and s^(1-lam) by Oustaloup: so the integrator stays, and with it the vanishing error under
    a constant disturbance. lam = 1 is the law inside.
    """

    inner: Any = NeuroBackstepping()
    lam: float = number(0.8, "1", ORDER, "order of the integral")
    realisation: Oustaloup = Oustaloup()

    @property
    def tunable(self) -> tuple[str, ...]:
        """Those of the law inside, and the order."""
        return (*(f"inner.{name}" for name in self.inner.tunable), "lam")

    def init(self, measurement: Measurement, reference: Reference) -> Any:
        """The state of the law inside."""
        return self.inner.init(measurement, reference)

    def hold(self, measurement: Measurement, reference: Reference) -> FractionalMemory:
        """States 0, as if there had been no error before."""
        zero = jnp.zeros((3,), measurement.heading.dtype)
        none = jnp.zeros((2 * self.realisation.N + 1, 3), zero.dtype)
        return FractionalMemory(z=none, mean=none, last=zero)

    def jump(
        self, flow: Any, held: FractionalMemory, measurement: Measurement, reference: Reference, h: Float[Array, ""]
    ) -> FractionalMemory:
        """The states now, exact for errors that were constant since the last control instant."""
        poles, _, _ = self.realisation.modes(1 - self.lam)
        now = _errors(self.inner.law(flow, (), measurement, reference)[1])
        decay = jnp.exp(poles * h)
        share = (decay - 1) / (poles * h)  # mean of exp(poles t) over a step
        z = decay[:, None] * held.z + (share * h)[:, None] * held.last[None, :]
        mean = share[:, None] * z + ((share - 1) / poles)[:, None] * now[None, :]
        return FractionalMemory(z=z, mean=mean, last=now)

    def law(
        self, flow: Any, held: FractionalMemory, measurement: Measurement, reference: Reference
    ) -> tuple[Command, Any]:
        """The command of the law inside, and its derivative with the fractional integrals."""
        command, rate = self.inner.law(flow, (), measurement, reference)
        _, residues, gain = self.realisation.modes(1 - self.lam)
        beta_rate = gain * _errors(rate) + jnp.sum(residues[:, None] * held.mean, axis=0)
        return command, dataclasses.replace(rate, beta1=beta_rate[:2], beta2=beta_rate[2])

    @property
    def weight_norms(self) -> Callable[[Any], Float[Array, "2"]]:
        """Those of the law inside."""
        return self.inner.weight_norms

    @property
    def fastest(self) -> tuple[str, str]:
        """That of the law inside."""
        return self.inner.fastest

    @property
    def poles(self) -> Callable[[], np.ndarray]:
        """Those of the law inside; the realisation's own states are exact at any step."""
        return self.inner.poles

    def upper_bounds(self, stable: Callable[[np.ndarray], bool]) -> dict[str, float]:
        """Those of the law inside."""
        return {f"inner.{name}": limit for name, limit in self.inner.upper_bounds(stable).items()}

    def stability_bounds(self, Pi_min: float, Pi_psi_min: float) -> dict[str, float]:
        """Those of the law inside, which its proof gives for lam = 1."""
        bounds = self.inner.stability_bounds(Pi_min, Pi_psi_min)
        return {f"inner.{name}": limit for name, limit in bounds.items()}


def _errors(rate: Any) -> Float[Array, "3"]:
    return jnp.concatenate([rate.beta1, rate.beta2[None]])  # the rates of the plain integrals are the errors
