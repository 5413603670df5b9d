"""A number of a law that is a curve over something measured: the gain for slow driving is not that for fast."""

from __future__ import annotations

from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._pytree import ANY, number, pytree, structure
from .errors import Fault
from .geometry import into_body, safe_sqrt
from .messages import Measurement

T = TypeVar("T")
MEASURED = {  # what a number can be a curve over, with its unit
    "speed": "m/s",  # size of the velocity
    "velocity": "m/s",  # along the heading: below 0 backwards
    "yaw_rate": "rad/s",  # its size
    "steering_angle": "rad",  # its size, of vehicles that measure it
}


@pytree
class Schedule:
    """A scheduled gain, for any scalar of a law: `PathPID(k_y=Schedule(over="speed", nodes=[0, 1], values=[8, 4]))`.

    A piecewise cubic through the values that rises and falls where they do and nowhere else (slopes at inner nodes of
    Fritsch and Butland, A method for constructing local monotone piecewise cubic interpolants, SIAM J. Sci. Stat.
    Comput. 5(2), 1984, as SciPy's PCHIP has them), with slope 0 at both ends and constant beyond them: once
    differentiable everywhere. Equal values are exactly that number. The value is looked up at the measurement, also if
    the law acts on a prediction.

    Written out here, since the JAX libraries that have such a curve bring a framework with them.
    """

    over: str = structure("speed")
    nodes: Float[Array, " n"] = number((0.0, 1.0), "of what it is over, rising", ANY, shape=(None,))
    values: Float[Array, " n"] = number((1.0, 1.0), "of the number that it stands for", ANY, shape=(None,))

    def __call__(self, x: Float[Array, ""]) -> Float[Array, ""]:
        """The number at x."""
        nodes, values = jnp.asarray(self.nodes), jnp.asarray(self.values)
        h, rise = jnp.diff(nodes), jnp.diff(values)
        level = jnp.zeros_like(values[:1])
        inner = [_inner_slopes(h, rise / h)] if len(values) > 2 else []
        at = jnp.concatenate([level, *inner, level])
        t = jnp.clip((x - nodes[:-1]) / h, 0.0, 1.0)  # how far through each piece; no search for the one that it is in
        pieces = rise * t**2 * (3 - 2 * t) + h * t * (1 - t) * (at[:-1] * (1 - t) - at[1:] * t)
        return values[0] + jnp.sum(pieces)

    def of(self, measurement: Measurement) -> Float[Array, ""]:
        """The number for what was measured.

        Raises:
            ValueError: the vehicle does not measure it.
        """
        if self.over == "velocity":
            return self(into_body(measurement.velocity, measurement.heading)[0])
        if self.over == "speed":
            return self(safe_sqrt(jnp.sum(measurement.velocity**2)))
        value = {"yaw_rate": measurement.yaw_rate, "steering_angle": measurement.steering_angle}.get(self.over)
        if value is None:
            raise ValueError(f"a schedule over {self.over}, which the vehicle does not measure")
        return self(jnp.abs(value))

    def faults(self, key: str) -> list[Fault]:
        """What is wrong with it besides its numbers."""
        found, (nodes, values) = [], (np.asarray(x, float) for x in (self.nodes, self.values))
        if self.over not in MEASURED:
            found.append(Fault(f"{key}.over", self.over, f"one of {', '.join(MEASURED)}"))
        if nodes.size < 2 or np.any(np.diff(nodes) <= 0):
            found.append(Fault(f"{key}.nodes", nodes.tolist(), "at least two numbers, each larger than the one before"))
        if values.size != nodes.size:
            found.append(Fault(f"{key}.values", values.tolist(), f"one for each node, {nodes.size}"))
        return found


def _inner_slopes(h: Float[Array, " m"], slope: Float[Array, " m"]) -> Float[Array, " m-1"]:
    """Weighted harmonic means of the slopes to both sides, 0 where they differ in sign."""
    before, after = slope[:-1], slope[1:]
    turns = before * after <= 0
    w, v = 2 * h[1:] + h[:-1], h[1:] + 2 * h[:-1]
    mean = (w + v) / (w / jnp.where(turns, 1.0, before) + v / jnp.where(turns, 1.0, after))
    return jnp.where(turns, 0.0, mean)


def scheduled(tree: T, measurement: Measurement) -> T:
    """A law with the numbers for what was measured in the place of its schedules."""
    return _with(tree, lambda schedule: schedule.of(measurement))


def extremes(tree: T) -> tuple[T, T]:
    """A law with the smallest number of every schedule in its place, and with the largest."""
    return _with(tree, lambda s: float(np.min(s.values))), _with(tree, lambda s: float(np.max(s.values)))


def schedules(tree: Any) -> dict[str, Schedule]:
    """All schedules of a law by their dotted names."""
    named = jax.tree_util.tree_leaves_with_path(tree, is_leaf=_is_one)
    return {jax.tree_util.keystr(path, simple=True, separator="."): x for path, x in named if _is_one(x)}


def _with(tree: T, number: Any) -> T:
    if not schedules(tree):
        return tree
    return jax.tree.map(lambda x: number(x) if _is_one(x) else x, tree, is_leaf=_is_one)


def _is_one(x: Any) -> bool:
    return isinstance(x, Schedule)
