"""The closed loop at one instant: measurement, law, actuators, plant; and the jumps of whatever has memory.

Everything here is pure and written for one vehicle; what each part may have is said in `agvjax.protocols`.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float, PyTree

from .._pytree import pytree
from ..actuators.chain import Chain
from ..geometry import wrap
from ..leaves import children
from ..messages import Command, Measurement, Reference
from ..paths.place import Place
from ..paths.route import Route
from ..protocols import Element, Inputs, Law, Plant, Sensor
from ..scenario import Scenario
from ..schedule import scheduled
from .beside import Beside

RESOLUTION = 1e-3  # m and rad, to which a run must know positions and headings


def farthest(dtype: DTypeLike) -> float:
    """How far [m, rad] from 0 numbers of this kind still resolve places and headings: 8 km, 1300 turns in float32."""
    return RESOLUTION / float(jnp.finfo(dtype).eps)


@pytree
class Flow:
    """What the integrator integrates."""

    plant: PyTree
    actuators: dict[str, PyTree]
    controller: PyTree


@pytree
class Memory:
    """What jumps; `()` for a component without memory."""

    plant: PyTree
    actuators: dict[str, PyTree]
    controller: PyTree
    sensor: PyTree
    route: Place | tuple[()] = ()  # where the vehicle is on one, looked at anew at control instants


@pytree
class Signals:
    """What acts from outside at one instant."""

    time: Float[Array, ""]  # s
    reference: Reference
    disturbance: Float[Array, "3"]  # m/s^2, m/s^2, rad/s


@pytree
class Sample:
    """What is seen at one instant, or with a leading N + 1 at as many; m is the plant's number of actuators."""

    t: Float[Array, "*N"]  # s
    position: Float[Array, "*N 2"]  # m, reference point (x_n, y_n)
    velocity: Float[Array, "*N 2"]  # m/s
    heading: Float[Array, "*N"]  # rad
    reference_position: Float[Array, "*N 2"]  # m
    reference_heading: Float[Array, "*N"]  # rad
    command: Float[Array, "*N c"]  # u_x, u_y [m/s^2], and omega_bar [rad/s] where the plant's heading is commanded
    inputs: Float[Array, "*N m"]  # what the actuators were asked for, in the plant's order
    delivered: Float[Array, "*N m"]  # what they delivered
    limited: Bool[Array, "*N"]  # whether an actuator, or the controller's own limit, was at its limit
    controller: PyTree = ()  # state of the law
    route: Beside | None = None  # where the path is a route


@pytree
class Trajectory(Sample):
    """N + 1 samples of one run, N = n_steps / save_every."""

    weight_norm: Float[Array, "N+1 2"] | None = None  # position and heading, where the law adapts one
    ok: Bool[Array, ""]  # False: the state exceeded `scenario.limit` and was frozen

    def samples(self) -> Sample:
        """The recorded signals, each array with a leading N + 1."""
        return Sample(**{f.name: getattr(self, f.name) for f in dataclasses.fields(Sample)})


def actuator(scenario: Scenario, name: str) -> Element:
    """The deadzone of an actuator, and what the signal runs through after it."""
    first, rest = scenario.deadzone[name], scenario.actuators.get(name)
    return first if rest is None else Chain(deadzone=first, rest=rest)


def sensor(scenario: Scenario) -> Sensor:
    """The scenario's sensor; without one the controller is told the truth."""
    return Sensor() if scenario.sensor is None else scenario.sensor


def _actuate(
    scenario: Scenario, flow: dict[str, PyTree], memory: dict[str, PyTree], inputs: Inputs
) -> tuple[Inputs, dict[str, PyTree]]:
    """What each actuator delivers of its input, and the derivative of its state."""
    delivered, rates = {}, {}
    for name, u in inputs.items():
        delivered[name], rates[name] = actuator(scenario, name).deliver(flow[name], memory[name], u)
    return delivered, rates


