"""The metrics by name: what each is of a run, and its unit."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import jax
import jax.numpy as jnp
from jaxtyping import Array

from .metrics import Criteria, Metrics
from .protocols import Plant

AXES = ("x", "y", "heading")


def _sloped(true: Array, smooth: Array | None) -> Array:
    """The true value with the slope of its smooth stand-in, where there is one."""
    if smooth is None:
        return true
    fine = jnp.isfinite(true) & jnp.isfinite(smooth)
    return smooth + jax.lax.stop_gradient(jnp.where(fine, true, 0.0) - jnp.where(fine, smooth, 0.0))


def _settling(m: Metrics) -> Array:
    return _sloped(m.settling_time, m.settling_smooth)


def _by_axis(name: str, of: Callable[[Metrics], Array]) -> dict[str, Callable[[Metrics], Array]]:
    return {f"{name}_{axis}": lambda m, i=i: of(m)[..., i] for i, axis in enumerate(AXES)}


METRICS: dict[str, Callable[[Metrics], Array]] = {
    "rmse": lambda m: m.total_rmse,
    "effort": lambda m: m.effort,
    "peak_position": lambda m: m.peak_position,
    "peak_heading": lambda m: m.peak_heading,
    "chatter": lambda m: m.total_chatter,
    "settling_time": lambda m: jnp.max(_settling(m), -1),
    "iae": lambda m: jnp.sum(m.iae, -1),
    "ise": lambda m: jnp.sum(m.ise, -1),
    "itae": lambda m: jnp.sum(m.itae, -1),
    **_by_axis("rmse", lambda m: m.rmse),
    **_by_axis("rmse_late", lambda m: m.rmse_late),
    **_by_axis("overshoot", lambda m: m.overshoot),
    **_by_axis("settling_time", _settling),
    **_by_axis("effort", lambda m: m.rms_command),
    **{f"peak_{axis}": lambda m, i=i: m.peak_command[..., i] for i, axis in enumerate(AXES[:2])},
    **_by_axis("chatter", lambda m: m.chatter),
    "delivered_effort": lambda m: m.delivered_effort,
    "delivered_peak": lambda m: jnp.max(jnp.asarray(m.peak_delivered), -1),
    "delivered_variation": lambda m: jnp.sum(jnp.asarray(m.variation_delivered), -1),
    "limited": lambda m: jnp.asarray(m.limited),
}


OF_HEADING = frozenset(name for name in METRICS if name.endswith("_heading"))


OF_DELIVERED = frozenset(("delivered_effort", "delivered_peak", "delivered_variation", "limited"))


_UNITS = {"rmse": "m, rad", "effort": "mixed", "chatter": "mixed", "iae": "mixed", "ise": "mixed", "itae": "mixed"}


_UNITS |= {name: "of the actuators" for name in OF_DELIVERED} | {"limited": "share of the time"}


_UNITS |= {"peak_position": "m/s^2", "peak_heading": "rad/s", "settling_time": "s"}


def metrics_of(plant: Plant) -> tuple[str, ...]:
    """The metrics that there are for a plant: none of the heading where that cannot be commanded."""
    heading = plant.commands_heading
    return tuple(name for name in METRICS if heading or name not in OF_HEADING)


def criteria(names: Iterable[str], sloped: bool = False) -> Criteria:
    """How runs must be judged to have these metrics, and if so asked slopes of all of them."""
    names = tuple(names)
    smooth = sloped and any(name.startswith("settling") for name in names)
    return Criteria(smooth=smooth, delivered=not OF_DELIVERED.isdisjoint(names))


def unit(metric: str) -> str:
    """Unit of a metric, for tables."""
    if metric in _UNITS:
        return _UNITS[metric]
    kind, _, axis = metric.rpartition("_")
    if kind == "settling_time":
        return "s"
    turns = axis == "heading"
    return ("rad" if turns else "m") if kind in ("rmse", "rmse_late", "overshoot") else ("rad/s" if turns else "m/s^2")
