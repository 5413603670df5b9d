"""A vehicle by itself: the simulator's own step of it, as a program of numbers, with its deadzones and disturbance."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Primitive
from jaxtyping import Array, Bool, Float, PyTree

from agvjax import Delay, Law, Scenario, Tangent
from agvjax._pytree import pytree
from agvjax.actuators.chain import Chain
from agvjax.actuators.elements import DelayMemory
from agvjax.engine import loop
from agvjax.engine.rollout import Carry, Meter, Rollout
from agvjax.leaves import replace
from agvjax.messages import Command, Measurement, Reference
from agvjax.protocols import Element, Inputs, Path

from ...config import mapped
from ...config.settings import Config
from ...io.files import Json
from .. import program
from ..program import Program

FOREVER = 2**53  # steps, which doubles count
ROUNDING = 1e-6  # of a step, by which ages may be off
uniform_p = Primitive("agvjax_uniform")  # seed, count -> as `agvjax.hashed.uniform`, of numbers that are real here
uniform_p.def_abstract_eval(lambda seed, count: count.update(weak_type=False))


@pytree
class Nowhere(Path):
    """The path of a vehicle that does not know its path."""

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "2"]:
        """The origin."""
        return jnp.zeros(2, t.dtype)


@pytree
class Held(Law):
    """Commands that come from outside, held."""

    inputs: Inputs

    def init(self, measurement: Measurement, reference: Reference) -> tuple[()]:
        """Nothing flows."""
        return ()

    def hold(self, measurement: Measurement, reference: Reference) -> Inputs:
        """What is asked for."""
        return self.inputs

    def law(
        self, flow: tuple[()], memory: Inputs, measurement: Measurement, reference: Reference
    ) -> tuple[Command, tuple[()]]:
        """What is asked for."""
        return Command(position=jnp.zeros(2), heading=jnp.zeros(()), inputs=memory), ()


@pytree
class Counted(Delay):
    """A delay whose jitter is an operation of the exported code."""

    def lateness(self, count: Float[Array, ""]) -> Float[Array, ""]:
        """By how much [s] the command of this number comes later."""
        return self.jitter * uniform_p.bind(jnp.asarray(self.seed, count.dtype), count)


def scenario_of(config: Config) -> Scenario:
    """The scenario on its map, without what is not the vehicle's: no path, no sensor, no limit."""
    scenario = mapped.start(config.scenario, 1.0)
    parts = {name: _counted(part) for name, part in scenario.actuators.items()}
    return dataclasses.replace(scenario, actuators=parts, path=Nowhere(), heading=Tangent(), sensor=None, limit=np.inf)


def _counted(element: Element) -> Element:
    if isinstance(element, Chain):
        return Chain(**{name: _counted(part) for name, part in element.items()})
    return Counted(**vars(element)) if type(element) is Delay else element


def programs(config: Config, scenario: Scenario, values: dict[str, np.ndarray]) -> tuple[Program, Program]:
    """How the vehicle starts, and one step: those of the simulator's rollout."""
    timing = dataclasses.replace(config.timing(), n_steps=FOREVER, control_every=1)

    def rollout(parameters: Json, command: Inputs) -> Rollout:
        scene = replace(scenario, parameters)
        return Rollout(Held(inputs=command), scene, timing=timing, dtype=jnp.float64, meter=Meter())

    def seen(run: Rollout, carry: Carry, at: Array) -> Json:
        row = run.row(at)
        signals = run.signals(row.t[0], jax.tree.map(lambda x: x[0], row.signals))
        response = loop.respond(run.controller, run.scenario, carry.flow, carry.memory, signals)
        memory = dataclasses.replace(carry.memory, controller=())
        lost = _lost(run.scenario, memory.actuators, run.dt)
        return {
            "state": {"flow": carry.flow, "memory": memory},
            "measurement": response.measurement,
            "delivered": response.delivered,
            "flags": {"sound": carry.ok, "lost": lost},
        }

    def start(parameters: Json, command: Inputs) -> Json:
        run = rollout(parameters, command)
        return seen(run, run.begin(), jnp.zeros(()))

    def step(parameters: Json, state: Json, command: Inputs, instant: Json) -> Json:
        run = rollout(parameters, command)
        memory = dataclasses.replace(state["memory"], controller=command)
        before = Carry(flow=state["flow"], memory=memory, ok=jnp.asarray(True), meter=())
        return seen(run, run.step(before, run.row(instant["number"]))[0], instant["number"])

    command = _nothing(scenario)
    begun = jax.eval_shape(start, values, command)["state"]
    state = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), begun)
    begin = {"parameters": values, "command": command}
    arguments = {"parameters": values, "state": state, "command": command, "instant": {"number": jnp.zeros(())}}
    return program.program_of(start, begin), program.program_of(step, arguments)


def _nothing(scenario: Scenario) -> Inputs:
    """Commands of 0."""

    def asked() -> Inputs:
        zero, pair = jnp.zeros(()), jnp.zeros(2)
        plant = scenario.plant
        nothing = plant.output(plant.start(scenario.start), dict.fromkeys(plant.actuators, zero))
        return plant.allocate(Command(position=pair, heading=zero, twist=pair), nothing)

    return {name: jnp.zeros(x.shape) for name, x in jax.eval_shape(asked).items()}


def _lost(scenario: Scenario, memories: dict[str, PyTree], h: Array) -> Bool[Array, ""]:
    """Whether a delay has pushed a command out of its line, within the step just taken, before that arrived."""

    def of(element: Element, memory: PyTree) -> list[Array]:
        if isinstance(element, Chain):
            return [flag for name, part in element.items() for flag in of(part, memory[name])]
        if isinstance(element, Delay) and isinstance(memory, DelayMemory):
            return [memory.ages[-1] - h < element.time + memory.late[-1] - ROUNDING * h]
        return []

    lost = jnp.asarray(False)
    for name, memory in memories.items():
        for flag in of(loop.actuator(scenario, name), memory):
            lost = lost | flag
    return lost
