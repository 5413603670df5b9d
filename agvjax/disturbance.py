"""Lumped disturbances delta_x, delta_y, delta_psi, eq. (10) and section 4.

Most split into a time-only `shape(t)`, which the rollout tabulates outside its loop, and `scale(shape)`, which it
applies inside, so that a batch of amplitudes costs one multiplication.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._pytree import ANY, NONNEGATIVE, Numbers, Real, Rule, number, pytree, structure
from .hashed import uniform
from .protocols import Disturbance

INCREASING = Rule("finite and each above the one before", lambda x: np.all(np.diff(x) > 0, axis=-1))
UNIT = "m/s^2, m/s^2, rad/s"
CHANNEL_UNIT = "m/s^2; rad/s in the heading"


@pytree
class NoDisturbance(Disturbance):
    """No disturbance."""

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "3"]:
        """Zeros, shape (3,)."""
        return jnp.zeros(3, t.dtype)


class Split(Disturbance):
    """A disturbance written as a time-only `shape` and its `scale`."""

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "3"]:
        """Disturbance at time `t` [s] in the x, y and heading channels, shape (3,)."""
        return self.scale(self.shape(t))


class Scaled(Split):
    """A shape times an amplitude."""

    amplitude: Real

    def scale(self, shape: Float[Array, "*n"]) -> Float[Array, "3"]:
        """The amplitude (one for all channels, or one each) times the shape, as (3,)."""
        return jnp.broadcast_to(self.amplitude * shape, (3,))


@pytree
class Cosine(Scaled):
    """Section 4: amplitude * cos(omega t + phase).

    Attributes:
        phase: at t = 0.
    """

    amplitude: Real = number(0.2, UNIT, ANY, "sec. 4", shape=(3,))
    omega: Real = number(0.5, "rad/s", NONNEGATIVE, "sec. 4", shape=(3,))
    phase: Real = number(0.0, "rad", ANY, shape=(3,))

    def shape(self, t: Float[Array, ""]) -> Float[Array, "*n"]:
        """cos(omega t + phase)."""
        return jnp.cos(self.omega * t + self.phase)


@pytree
class Step(Scaled):
    """0 before `time`, the amplitude from then on.

    Attributes:
        amplitude: from `time` on.
        time: when it begins.
    """

    amplitude: Real = number(0.2, UNIT, ANY, shape=(3,))
    time: Real = number(4.0, "s", ANY)

    def shape(self, t: Float[Array, ""]) -> Float[Array, ""]:
        """0 before the step, 1 after it."""
        return jnp.where(t >= self.time, jnp.ones_like(t), 0.0)

    def nearest_jump(self, t: Float[Array, ""]) -> Float[Array, ""]:
        """`time` [s]; a step of the integrator then begins there."""
        return jnp.broadcast_to(self.time, jnp.shape(t))


@pytree
class CosineSum(Split):
    """A sum of M cosines, the same in all three channels.

    Attributes:
        amplitudes: of each cosine.
        omegas: angular frequency of each cosine.
        phases: of each cosine at t = 0.
    """

    amplitudes: Float[Array, " M"] = number((0.1, 0.1), UNIT, ANY, shape=(None,))
    omegas: Float[Array, " M"] = number((0.5, 2.0), "rad/s", NONNEGATIVE, shape=(None,))
    phases: Float[Array, " M"] = number((0.0, 0.0), "rad", ANY, shape=(None,))

    def shape(self, t: Float[Array, ""]) -> Float[Array, " M"]:
        """cos(omegas t + phases), shape (M,)."""
        return jnp.cos(self.omegas * t + self.phases)

    def scale(self, shape: Float[Array, " M"]) -> Float[Array, "3"]:
        """The sum over the cosines, shape (3,)."""
        return jnp.broadcast_to(jnp.sum(self.amplitudes * shape), (3,))


@pytree
class Tone:
    """The disturbance of one channel: constant + cosine cos(omega t + phase) + sine sin(omega t + phase).

    Attributes:
        constant: the constant part.
        cosine: factor of cos(omega t + phase).
        sine: factor of sin(omega t + phase).
    """

    constant: Real = number(0.0, CHANNEL_UNIT, ANY)
    cosine: Real = number(0.0, CHANNEL_UNIT, ANY)
    sine: Real = number(0.0, CHANNEL_UNIT, ANY)


@pytree
class Harmonic(Split):
    """A constant and one frequency in each channel, linear in all but the frequency: it can be identified from a log.

    Attributes:
        x: disturbance along x.
        y: disturbance along y.
        heading: disturbance of the yaw rate.
        omega: angular frequency of all channels.
        phase: at t = 0.
    """

    x: Tone = Tone()
    y: Tone = Tone()
    heading: Tone = Tone()
    omega: Real = number(0.5, "rad/s", NONNEGATIVE)
    phase: Real = number(0.0, "rad", ANY)

    def shape(self, t: Float[Array, ""]) -> Float[Array, "3"]:
        """1, cosine and sine, shape (3,)."""
        angle = self.omega * t + self.phase
        return jnp.stack([jnp.ones_like(angle), jnp.cos(angle), jnp.sin(angle)])

    def scale(self, shape: Float[Array, "3"]) -> Float[Array, "3"]:
        """Of each channel their sum, shape (3,)."""
        channels = (self.x, self.y, self.heading)
        return jnp.stack([c.constant * shape[0] + c.cosine * shape[1] + c.sine * shape[2] for c in channels])


@pytree
class BandLimitedNoise(Scaled):
    """Noise between two frequencies, a pure function of time; `amplitude` is its root mean square over a long time.

    The sum of `terms` cosines in each channel, one in each of as many equal parts of the band. Where in its part, and
    with which phase, is drawn by a hash of the seed: the channels are uncorrelated, and nothing repeats soon.

    Attributes:
        amplitude: root mean square over a long time.
        low: lowest angular frequency.
        high: highest angular frequency.
        seed: of the noise.
        terms: number of cosines.
    """

    amplitude: Real = number(0.2, UNIT, ANY, shape=(3,))
    low: Real = number(1.0, "rad/s", NONNEGATIVE)
    high: Real = number(10.0, "rad/s", NONNEGATIVE, above="low")
    seed: Real = number(0.0, "1", NONNEGATIVE)
    terms: int = structure(32)

    def shape(self, t: Float[Array, ""]) -> Float[Array, "3"]:
        """Noise of root mean square 1, shape (3,)."""
        drawn = uniform(self.seed, jnp.arange(6 * self.terms).astype(t.dtype)).reshape(2, 3, self.terms)
        part = jnp.arange(self.terms).astype(t.dtype) + 0.25  # the middle half: two cosines do not merge into one
        omegas = self.low + (self.high - self.low) / self.terms * (part[None, :] + 0.5 * drawn[0])
        return (2 / self.terms) ** 0.5 * jnp.sum(jnp.cos(omegas * t + 2 * jnp.pi * drawn[1]), axis=1)


@pytree
class Recorded(Scaled):
    """A record: linear between its samples, constant before the first and after the last."""

    times: Float[Numbers, " N"] = number((0.0, 1.0), "s", INCREASING, shape=(None,))
    values: Float[Numbers, "N 3"] = dataclasses.field(default_factory=lambda: np.zeros((2, 3)))  # UNIT
    amplitude: Real = number(1.0, "1", ANY, shape=(3,))

    def shape(self, t: Float[Array, ""]) -> Float[Array, "3"]:
        """The record at time `t` [s], shape (3,)."""
        return jax.vmap(lambda channel: jnp.interp(t, self.times, channel), 1)(jnp.asarray(self.values))
