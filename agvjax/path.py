"""Reference paths and the heading they ask for, eq. (56) and section 4. Derivatives come from `jax.jvp`.

A path is anything with `__call__(t) -> (2,)` in metres, written with `jax.numpy` and twice differentiable.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._pytree import ANY, POSITIVE, number, pytree
from .angle import bearing

SIXTH_OF_PI = 22 / 7 / 6  # reading R15: the paper prints 22/7 for pi


@pytree
class Reference:
    """What the path asks for at one instant."""

    position: Float[Array, "2"]  # m
    velocity: Float[Array, "2"]  # m/s
    acceleration: Float[Array, "2"]  # m/s^2
    heading: Float[Array, ""]  # rad
    heading_rate: Float[Array, ""]  # rad/s


@pytree
class Bearing:
    """Eq. (56) continued smoothly past the origin (reading R8, the default for the dumbbell)."""

    def __call__(self, path: Any, t: Float[Array, ""]) -> Float[Array, ""]:
        """Heading [rad]; the path says what its smooth bearing is, in a method `bearing(t)`."""
        if not hasattr(path, "bearing"):
            raise ValueError(
                f"heading Bearing needs a path with a method bearing(t); {type(path).__name__} has none: use Tangent"
            )
        return path.bearing(t)


@pytree
class RawBearing:
    """Eq. (56) as printed: the bearing of the point from the origin, which jumps by pi when the path passes it (R8)."""

    def __call__(self, path: Any, t: Float[Array, ""]) -> Float[Array, ""]:
        """Heading [rad]."""
        x, y = path(t)
        return bearing(y, x)

    def nearest_jump(self, path: Any, t: Float[Array, ""]) -> Float[Array, ""]:
        """When, nearest to `t` [s], the path passes the origin; steps of the integrator then begin there."""
        return path.nearest_crossing(t)


@pytree
class SwappedBearing:
    """Section 4 as printed: atan2(x_d, y_d) (reading R8)."""

    def __call__(self, path: Any, t: Float[Array, ""]) -> Float[Array, ""]:
        """Heading [rad]."""
        x, y = path(t)
        return bearing(x, y)

    def nearest_jump(self, path: Any, t: Float[Array, ""]) -> Float[Array, ""]:
        """When, nearest to `t` [s], the path passes the origin; steps of the integrator then begin there."""
        return path.nearest_crossing(t)


@pytree
class Tangent:
    """The direction of travel: the heading a vehicle that rolls without slip needs (reading R8)."""

    def __call__(self, path: Any, t: Float[Array, ""]) -> Float[Array, ""]:
        """Heading [rad]; 0 where the path stands still."""
        x_rate, y_rate = _rate(path, t)
        return bearing(y_rate, x_rate)


@pytree
class Dumbbell:
    """Section 4: x = A sin(2 w t), y = A sin(w t)."""

    amplitude: float = number(1.0, "m", POSITIVE, "sec. 4")
    omega: float = number(SIXTH_OF_PI, "rad/s", POSITIVE, "sec. 4, with 22/7 for pi (reading R15)")

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "2"]:
        """Position [m]."""
        phase = self.omega * t
        return self.amplitude * jnp.stack([jnp.sin(2 * phase), jnp.sin(phase)])

    def bearing(self, t: Float[Array, ""]) -> Float[Array, ""]:
        """Eq. (56) with sin(w t) divided out of both arguments [rad]: equal on the first half lap, then smooth (R8)."""
        return jnp.arctan2(jnp.ones_like(t), 2 * jnp.cos(self.omega * t))

    def nearest_crossing(self, t: Float[Array, ""]) -> Float[Array, ""]:
        """When, nearest to `t` [s], the path passes the origin: sin(w t) = 0."""
        half_lap = jnp.pi / self.omega
        return half_lap * jnp.round(t / half_lap)


@pytree
class Circle:
    """A circle about the origin, counter-clockwise from (radius, 0)."""

    radius: float = number(1.0, "m", POSITIVE)
    omega: float = number(0.5, "rad/s", POSITIVE)

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "2"]:
        """Position [m]."""
        phase = self.omega * t
        return self.radius * jnp.stack([jnp.cos(phase), jnp.sin(phase)])


@pytree
class Lemniscate:
    """Bernoulli's lemniscate, half-width `amplitude`, starting at (amplitude, 0)."""

    amplitude: float = number(1.0, "m", POSITIVE)
    omega: float = number(0.5, "rad/s", POSITIVE)

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "2"]:
        """Position [m]."""
        sine, cosine = jnp.sin(self.omega * t), jnp.cos(self.omega * t)
        return self.amplitude / (1 + sine**2) * jnp.stack([cosine, sine * cosine])

    def nearest_crossing(self, t: Float[Array, ""]) -> Float[Array, ""]:
        """When, nearest to `t` [s], the path passes the origin: cos(w t) = 0."""
        half_lap = jnp.pi / self.omega
        return half_lap * (jnp.floor(t / half_lap) + 0.5)


@pytree
class Line:
    """A straight line from `origin` at constant velocity."""

    origin: Float[Array, "2"] = number((0.0, 0.0), "m", ANY, shape=(2,))
    velocity: Float[Array, "2"] = number((0.5, 0.0), "m/s", ANY, shape=(2,))

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "2"]:
        """Position [m]."""
        return self.origin + self.velocity * t


def _rate(signal: Any, t: Float[Array, ""]) -> Any:
    return jax.jvp(signal, (t,), (jnp.ones_like(t),))[1]


def default_heading(path: Any) -> Any:
    """Reading R8: the smooth bearing where the path has one (the dumbbell), the tangent for every other path."""
    return Bearing() if hasattr(path, "bearing") else Tangent()


def reference(path: Any, heading: Any, t: Float[Array, ""]) -> Reference:
    """All that the laws may ask of the path at time `t` [s]; `heading` None takes `default_heading(path)`."""
    heading = default_heading(path) if heading is None else heading

    def motion(time: Float[Array, ""]) -> tuple[Any, Any]:
        return jax.jvp(path, (time,), (jnp.ones_like(time),))

    (position, velocity), (_, acceleration) = jax.jvp(motion, (t,), (jnp.ones_like(t),))
    psi_d, psi_d_rate = jax.jvp(lambda time: heading(path, time), (t,), (jnp.ones_like(t),))
    return Reference(
        position=position, velocity=velocity, acceleration=acceleration, heading=psi_d, heading_rate=psi_d_rate
    )
