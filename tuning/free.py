"""Gains as unconstrained coordinates: whatever the optimiser does, every gain stays inside its bounds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import agvjax
from agvjax.leaves import get, rule_of

from .ensemble import Draw, lowest


class Free(NamedTuple):
    """The tuned gains and their open intervals; a gain without upper bound moves in the logarithm of its excess."""

    names: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray

    def coordinates(self, controller: Any) -> Float[Array, " K"]:
        """Where a controller stands. Its gains must lie strictly inside the bounds; see `problems`."""
        x = np.array([float(get(controller, name)) for name in self.names])
        open_above = np.isinf(self.upper)
        excess = x - self.lower
        room = np.where(open_above, 1.0, self.upper - x)
        return jnp.asarray(np.log(excess) - np.log(room))

    def controller(self, z: Float[Array, " K"], like: Any) -> Any:
        """The controller at z; what is not tuned is taken from `like`."""
        open_above = np.isinf(self.upper)
        span = jnp.asarray(np.where(open_above, 1.0, self.upper - self.lower), z.dtype)
        lower = jnp.asarray(self.lower, z.dtype)
        above = jnp.where(open_above, jnp.exp(jnp.where(open_above, z, 0.0)), span * jax.nn.sigmoid(z))
        return agvjax.replace(like, dict(zip(self.names, lower + above, strict=True)))

    def problems(self, controller: Any) -> list[agvjax.Problem]:
        """Gains that do not lie strictly inside their bounds."""
        found = []
        for name, low, high in zip(self.names, self.lower, self.upper, strict=True):
            value = float(get(controller, name))
            if not low < value < high:
                rule = f"> {low:.6g}" if np.isinf(high) else f"inside ({low:.6g}, {high:.6g})"
                source = "its bounds and the stability conditions (48), (52), (70) for the smallest slope drawn"
                found.append(agvjax.Problem(f"controller.{name}", value, rule, source))
        return found


def smallest_slopes(scenario: Any, draws: Mapping[str, Draw]) -> tuple[float, float]:
    """Pi_min of position and heading: the smallest slopes that occur in the ensemble."""
    sides = ("slope_right", "slope_left")
    position, heading = (
        min(lowest(scenario, draws, f"deadzone.{channel}.{side}") for side in sides)
        for channel in ("position", "heading")
    )
    return position, heading


def stability_bounds(controller: Any, scenario: Any, draws: Mapping[str, Draw]) -> dict[str, float]:
    """What the law's own stability conditions ask of its gains; empty for a law or a plant without any."""
    if not hasattr(controller, "stability_bounds") or set(scenario.deadzone) != {"position", "heading"}:
        return {}
    return controller.stability_bounds(*smallest_slopes(scenario, draws))


def default_bounds(
    controller: Any, names: tuple[str, ...], stability: Mapping[str, float], dt: float, integrator: agvjax.Integrator
) -> dict[str, tuple[float, float]]:
    """What each gain's own rule allows, the stability conditions, and what a step of `dt` can integrate of the law."""
    upper = {}
    if hasattr(controller, "upper_bounds"):
        upper = controller.upper_bounds(lambda poles: integrator.stable_step(poles) >= dt)
    bounds = {}
    for name in names:
        allowed = rule_of(controller, name)
        low, high = (0.0, np.inf) if allowed is None else (allowed.low, allowed.high)
        bounds[name] = (max(low, stability.get(name, low)), min(high, upper.get(name, high)))
    return bounds


def tunable(controller: Any) -> tuple[str, ...]:
    """The gains to tune by default: those the law names, or every single number of a law that names none."""
    if hasattr(controller, "tunable"):
        return tuple(controller.tunable)
    return tuple(name for name, value in agvjax.leaves(controller).items() if np.ndim(value) == 0)