def _limited(controller: Law, scenario: Scenario, flow: Flow, memory: Memory, inputs: Inputs) -> Bool[Array, ""]:
    """Whether an actuator, or the controller's own limit, is at its limit."""
    limited = [jnp.zeros((), bool), controller.limited(memory.controller)]
    for name, u in inputs.items():
        limited.append(actuator(scenario, name).limited(flow.actuators[name], memory.actuators[name], u))
    return jnp.any(jnp.stack(limited))


class Response(NamedTuple):
    """How the loop answers at one instant."""

    measurement: Measurement
    command: Command
    inputs: Inputs
    delivered: Inputs
    actuator_rates: dict[str, PyTree]
    law_rate: PyTree


def _allocate(plant: Plant, command: Command, measurement: Measurement) -> Inputs:
    return plant.allocate(command, measurement) if command.inputs is None else command.inputs


def respond(controller: Law, scenario: Scenario, flow: Flow, memory: Memory, signals: Signals) -> Response:
    """What is measured, commanded and delivered at one instant.

    Where the plant's output depends on what it delivers, the loop is closed by a second pass: the first gives the
    heading command, which needs no yaw rate, the second everything. The compiler merges what both have in common.
    """
    plant, look = scenario.plant, sensor(scenario)

    def once(delivered: Inputs) -> Response:
        measurement = look(memory.sensor, plant.output(flow.plant, delivered))
        command, law_rate = scheduled(controller, measurement).law(
            flow.controller, memory.controller, measurement, signals.reference
        )
        inputs = _allocate(plant, command, measurement)
        delivered, actuator_rates = _actuate(scenario, flow.actuators, memory.actuators, inputs)
        return Response(measurement, command, inputs, delivered, actuator_rates, law_rate)

    response = once({name: jnp.zeros_like(signals.time) for name in plant.actuators})
    return once(response.delivered) if plant.feedthrough else response


def inside(scenario: Scenario, state: PyTree, near: Float[Array, "2"]) -> Bool[Array, ""]:
    """Whether a plant's state is within the scenario's limit; False for NaN too.

    The vehicle alone is watched: whatever in the law diverges and matters drives it out. A `position` counts from
    `near` [m], where the path is, or of a route its nearest point; a `heading` without its whole turns: neither a map's
    origin nor the number of laps matters. Yet both must be ones that the numbers resolve, see `RESOLUTION`: a vehicle
    would stand still or leap.
    """
    parts, resolved = dict(children(state)), jnp.array(True)
    if "position" in parts:
        resolved = jnp.max(jnp.abs(parts["position"])) < farthest(parts["position"].dtype)
        parts["position"] = parts["position"] - near
    if "heading" in parts:
        resolved &= jnp.abs(parts["heading"]) < farthest(parts["heading"].dtype)
        parts["heading"] = wrap(parts["heading"])
    square = sum((jnp.sum(leaf**2) for leaf in jax.tree.leaves(parts)), start=0.0)
    return resolved & (square < scenario.limit**2)


def start(controller: Law, scenario: Scenario, signals: Signals) -> tuple[Flow, Memory, Bool[Array, ""]]:
    """Continuous state and memory of a run that begins now, and whether it begins within the limit.

    A run that does not is frozen at zero: a NaN let in here would reach every reverse-mode gradient of its batch.
    """
    plant, state = scenario.plant, scenario.plant.start(scenario.start)
    near, route = signals.reference.position, ()
    if isinstance(scenario.path, Route):
        route = scenario.path.search(state.position, state.heading)
        near = route.position
    ok = inside(scenario, state, near)
    state = jax.tree.map(lambda x: jnp.where(ok, x, 0.0), state)
    measurement = plant.output(state, {name: jnp.zeros_like(state.heading) for name in plant.actuators})
    sensed = sensor(scenario).hold(measurement)
    measurement = sensor(scenario)(sensed, measurement)
    controller = scheduled(controller, measurement)
    law, memory = controller.init(measurement, signals.reference), controller.hold(measurement, signals.reference)
    command, _ = controller.law(law, memory, measurement, signals.reference)
    inputs = _allocate(plant, command, measurement)
    parts = {name: actuator(scenario, name) for name in plant.actuators}
    flows = {name: part.init(inputs[name]) for name, part in parts.items()}
    memories = {name: part.hold(inputs[name]) for name, part in parts.items()}
    flow = Flow(plant=state, actuators=flows, controller=law)
    memory = Memory(plant=plant.hold(state), actuators=memories, controller=memory, sensor=sensed, route=route)
    return flow, memory, ok


