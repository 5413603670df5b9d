"""The vehicle as an FMU: commands in, measurement out; the simulator's own step, with its deadzones and disturbance."""

from __future__ import annotations

import dataclasses
import json

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Primitive
from jaxtyping import Array, Bool, Float, PyTree

from agvjax import Delay, Fault, InputError, Law, Scenario, Tangent
from agvjax._pytree import pytree
from agvjax.actuators.chain import Chain
from agvjax.actuators.elements import DelayMemory
from agvjax.engine import loop
from agvjax.engine.rollout import Carry, Meter, Rollout
from agvjax.leaves import leaves, replace, rule_of
from agvjax.messages import Command, Measurement, Reference
from agvjax.protocols import Element, Inputs, Path
from agvjax.scenario import unit_in
from agvjax.timing import Timing

from ...config import mapped
from ...config.settings import Config
from ...io.files import Json
from .. import c, names, program
from ..artefact import Artefact, filled
from ..c_language import assigned, computed, double, struct
from ..operations import flat
from ..program import Program
from .archive import TEMPLATES, archives
from .description import Model
from .readme import readme
from .variables import FIXED, INPUT, OUTPUT, TUNABLE, Variable, check, clock, commands, of_field, seen, switches

NAME = "agv_plant"
PARTS = ("plant", "deadzone", "actuators", "disturbance", "start")  # of a scenario, whose numbers are parameters
SEED = "seed"  # a number of these that is none to set: what hangs on it is made when it is exported
STATE = "flow.plant."  # of the names of what of the state is the vehicle's own
SEEN = ("measurement", "delivered")  # what a step gives besides the state
FOREVER = 2**53  # steps, which doubles count
ROUNDING = 1e-6  # of a step, by which ages may be off
UNIFORM = """
/* A number in [0, 1) of a seed and a count. */
static double uniform(double seed, double count)
{
    uint32_t bits = (uint32_t)count * 0x9E3779B9u + (uint32_t)seed;
    bits = (bits ^ (bits >> 16)) * 0x7FEB352Du;
    bits = (bits ^ (bits >> 15)) * 0x846CA68Bu;
    bits = bits ^ (bits >> 16);
    return (double)(bits >> 9) / 8388608.0;
}
"""
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


def files(artefact: Artefact, name: str = NAME) -> dict[str, str | bytes]:
    """NAME.fmi2.fmu, NAME.fmi3.fmu and a README.

    Raises:
        agvjax.InputError: the name is none of a C library, or the scenario is not known or has what is not exported.
        ValueError: the vehicle names a number as C or FMI cannot, or cannot be written out.
    """
    if wrong := names.faults(name):
        raise InputError(wrong)
    config = _known(artefact)
    scenario = _scenario(config)
    values = {key: np.asarray(x, float) for key, x in leaves(scenario).items() if _settable(scenario, key)}
    start, step = _programs(config, scenario, values)
    for group, fields in (*step.arguments.items(), *step.results.items()):
        names.check_members(group, [field.member for field in fields])
    variables = _variables(scenario, step, values)
    check(variables)
    sources = _sources(artefact, config, start, step, name)
    said = {"NAME": name, "UPPER": name.upper()}
    groups = (*step.arguments, *SEEN, "flags")
    starts = [v for v in variables if v.role in (FIXED, TUNABLE)]
    parts = said | switches(variables) | {
        "STEP": double(config.simulate.dt),
        "SAMPLES": "0",
        "MEMBERS": "\n".join(f"    {name}_{group} {group};" for group in groups),
        "DEFAULTS": "\n".join(f"    {v.place} = {double(float(v.start or 0.0))};" for v in starts),
        "FUNCTIONS": filled(TEMPLATES / "plant_model.c.txt", said),
    }  # fmt: skip
    sources[f"{name}_model.h"] = filled(TEMPLATES / "model.h.txt", parts)
    kind, generator = type(scenario.plant).__name__, artefact.provenance["generator"]
    about = f"{kind} with its actuators and what disturbs it, in steps of {config.simulate.dt:g} s."
    model = Model(name, about, generator, config.simulate.dt, variables, sources, [f"{name}.c"])
    return archives(model, artefact) | {"README.md": readme(model, artefact, "plant")}


