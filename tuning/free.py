"""Gains as unconstrained coordinates: whatever the optimiser does, every gain stays inside its bounds."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import agvjax
from agvjax.leaves import get

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


def largest_omega_n(controller: Any, dt: float, integrator: agvjax.Integrator) -> float:
    """The largest natural frequency whose filter the step still integrates stably, whatever its damping up to 1."""

    def stable(omega_n: float) -> bool:
        dampings = np.linspace(0.05, 1.0, 20)
        filters = (dataclasses.replace(controller, omega_n=omega_n, zeta=zeta) for zeta in dampings)
        return all(integrator.stable_step(f.poles()) >= dt for f in filters)

    low, high = 0.0, 10.0 / dt
    while high - low > 1e-3 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


def default_bounds(
    controller: Any, names: tuple[str, ...], stability: Mapping[str, float], dt: float, integrator: agvjax.Integrator
) -> dict[str, tuple[float, float]]:
    """Positive, within the stability conditions, damping at most 1 (after eq. (22)), the filter stable at this step."""
    bounds = {name: (stability.get(name, 0.0), np.inf) for name in names}
    if hasattr(controller, "poles"):
        limits = {"zeta": 1.0, "omega_n": largest_omega_n(controller, dt, integrator) if "omega_n" in names else np.inf}
        bounds |= {name: (0.0, limit) for name, limit in limits.items() if name in names}
    return bounds
