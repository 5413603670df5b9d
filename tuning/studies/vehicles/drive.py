"""The sampled controller at the wheel of a vehicle that is not ours: MuJoCo's robot, CommonRoad's car.

A world has `reset(position, velocity, heading)`, which places its reference point, `measure() -> Measurement`, and
`apply(delivered, period)`, which holds what the actuators deliver for a while.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import agvjax
from agvjax.engine import loop
from agvjax.paths.heading import reference


class Drive(NamedTuple):
    """What was seen at every control instant, N + 1 of them; as much of a trajectory as there is."""

    t: np.ndarray  # (N+1,), s
    position: np.ndarray  # (N+1, 2), m
    heading: np.ndarray  # (N+1,), rad
    reference_position: np.ndarray  # (N+1, 2), m
    command: np.ndarray  # (N+1, 2), m/s^2
    inputs: np.ndarray  # (N+1, m)
    delivered: np.ndarray  # (N+1, m)
    limited: np.ndarray  # (N+1,)

    @property
    def error(self) -> np.ndarray:
        """Distance of the reference point from where it should be (N+1,) [m]."""
        return np.linalg.norm(self.position - self.reference_position, axis=1)


def drive(
    world: Any, law: agvjax.Sampled, scenario: agvjax.Scenario, horizon: float, watch: Callable[[], Any] | None = None
) -> Drive | tuple[Drive, list[Any]]:
    """Let the law drive a world along the scenario's path, from its start, through its sensor and its actuators.

    Args:
        world: what moves; the scenario's own plant is not used but for the names of its actuators.
        law: sampled; its period is the world's.
        scenario: path, start, sensor, deadzones and actuators, these without continuous states.
        horizon: s.
        watch: called at every instant; what it returns is returned as a list too.
    """
    period = float(law.period)
    start, names = scenario.start, scenario.plant.actuators
    world.reset(np.asarray(start.position), np.asarray(start.velocity), float(start.heading))
    carry, rows, seen = _first(law, scenario, world.measure()), [], []
    for k in range(round(horizon / period) + 1):
        now = world.measure()
        carry, row = _period(law, scenario, carry, now, jnp.asarray(k * period))
        rows.append(jax.device_get((k * period, now.position, now.heading, *row)))
        seen.append(watch() if watch else None)
        world.apply(dict(zip(names, map(float, rows[-1][-2]), strict=True)), period)
    driven = Drive(*(np.array(column) for column in zip(*rows, strict=True)))
    return (driven, seen) if watch else driven


def _first(law: agvjax.Sampled, scenario: agvjax.Scenario, measurement: agvjax.Measurement) -> Any:
    ref, sensor = reference(scenario.path, scenario.heading, jnp.zeros(())), loop.sensor(scenario)
    sensed = sensor.hold(measurement)
    computed = law.hold(sensor(sensed, measurement), ref)
    inputs = computed.command.inputs
    memories = {n: loop.actuator(scenario, n).hold(inputs[n]) for n in scenario.plant.actuators}
    return computed, sensed, memories


@jax.jit
def _period(law: agvjax.Sampled, scenario: agvjax.Scenario, carry: Any, true: Any, t: Any) -> tuple[Any, Any]:
    """What happens at one instant: sensor, law, actuators."""
    computed, sensed, memories = carry
    ref, sensor, h = reference(scenario.path, scenario.heading, t), loop.sensor(scenario), jnp.asarray(law.period)
    sensed = sensor.jump(sensed, true, h)
    computed = law.jump((), computed, sensor(sensed, true), ref, h)
    inputs, delivered, later, limited = computed.command.inputs, [], {}, [computed.limited]
    for name in scenario.plant.actuators:
        part, u = loop.actuator(scenario, name), inputs[name]
        flow = part.init(u)
        if jax.tree.leaves(flow):
            raise ValueError(f"{name}: an actuator with a continuous state cannot be driven from outside")
        later[name] = part.jump(flow, memories[name], u, h)
        delivered.append(part.deliver(flow, later[name], u)[0])
        limited.append(part.limited(flow, later[name], u))
    asked = jnp.stack([inputs[name] for name in scenario.plant.actuators])
    row = ref.position, computed.command.position, asked, jnp.stack(delivered), jnp.any(jnp.stack(limited))
    return (computed, sensed, later), row
