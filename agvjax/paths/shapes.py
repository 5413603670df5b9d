"""Reference paths and the heading they ask for, eq. (56) and section 4. Derivatives come from `jax.jvp`.

A path is anything with `__call__(t) -> (2,)` in metres, written with `jax.numpy` and twice differentiable.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._pytree import ANY, POSITIVE, Real, number, pytree
from ..geometry import TURN
from ..protocols import Path

SIXTH_OF_PI = 22 / 7 / 6  # reading R15: the paper prints 22/7 for pi


@pytree
class Dumbbell(Path):
    """Section 4: x = A sin(2 w t), y = A sin(w t)."""

    amplitude: Real = number(1.0, "m", POSITIVE, "sec. 4")
    omega: Real = number(SIXTH_OF_PI, "rad/s", POSITIVE, "sec. 4, with 22/7 for pi (reading R15)")

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "2"]:
        """Position [m]."""
        phase = self.omega * t
        return self.amplitude * jnp.stack([jnp.sin(2 * phase), jnp.sin(phase)])

    def bearing(self, t: Float[Array, ""]) -> Float[Array, ""]:
        """Eq. (56) with sin(w t) divided out of both arguments [rad]: equal on the first half lap, then smooth (R8)."""
        return jnp.arctan2(jnp.ones_like(t), 2 * jnp.cos(self.omega * t))

    def lap(self) -> float:
        """Time [s] of a lap."""
        return TURN / float(self.omega)

    def nearest_crossing(self, t: Float[Array, ""]) -> Float[Array, ""]:
        """When, nearest to `t` [s], the path passes the origin: sin(w t) = 0."""
        half_lap = jnp.pi / self.omega
        return half_lap * jnp.round(t / half_lap)


@pytree
class Circle(Path):
    """A circle about the origin, counter-clockwise from (radius, 0).

    Attributes:
        radius: of the circle.
        omega: laps in 2 pi seconds.
    """

    radius: Real = number(1.0, "m", POSITIVE)
    omega: Real = number(0.5, "rad/s", POSITIVE)

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "2"]:
        """Position [m]."""
        phase = self.omega * t
        return self.radius * jnp.stack([jnp.cos(phase), jnp.sin(phase)])

    def lap(self) -> float:
        """Time [s] of a lap."""
        return TURN / float(self.omega)


@pytree
class Lemniscate(Path):
    """Bernoulli's lemniscate, half-width `amplitude`, starting at (amplitude, 0).

    Attributes:
        amplitude: half its width.
        omega: laps in 2 pi seconds.
    """

    amplitude: Real = number(1.0, "m", POSITIVE)
    omega: Real = number(0.5, "rad/s", POSITIVE)

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "2"]:
        """Position [m]."""
        sine, cosine = jnp.sin(self.omega * t), jnp.cos(self.omega * t)
        return self.amplitude / (1 + sine**2) * jnp.stack([cosine, sine * cosine])

    def lap(self) -> float:
        """Time [s] of a lap."""
        return TURN / float(self.omega)

    def nearest_crossing(self, t: Float[Array, ""]) -> Float[Array, ""]:
        """When, nearest to `t` [s], the path passes the origin: cos(w t) = 0."""
        half_lap = jnp.pi / self.omega
        return half_lap * (jnp.floor(t / half_lap) + 0.5)


@pytree
class Line(Path):
    """A straight line from `origin` at constant velocity.

    Attributes:
        origin: where it begins.
        velocity: along it.
    """

    origin: Float[Array, "2"] = number((0.0, 0.0), "m", ANY, shape=(2,))
    velocity: Float[Array, "2"] = number((0.5, 0.0), "m/s", ANY, shape=(2,))

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "2"]:
        """Position [m]."""
        return self.origin + self.velocity * t
