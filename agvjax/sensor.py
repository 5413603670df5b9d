"""Sensors: what the controller measures of the vehicle."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._pytree import NONNEGATIVE, Real, number, pytree
from .geometry import into_plane, turned
from .messages import Measurement
from .protocols import Sensor


@pytree
class NoiseMemory:
    """Standard normal numbers of this control instant, and how many instants there were."""

    drawn: Float[Array, "6"]
    count: Float[Array, ""]


@pytree
class Noise(Sensor):
    """White Gaussian measurement noise, drawn anew at every control instant; the numbers are standard deviations.

    The noise depends only on the seed and on the number of instants so far.

    Attributes:
        position: standard deviation of x and y.
        velocity: standard deviation of the velocity, along x and y.
        heading: standard deviation of the heading.
        yaw_rate: standard deviation of the yaw rate.
        seed: of the noise.
    """

    position: Real = number(2e-3, "m", NONNEGATIVE)
    velocity: Real = number(4e-3, "m/s", NONNEGATIVE)
    heading: Real = number(0.0, "rad", NONNEGATIVE)
    yaw_rate: Real = number(0.0, "rad/s", NONNEGATIVE)
    seed: Real = number(0.0, "1", NONNEGATIVE)

    def hold(self, measurement: Measurement) -> NoiseMemory:
        """The numbers of the first control instant."""
        return self._at(jnp.zeros_like(measurement.heading))

    def jump(self, memory: NoiseMemory, measurement: Measurement, h: Array) -> NoiseMemory:
        """The numbers of the next control instant."""
        return self._at(memory.count + 1)

    def _at(self, count: Array) -> NoiseMemory:
        key = jax.random.fold_in(jax.random.key(jnp.asarray(self.seed).astype(int)), count.astype(int))
        return NoiseMemory(drawn=jax.random.normal(key, (6,), count.dtype), count=count)

    def __call__(self, memory: NoiseMemory, measurement: Measurement) -> Measurement:
        """What the controller is told."""
        n = memory.drawn
        return dataclasses.replace(
            measurement,
            position=measurement.position + self.position * n[:2],
            velocity=measurement.velocity + self.velocity * n[2:4],
            heading=measurement.heading + self.heading * n[4],
            yaw_rate=measurement.yaw_rate + self.yaw_rate * n[5],
        )


@pytree
class Mounted(Noise):
    """A sensor of the pose that is not where the law takes it to be: beside the reference point, and turned.

    A bias is what a calibration left over, or markers and antennas stuck on by eye. What it tells is the motion of the
    point where it is mounted, and a heading that is off by as much as it is turned; the noise is added to that.

    Attributes:
        ahead: how far the sensor is ahead of the reference point, along the vehicle.
        left: how far it is to the left of it.
        turned: how far it is turned to the left: added to the heading.
    """

    position: Real = number(0.0, "m", NONNEGATIVE)
    velocity: Real = number(0.0, "m/s", NONNEGATIVE)
    ahead: Real = number(0.0, "m")
    left: Real = number(0.0, "m")
    turned: Real = number(0.0, "rad")

    def seen(self, measurement: Measurement) -> Measurement:
        """What would be told without noise."""
        offset = into_plane(jnp.asarray(self.ahead), jnp.asarray(self.left), measurement.heading)
        return dataclasses.replace(
            measurement,
            position=measurement.position + offset,
            velocity=measurement.velocity + turned(offset, measurement.yaw_rate),
            heading=measurement.heading + self.turned,
        )

    def __call__(self, memory: NoiseMemory, measurement: Measurement) -> Measurement:
        """What the controller is told."""
        return super().__call__(memory, self.seen(measurement))
