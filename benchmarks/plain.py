"""The same loop as one writes it first: a scan over the steps of one vehicle, everything computed where it is used."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from agvjax.engine import loop
from agvjax.leaves import cast
from agvjax.metrics import tracking_error
from agvjax.paths.heading import reference


def plain(controller: Any, scenario: Any, *, dt: float, steps: int) -> Any:
    """What one writes first: a scan over the steps of one vehicle, everything computed where it is used."""
    dtype = jnp.result_type(float)
    controller, scenario, h = cast(controller, dtype), cast(scenario, dtype), jnp.asarray(dt, dtype)

    def rate(flow: Any, t: Any) -> tuple[Any, Any]:
        ref = reference(scenario.path, scenario.heading, t)
        return loop.derivative(
            controller, scenario, flow, held, loop.Signals(time=t, reference=ref, disturbance=scenario.disturbance(t))
        )

    def step(carry: Any, k: Any) -> tuple[Any, None]:
        flow, total = carry
        t = k * h
        k1, sample = rate(flow, t)
        k2, _ = rate(jax.tree.map(lambda x, d: x + h / 2 * d, flow, k1), t + h / 2)
        k3, _ = rate(jax.tree.map(lambda x, d: x + h / 2 * d, flow, k2), t + h / 2)
        k4, _ = rate(jax.tree.map(lambda x, d: x + h * d, flow, k3), t + h)
        flow = jax.tree.map(lambda x, a, b, c, d: x + h / 6 * (a + 2 * b + 2 * c + d), flow, k1, k2, k3, k4)
        return (flow, total + jnp.sum(tracking_error(sample) ** 2)), None

    zero = jnp.zeros((), dtype)
    first = loop.Signals(
        time=zero, reference=reference(scenario.path, scenario.heading, zero), disturbance=scenario.disturbance(zero)
    )
    flow, held, _ = loop.start(controller, scenario, first)
    ends = jnp.sum(tracking_error(rate(flow, zero)[1]) ** 2)
    (flow, total), _ = jax.lax.scan(step, (flow, zero), jnp.arange(steps, dtype=dtype))
    ends += -jnp.sum(tracking_error(rate(flow, steps * h)[1]) ** 2)  # the trapezoid: half of either end
    return jnp.sqrt((total - ends / 2) / steps)