def jump(
    controller: Law, scenario: Scenario, flow: Flow, memory: Memory, signals: Signals, h: Float[Array, ""]
) -> Memory:
    """The memory of sensor and controller after a control instant, `h` [s] after the last one; and the route's foot."""
    delivered = respond(controller, scenario, flow, memory, signals).delivered
    true = scenario.plant.output(flow.plant, delivered)
    if isinstance(scenario.path, Route) and isinstance(memory.route, Place):
        place = scenario.path.follow(true.position, memory.route, true.velocity, h, waits=False)
        memory = dataclasses.replace(memory, route=place)
    sensed = sensor(scenario).jump(memory.sensor, true, h)
    measurement = sensor(scenario)(sensed, true)
    law = scheduled(controller, measurement).jump(flow.controller, memory.controller, measurement, signals.reference, h)
    return dataclasses.replace(memory, controller=law, sensor=sensed)


def advance(
    controller: Law, scenario: Scenario, flow: Flow, memory: Memory, signals: Signals, h: Float[Array, ""]
) -> Memory:
    """The memory of actuators and plant for the step that begins, `h` [s] long."""
    inputs = respond(controller, scenario, flow, memory, signals).inputs
    actuators = {
        name: actuator(scenario, name).jump(flow.actuators[name], before, inputs[name], h)
        for name, before in memory.actuators.items()
    }
    memory = dataclasses.replace(memory, actuators=actuators)
    delivered = respond(controller, scenario, flow, memory, signals).delivered
    return dataclasses.replace(memory, plant=scenario.plant.jump(flow.plant, memory.plant, delivered, h))


def derivative(
    controller: Law, scenario: Scenario, flow: Flow, memory: Memory, signals: Signals
) -> tuple[Flow, Sample]:
    """Eq. (6) under the law: the derivative of the whole continuous state, and what one sees at this instant."""
    response, plant = respond(controller, scenario, flow, memory, signals), scenario.plant
    plant_rate = plant.derivative(flow.plant, memory.plant, response.delivered, signals.disturbance)
    seen = plant.output(flow.plant, response.delivered)
    beside, path = None, scenario.path
    if isinstance(memory.route, Place) and isinstance(path, Route):
        beside = Beside.of(path, memory.route, seen, signals.reference.arc)
    asked, heading = signals.reference.position, signals.reference.heading
    if beside is not None and controller.follows():
        asked, heading = beside.position, seen.heading - beside.heading_error
    sample = Sample(
        t=signals.time,
        position=seen.position,
        velocity=seen.velocity,
        heading=seen.heading,
        reference_position=asked,
        reference_heading=heading,
        command=as_vector(response.command, plant.commands_heading),
        inputs=jnp.concatenate([jnp.ravel(response.inputs[name]) for name in plant.actuators]),
        delivered=jnp.concatenate([jnp.ravel(response.delivered[name]) for name in plant.actuators]),
        limited=_limited(controller, scenario, flow, memory, response.inputs),
        controller=controller.state(flow.controller, memory.controller),
        route=beside,
    )
    return Flow(plant=plant_rate, actuators=response.actuator_rates, controller=response.law_rate), sample


def as_vector(command: Command, heading: bool) -> Float[Array, " c"]:
    """u_x, u_y and, where the heading is commanded, omega_bar; of a law that drives a base speed and yaw rate."""
    if command.twist is not None:
        return command.twist
    return jnp.concatenate([command.position, command.heading[None]]) if heading else command.position
