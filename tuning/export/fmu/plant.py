"""The vehicle as an FMU: commands in, measurement out; the simulator's own step, with its deadzones and disturbance."""

from __future__ import annotations

import json

import numpy as np

from agvjax import Fault, InputError, Scenario
from agvjax.leaves import leaves, rule_of
from agvjax.scenario import unit_in

from ...config import mapped
from ...config.settings import Config
from .. import names
from ..artefact import Artefact, filled
from ..c_language import assigned, commented, computed, double, struct
from ..operations import flat
from ..program import Program
from .archive import TEMPLATES, archives
from .description import Model
from .readme import readme
from .variables import FIXED, INPUT, OUTPUT, TUNABLE, Variable, cases, check, clock, commands, of_field, seen
from .vehicle import programs, scenario_of, uniform_p

NAME = "agv_plant"
PARTS = ("plant", "deadzone", "actuators", "disturbance", "start")  # of a scenario, whose numbers are parameters
SEED = "seed"  # a number of these that is none to set: what hangs on it is made when it is exported
STATE = "flow.plant."  # of the names of what of the state is the vehicle's own
SEEN = ("measurement", "delivered")  # what a step gives besides the state
UNIFORM = """
/* A number in [0, 1) of a seed and a count. */
static double uniform(double seed, double count)
{
    uint32_t bits = (uint32_t)count * 0x9E3779B9u + (uint32_t)seed;
    bits = (bits ^ (bits >> 16)) * 0x7FEB352Du;
    bits = (bits ^ (bits >> 15)) * 0x846CA68Bu;
    bits = bits ^ (bits >> 16);
    return (double)(bits >> 9) / 8388608.0;
}"""


def files(artefact: Artefact, name: str = NAME) -> dict[str, str | bytes]:
    """NAME.fmi2.fmu, NAME.fmi3.fmu and a README.

    Raises:
        agvjax.InputError: the name is none of a C library, or the scenario is not known or has what is not exported.
        ValueError: the vehicle names a number as C or FMI cannot, or cannot be written out.
    """
    if wrong := names.faults(name):
        raise InputError(wrong)
    config = _known(artefact)
    scenario = scenario_of(config)
    values = {key: np.asarray(x, float) for key, x in leaves(scenario).items() if _settable(scenario, key)}
    try:
        start, step = programs(config, scenario, values)
    except ValueError as error:
        raise ValueError(str(error).replace("the law", "the vehicle")) from error
    for group, fields in (*step.arguments.items(), *step.results.items()):
        names.check_members(group, [field.member for field in fields])
    variables = _variables(scenario, step, values)
    check(variables)
    sources = _sources(artefact, config, start, step, name)
    said = {"NAME": name, "UPPER": name.upper()}
    groups = (*step.arguments, *SEEN, "flags")
    starts = [v for v in variables if v.role in (FIXED, TUNABLE)]
    parts = said | cases(variables) | {
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
    if config.scenario.sensor is not None:
        artefact.note("the sensor's noise is left out: an exported vehicle tells the truth")
    return archives(model, artefact) | {"README.md": readme(model, artefact, "plant")}


def _known(artefact: Artefact) -> Config:
    if artefact.config is None:
        rule = "known: config.toml beside the gains, or --config, says what the vehicle is"
        raise InputError([Fault("scenario.plant", artefact.provenance["vehicle"], rule)])
    scenario = artefact.config.scenario
    if mapped.origin(scenario).any() and any(key.startswith("plant.surface.") for key in leaves(scenario)):
        rule = "none where the path begins far from the origin of its map: its places count from where the path begins"
        raise InputError([Fault("scenario.plant.surface", "a road with places", rule)])
    return artefact.config


def _settable(scenario: Scenario, name: str) -> bool:
    """Whether a leaf is a parameter of the FMU."""
    words = name.split(".")
    return words[0] in PARTS and words[-1] != SEED and rule_of(scenario, name) is not None


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
        "PROVENANCE": commented(json.dumps(artefact.provenance, indent=2)),
        "STRUCTS": "\n\n".join(structs),
        "STEP": f"{config.simulate.dt:g}",
        "UNIFORM": UNIFORM if made else "",
        "START": body(start),
        "STEP_BODY": body(step),
    }
    return {f"{name}.{end}": filled(TEMPLATES / f"plant.{end}.txt", parts) for end in ("h", "c")}