def _known(artefact: Artefact) -> Config:
    if artefact.config is None:
        rule = "known: config.toml beside the gains, or --config, says what the vehicle is"
        raise InputError([Fault("scenario.plant", artefact.provenance["vehicle"], rule)])
    scenario = artefact.config.scenario
    if scenario.sensor is not None:
        rule = "none: an exported vehicle tells the truth, noise is for whoever simulates (--set scenario.sensor=\"none\")"
        raise InputError([Fault("scenario.sensor", type(scenario.sensor).__name__, rule)])
    return artefact.config


def _scenario(config: Config) -> Scenario:
    """The scenario on its map, without what a vehicle does not know: no path, no limit."""
    scenario = mapped.start(config.scenario, 1.0)
    parts = {name: _counted(part) for name, part in scenario.actuators.items()}
    return dataclasses.replace(scenario, actuators=parts, path=Nowhere(), heading=Tangent(), limit=np.inf)


def _counted(element: Element) -> Element:
    if isinstance(element, Chain):
        return Chain(**{name: _counted(part) for name, part in element.items()})
    return Counted(**vars(element)) if type(element) is Delay else element


def _settable(scenario: Scenario, name: str) -> bool:
    """Whether a leaf is a parameter of the FMU."""
    words = name.split(".")
    return words[0] in PARTS and words[-1] != SEED and rule_of(scenario, name) is not None


def _programs(config: Config, scenario: Scenario, values: dict[str, np.ndarray]) -> tuple[Program, Program]:
    """How the vehicle starts, and one step: those of the simulator's rollout."""
    timing = dataclasses.replace(config.timing(), n_steps=FOREVER)

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


def _variables(scenario: Scenario, step: Program, values: dict[str, np.ndarray]) -> list[Variable]:
    plant = scenario.plant
    found = [clock, *commands("command", step.arguments["command"], plant, INPUT)]
    found += seen("measurement", step.results["measurement"], OUTPUT, "measurement.")
    found += commands("delivered", step.results["delivered"], plant, OUTPUT, "delivered.")
    for field in step.results["state"]:
        if field.name.startswith(STATE):
            found += of_field("state", field, OUTPUT, pairs=False, called=f"state.{field.name.removeprefix(STATE)}")
    for field in step.arguments["parameters"]:
        name = field.name
        role = FIXED if name.startswith("start.") else TUNABLE
        facts = {"unit": unit_in(scenario, name), "rule": rule_of(scenario, name), "values": values[name]}
        found += of_field("parameters", field, role, pairs=False, **facts)
    return found


def _sources(artefact: Artefact, config: Config, start: Program, step: Program, name: str) -> dict[str, str]:
    """Header and source of the vehicle."""
    groups = step.arguments | {group: step.results[group] for group in SEEN}
    structs = [struct(f"{name}_{group}", fields, {}) for group, fields in groups.items()]
    structs.append(struct(f"{name}_flags", (), {}, [f"    int {f.member};" for f in step.results["flags"]]))
    made = any(operation.primitive == uniform_p.name for operation in flat([*start.operations, *step.operations]))

    def body(one: Program) -> str:
        given = [line for group in ("state", *SEEN, "flags") for line in assigned(group, one.results[group], name)]
        return "\n".join(f"    {line}" for line in (*computed(one, name), *given))

    parts = {
        "NAME": name,
        "UPPER": name.upper(),
        "PROVENANCE": c.commented(json.dumps(artefact.provenance, indent=2)),
        "STRUCTS": "\n\n".join(structs),
        "STEP": f"{config.simulate.dt:g}",
        "UNIFORM": UNIFORM if made else "",
        "START": body(start),
        "STEP_BODY": body(step),
    }
    return {f"{name}.{end}": filled(TEMPLATES / f"plant.{end}.txt", parts) for end in ("h", "c")}
