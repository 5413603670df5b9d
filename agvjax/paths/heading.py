"""The heading that a path asks for, eq. (56), and all else that a law may ask of a path; derivatives by `jax.jvp`."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._pytree import pytree
from ..errors import Fault
from ..geometry import bearing
from ..messages import Reference
from ..protocols import Heading, Path


@pytree
class Bearing(Heading):
    """Eq. (56) continued smoothly past the origin (reading R8, the default for the dumbbell)."""

    def __call__(self, path: Path, t: Float[Array, ""]) -> Float[Array, ""]:
        """Heading [rad]; the path says what its smooth bearing is, in a method `bearing(t)`."""
        angle = path.bearing(t)
        if angle is None:
            raise ValueError(
                f"heading Bearing needs a path with a method bearing(t); {type(path).__name__} has none: use Tangent"
            )
        return angle

    def faults(self, path: Path) -> list[Fault]:
        """Not every path has a smooth bearing."""
        rule = "tangent or a raw bearing: this path has no smooth bearing"
        return [] if says(path.bearing) else [Fault("heading", "bearing", rule, "reading R8")]


@pytree
class RawBearing(Heading):
    """Eq. (56) as printed: the bearing of the point from the origin, which jumps by pi when the path passes it (R8)."""

    def __call__(self, path: Path, t: Float[Array, ""]) -> Float[Array, ""]:
        """Heading [rad]."""
        x, y = path(t)
        return bearing(y, x)

    def nearest_jump(self, path: Path, t: Float[Array, ""]) -> Float[Array, ""] | None:
        """When, nearest to `t` [s], the path passes the origin; steps of the integrator then begin there."""
        return path.nearest_crossing(t)


@pytree
class SwappedBearing(Heading):
    """Section 4 as printed: atan2(x_d, y_d) (reading R8)."""

    def __call__(self, path: Path, t: Float[Array, ""]) -> Float[Array, ""]:
        """Heading [rad]."""
        x, y = path(t)
        return bearing(x, y)

    def nearest_jump(self, path: Path, t: Float[Array, ""]) -> Float[Array, ""] | None:
        """When, nearest to `t` [s], the path passes the origin; steps of the integrator then begin there."""
        return path.nearest_crossing(t)


@pytree
class Tangent(Heading):
    """The direction of travel: the heading a vehicle that rolls without slip needs (reading R8)."""

    def __call__(self, path: Path, t: Float[Array, ""]) -> Float[Array, ""]:
        """Heading [rad]; 0 where the path stands still."""
        x_rate, y_rate = _rate(path, t)
        return bearing(y_rate, x_rate)


def _rate(signal: Path, t: Float[Array, ""]) -> Float[Array, "2"]:
    return jax.jvp(signal, (t,), (jnp.ones_like(t),))[1]


def default_heading(path: Path) -> Heading:
    """Reading R8: the smooth bearing where the path has one (the dumbbell), the tangent for every other path."""
    return Bearing() if says(path.bearing) else Tangent()


def says(of_time: Callable[[Array], Array | None]) -> bool:
    """Whether a function of time gives a value, and not None; it is traced and not run."""
    return jax.eval_shape(of_time, 0.0) is not None


def reference(path: Path, heading: Callable[[Path, Array], Array] | None, t: Float[Array, ""]) -> Reference:
    """All that the laws may ask of the path at time `t` [s]; `heading` None takes `default_heading(path)`."""
    heading = default_heading(path) if heading is None else heading

    def motion(time: Float[Array, ""]) -> tuple[Array, Array]:
        return jax.jvp(path, (time,), (jnp.ones_like(time),))

    (position, velocity), (_, acceleration) = jax.jvp(motion, (t,), (jnp.ones_like(t),))
    psi_d, psi_d_rate = jax.jvp(lambda time: heading(path, time), (t,), (jnp.ones_like(t),))
    return Reference(
        position=position, velocity=velocity, acceleration=acceleration, heading=psi_d, heading_rate=psi_d_rate
    )
