"""The closed loop at one instant: measurement, law, actuators, plant; and the jumps of whatever has memory.

Everything here is pure and written for one vehicle. Besides its continuous state a controller, an actuator, a sensor
or a plant may keep memory that changes only at control instants: it then has `hold(...)`, its first value, and
`jump(...)`, its next one. A component without them costs nothing.

* sensor: `sensor(held, measurement) -> measurement`, `hold(measurement)`, `jump(held, measurement, h)`
* controller: see `agvjax.controllers`
* actuator: a callable `u -> delivered`, or, with state or memory, `init(u) -> flow`,
  `deliver(flow, held, u) -> (delivered, flow derivative)`, `hold(u)`, `jump(flow, held, u, h)`
* plant: `hold(state)`, `jump(state, held, delivered, h)`, the memory being handed to its `derivative`
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ._pytree import pytree
from .path import Reference
from .plant import Command


@pytree
class Flow:
    """What the integrator integrates."""

    plant: Any
    actuators: dict[str, Any]
    controller: Any


@pytree
class Held:
    """What changes only at control instants; `()` for a component without memory."""

    plant: Any
    actuators: dict[str, Any]
    controller: Any
    sensor: Any


@pytree
class Signals:
    """What acts from outside at one instant."""

    time: Float[Array, ""]  # s
    reference: Reference
    disturbance: Float[Array, "3"]  # m/s^2, m/s^2, rad/s


@pytree
class Sample:
    """What one looks at, at one instant."""

    time: Float[Array, ""]  # s
    position: Float[Array, "2"]  # m
    velocity: Float[Array, "2"]  # m/s
    heading: Float[Array, ""]  # rad
    reference_position: Float[Array, "2"]  # m
    reference_heading: Float[Array, ""]  # rad
    command: Float[Array, "3"]  # u_x, u_y [m/s^2], omega_bar [rad/s], before the actuators
    delivered: Float[Array, " m"]  # what the plant's m actuators delivered, in the plant's order
    controller: Any  # continuous state of the law


def _hold(component: Any, *inputs: Any) -> Any:
    return component.hold(*inputs) if hasattr(component, "hold") else ()


def _jump(component: Any, held: Any, *inputs: Any) -> Any:
    return component.jump(*inputs) if hasattr(component, "jump") else held


def _actuate(scenario: Any, flow: Any, held: Any, inputs: dict[str, Array]) -> tuple[dict[str, Array], dict[str, Any]]:
    """What each actuator delivers of its input, and the derivative of its state."""
    delivered, rates = {}, {}
    for name, u in inputs.items():
        actuator = scenario.deadzone[name]
        if hasattr(actuator, "deliver"):
            delivered[name], rates[name] = actuator.deliver(flow[name], held[name], u)
        else:
            delivered[name], rates[name] = actuator(u), ()
    return delivered, rates


def _respond(controller: Any, scenario: Any, flow: Flow, held: Held, signals: Signals) -> Any:
    """Measurement, command, inputs, what is delivered, and the derivatives of actuators and law, at one instant.

    Where the plant's output depends on what it delivers, the loop is closed by a second pass: the first gives the
    heading command, which needs no yaw rate, the second everything. The compiler merges what both have in common.
    """
    plant = scenario.plant

    def once(delivered: dict[str, Any]) -> Any:
        measurement = plant.output(flow.plant, delivered)
        if scenario.sensor is not None:
            measurement = scenario.sensor(held.sensor, measurement)
        command, law_rate = controller.law(flow.controller, held.controller, measurement, signals.reference)
        inputs = plant.allocate(command, flow.plant)
        delivered, actuator_rates = _actuate(scenario, flow.actuators, held.actuators, inputs)
        return measurement, command, inputs, delivered, actuator_rates, law_rate

    response = once({name: jnp.zeros_like(signals.time) for name in plant.actuators})
    return once(response[3]) if plant.feedthrough else response


def inside(scenario: Any, state: Any) -> Bool[Array, ""]:
    """Whether a plant's state is within the scenario's limit; False for NaN too.

    The vehicle alone is watched: whatever in the law diverges and matters drives it out.
    """
    return sum((jnp.sum(leaf**2) for leaf in jax.tree.leaves(state)), start=0.0) < scenario.limit**2


def start(controller: Any, scenario: Any, signals: Signals) -> tuple[Flow, Held, Bool[Array, ""]]:
    """Continuous state and memory of a run that begins now, and whether it begins within the limit.

    A run that does not is latched at zero: a NaN let in here would reach every reverse-mode gradient of its batch.
    """
    plant, state = scenario.plant, scenario.plant.start(scenario.start)
    ok = inside(scenario, state)
    state = jax.tree.map(lambda x: jnp.where(ok, x, 0.0), state)
    measurement = plant.output(state, {name: jnp.zeros_like(state.heading) for name in plant.actuators})
    sensed = _hold(scenario.sensor, measurement)
    if scenario.sensor is not None:
        measurement = scenario.sensor(sensed, measurement)
    law = controller.init(measurement, signals.reference)
    memory = _hold(controller, measurement, signals.reference)
    command, _ = controller.law(law, memory, measurement, signals.reference)
    inputs = plant.allocate(command, state)
    actuators = {name: scenario.deadzone[name] for name in plant.actuators}
    flows = {name: a.init(inputs[name]) if hasattr(a, "init") else () for name, a in actuators.items()}
    memories = {name: _hold(a, inputs[name]) for name, a in actuators.items()}
    flow = Flow(plant=state, actuators=flows, controller=law)
    return flow, Held(plant=_hold(plant, state), actuators=memories, controller=memory, sensor=sensed), ok


def jump(controller: Any, scenario: Any, flow: Flow, held: Held, signals: Signals, h: Float[Array, ""]) -> Held:
    """The memory after a control instant, in the order in which the signal runs; `h` [s] since the last one."""
    plant = scenario.plant
    _, _, _, delivered, _, _ = _respond(controller, scenario, flow, held, signals)
    true = plant.output(flow.plant, delivered)
    sensed = _jump(scenario.sensor, held.sensor, held.sensor, true, h)
    measurement = true if scenario.sensor is None else scenario.sensor(sensed, true)
    law = _jump(controller, held.controller, flow.controller, held.controller, measurement, signals.reference, h)
    held = Held(plant=held.plant, actuators=held.actuators, controller=law, sensor=sensed)
    _, _, inputs, _, _, _ = _respond(controller, scenario, flow, held, signals)
    actuators = {}
    for name, memory in held.actuators.items():
        actuators[name] = _jump(scenario.deadzone[name], memory, flow.actuators[name], memory, inputs[name], h)
    held = Held(plant=held.plant, actuators=actuators, controller=law, sensor=sensed)
    _, _, _, delivered, _, _ = _respond(controller, scenario, flow, held, signals)
    state = _jump(plant, held.plant, flow.plant, held.plant, delivered, h)
    return Held(plant=state, actuators=actuators, controller=law, sensor=sensed)


def derivative(controller: Any, scenario: Any, flow: Flow, held: Held, signals: Signals) -> tuple[Flow, Sample]:
    """Eq. (6) under the law: the derivative of the whole continuous state, and what one sees at this instant."""
    _, command, _, delivered, actuator_rates, law_rate = _respond(controller, scenario, flow, held, signals)
    plant_rate = scenario.plant.derivative(flow.plant, held.plant, delivered, signals.disturbance)
    seen = scenario.plant.output(flow.plant, delivered)
    sample = Sample(
        time=signals.time,
        position=seen.position,
        velocity=seen.velocity,
        heading=seen.heading,
        reference_position=signals.reference.position,
        reference_heading=signals.reference.heading,
        command=as_vector(command),
        delivered=jnp.concatenate([jnp.ravel(delivered[name]) for name in scenario.plant.actuators]),
        controller=flow.controller,
    )
    return Flow(plant=plant_rate, actuators=actuator_rates, controller=law_rate), sample


def as_vector(command: Command) -> Float[Array, "3"]:
    """u_x, u_y, omega_bar."""
    return jnp.concatenate([command.position, command.heading[None]])
