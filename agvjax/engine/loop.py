"""The closed loop at one instant: measurement, law, actuators, plant; and the jumps of whatever has memory.

Everything here is pure and written for one vehicle. Besides its continuous state a component may keep memory that
jumps: a sensor or a controller at control instants, an actuator or a plant at the start of every step. It then has
`hold(...)`, its first value, and `jump(...)`, its next one. A component without them costs nothing.

* sensor: `sensor(held, measurement) -> measurement`, `hold(measurement)`, `jump(held, measurement, h)`
* controller: see `agvjax.controllers`
* actuator: see `agvjax.actuators`
* plant: `hold(state)`, `jump(state, held, delivered, h)`, the memory being handed to its `derivative`
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._pytree import pytree
from ..actuators import chain
from ..messages import Command, Reference


@pytree
class Flow:
    """What the integrator integrates."""

    plant: Any
    actuators: dict[str, Any]
    controller: Any


@pytree
class Held:
    """What jumps; `()` for a component without memory."""

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
    command: Float[Array, " c"]  # u_x, u_y [m/s^2], and omega_bar [rad/s] where the plant lets its heading be commanded
    inputs: Float[Array, " m"]  # what the m actuators were asked for, in the plant's order
    delivered: Float[Array, " m"]  # what they delivered
    limited: Bool[Array, ""]  # whether an actuator, or the controller's own limit, was at its limit
    controller: Any  # state of the law


def _hold(component: Any, *inputs: Any) -> Any:
    return component.hold(*inputs) if hasattr(component, "hold") else ()


def _jump(component: Any, held: Any, *inputs: Any) -> Any:
    return component.jump(*inputs) if hasattr(component, "jump") else held


def actuator(scenario: Any, name: str) -> Any:
    """The deadzone of an actuator, and what the signal runs through after it."""
    first, rest = scenario.deadzone[name], scenario.actuators.get(name)
    return first if rest is None else chain.Chain(deadzone=first, rest=rest)


def _actuate(scenario: Any, flow: Any, held: Any, inputs: dict[str, Array]) -> tuple[dict[str, Array], dict[str, Any]]:
    """What each actuator delivers of its input, and the derivative of its state."""
    delivered, rates = {}, {}
    for name, u in inputs.items():
        delivered[name], rates[name] = chain.deliver(actuator(scenario, name), flow[name], held[name], u)
    return delivered, rates


def _limited(controller: Any, scenario: Any, flow: Flow, held: Held, inputs: dict[str, Array]) -> Bool[Array, ""]:
    """Whether anything is at its limit."""
    found = [jnp.zeros((), bool)]
    if hasattr(controller, "limited"):
        found.append(controller.limited(held.controller))
    for name, u in inputs.items():
        found.append(chain.at_limit(actuator(scenario, name), flow.actuators[name], held.actuators[name], u))
    return jnp.any(jnp.stack(found))


def _allocate(plant: Any, command: Command, measurement: Any) -> dict[str, Array]:
    return plant.allocate(command, measurement) if command.inputs is None else command.inputs


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
        inputs = _allocate(plant, command, measurement)
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
    inputs = _allocate(plant, command, measurement)
    begun = {name: chain.begin(actuator(scenario, name), inputs[name]) for name in plant.actuators}
    flows, memories = ({name: pair[i] for name, pair in begun.items()} for i in (0, 1))
    flow = Flow(plant=state, actuators=flows, controller=law)
    return flow, Held(plant=_hold(plant, state), actuators=memories, controller=memory, sensor=sensed), ok


def jump(controller: Any, scenario: Any, flow: Flow, held: Held, signals: Signals, h: Float[Array, ""]) -> Held:
    """The memory of sensor and controller after a control instant, `h` [s] after the last one."""
    plant = scenario.plant
    _, _, _, delivered, _, _ = _respond(controller, scenario, flow, held, signals)
    true = plant.output(flow.plant, delivered)
    sensed = _jump(scenario.sensor, held.sensor, held.sensor, true, h)
    measurement = true if scenario.sensor is None else scenario.sensor(sensed, true)
    law = _jump(controller, held.controller, flow.controller, held.controller, measurement, signals.reference, h)
    return Held(plant=held.plant, actuators=held.actuators, controller=law, sensor=sensed)


def advance(controller: Any, scenario: Any, flow: Flow, held: Held, signals: Signals, h: Float[Array, ""]) -> Held:
    """The memory of actuators and plant for the step that begins, `h` [s] long."""
    plant = scenario.plant
    _, _, inputs, _, _, _ = _respond(controller, scenario, flow, held, signals)
    actuators = {}
    for name, memory in held.actuators.items():
        actuators[name] = _jump(actuator(scenario, name), memory, flow.actuators[name], memory, inputs[name], h)
    held = Held(plant=held.plant, actuators=actuators, controller=held.controller, sensor=held.sensor)
    _, _, _, delivered, _, _ = _respond(controller, scenario, flow, held, signals)
    state = _jump(plant, held.plant, flow.plant, held.plant, delivered, h)
    return Held(plant=state, actuators=actuators, controller=held.controller, sensor=held.sensor)


def derivative(controller: Any, scenario: Any, flow: Flow, held: Held, signals: Signals) -> tuple[Flow, Sample]:
    """Eq. (6) under the law: the derivative of the whole continuous state, and what one sees at this instant."""
    _, command, inputs, delivered, actuator_rates, law_rate = _respond(controller, scenario, flow, held, signals)
    plant_rate = scenario.plant.derivative(flow.plant, held.plant, delivered, signals.disturbance)
    seen = scenario.plant.output(flow.plant, delivered)
    sample = Sample(
        time=signals.time,
        position=seen.position,
        velocity=seen.velocity,
        heading=seen.heading,
        reference_position=signals.reference.position,
        reference_heading=signals.reference.heading,
        command=as_vector(command, getattr(scenario.plant, "commands_heading", True)),
        inputs=jnp.concatenate([jnp.ravel(inputs[name]) for name in scenario.plant.actuators]),
        delivered=jnp.concatenate([jnp.ravel(delivered[name]) for name in scenario.plant.actuators]),
        limited=_limited(controller, scenario, flow, held, inputs),
        controller=controller.state(flow.controller, held.controller)
        if hasattr(controller, "state")
        else flow.controller,
    )
    return Flow(plant=plant_rate, actuators=actuator_rates, controller=law_rate), sample


def as_vector(command: Command, heading: bool) -> Float[Array, " c"]:
    """u_x, u_y and, where the heading is commanded, omega_bar."""
    return jnp.concatenate([command.position, command.heading[None]]) if heading else command.position
