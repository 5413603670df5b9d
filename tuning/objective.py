"""What to minimise and what not to exceed, over an ensemble: the default tuning problem and its relatives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

import agvjax

METRICS: dict[str, Callable[[agvjax.Metrics], Array]] = {
    "rmse": lambda m: m.total_rmse,
    "effort": lambda m: m.effort,
    "peak_position": lambda m: m.peak_position,
    "peak_heading": lambda m: m.peak_heading,
    "chatter": lambda m: m.total_chatter,
    "iae": lambda m: jnp.sum(m.iae, -1),
    "ise": lambda m: jnp.sum(m.ise, -1),
    "itae": lambda m: jnp.sum(m.itae, -1),
    "effort_x": lambda m: m.rms_command[..., 0],
    "effort_y": lambda m: m.rms_command[..., 1],
    "effort_heading": lambda m: m.rms_command[..., 2],
    "peak_x": lambda m: m.peak_command[..., 0],
    "peak_y": lambda m: m.peak_command[..., 1],
    "chatter_x": lambda m: m.chatter[..., 0],
    "chatter_y": lambda m: m.chatter[..., 1],
    "chatter_heading": lambda m: m.chatter[..., 2],
}
UNITS = {"rmse": "m, rad", "effort": "mixed", "peak_position": "m/s^2", "peak_heading": "rad/s", "chatter": "mixed"}


class Score(NamedTuple):
    """What one set of gains is worth on an ensemble; ratios are to the starting gains."""

    cost: Float[Array, ""]  # goal + penalty
    goal: Float[Array, ""]
    excess: Float[Array, ""]  # largest amount by which a limit is exceeded, as a ratio; 0 or less: all are met
    latched: Float[Array, ""]  # runs that diverged


class Objective(NamedTuple):
    """Minimise `mean` and `worst` times a metric over the ensemble, keep others within limits.

    The goal's metric and the limited ones are taken relative to `reference`, their mean and worst with the starting
    gains or with those of another law. A limit holds for the mean and for the worst. A run that diverged counts
    `latched` times the reference and sends no gradient.
    """

    metric: str = "rmse"
    mean: float = 1.0
    worst: float = 0.3
    limits: Mapping[str, float] = {"effort": 1.0, "peak_position": 1.0, "peak_heading": 1.0}
    penalty: float = 3.0
    latched: float = 10.0

    @property
    def names(self) -> tuple[str, ...]:
        """The metrics that matter: the goal's first, then the limited ones."""
        return (self.metric, *self.limits)

    def values(self, metrics: agvjax.Metrics) -> tuple[Float[Array, "M B"], Bool[Array, " B"]]:
        """Those metrics of every scenario, and which runs are worth having."""
        return jnp.stack([METRICS[name](metrics) for name in self.names]), metrics.ok

    def reference(self, values: Float[Array, "M B"], ok: Bool[Array, " B"]) -> np.ndarray:
        """Mean and worst (2, M) of the runs that did not diverge."""
        kept = np.asarray(values)[:, np.asarray(ok)]
        return np.stack([kept.mean(1), kept.max(1)])

    def ratios(self, values: Float[Array, "M B"], ok: Bool[Array, " B"], reference: Any) -> Float[Array, "2 M"]:
        """Mean and worst over the ensemble, relative to the reference."""
        diverged = jax.lax.stop_gradient(self.latched * jnp.asarray(reference, values.dtype))
        mean = jnp.mean(jnp.where(ok, values, diverged[0][:, None]), axis=1)
        worst = jnp.max(jnp.where(ok, values, diverged[1][:, None]), axis=1)
        return jnp.stack([mean, worst]) / jnp.asarray(reference, values.dtype)

    def score(self, values: Float[Array, "M B"], ok: Bool[Array, " B"], reference: Any) -> Score:
        """Cost and what it is made of."""
        ratios = self.ratios(values, ok, reference)
        goal = self.mean * ratios[0, 0] + self.worst * ratios[1, 0]
        over = ratios[:, 1:] - jnp.asarray([list(self.limits.values())], ratios.dtype)
        excess = jnp.max(over, initial=-1.0)
        cost = goal + self.penalty * jnp.sum(jnp.maximum(over, 0))
        return Score(cost=cost, goal=goal, excess=excess, latched=jnp.sum(~ok))
