"""The law as an FMU: measurement and reference in, commands out, gains as parameters; one period at a time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from agvjax import Sampled
from agvjax.leaves import get, rule_of, unit_of

from .. import c, guard, program
from ..artefact import Artefact, filled
from ..c_language import double
from ..program import Program
from .archive import TEMPLATES, archives
from .description import Model
from .readme import readme
from .variables import CONSTANT, HELD, INPUT, TUNABLE, Variable, capped, cases, check, clock, commands, of_field, seen

NAME = "agv_controller"
PERIOD = "period"  # a gain of the law, and what an FMU's step is: no importer may change it
DEFAULTS = "    m->gains = {name}_tuned;"
STATES = ("gains", "state", "measurement", "reference", "output")  # structures of the model


def files(artefact: Artefact, name: str = NAME) -> dict[str, str | bytes]:
    """NAME.fmi2.fmu, NAME.fmi3.fmu and a README.

    Raises:
        agvjax.InputError: the name is none of a C library.
        ValueError: the law or the vehicle names a number as C or FMI cannot, or cannot be written out.
    """
    step = program.step(artefact.controller)
    sources = c.library(artefact, step, name)
    variables = variables_of(artefact.controller, step)
    check(variables)
    given = "&m->reference" if step.given == "reference" else f"&{name}_configured_route"
    members = [f"    {name}_{group} {group};" for group in STATES if group == "output" or group in step.arguments]
    said = {"NAME": name, "UPPER": name.upper(), "GIVEN": given}
    parts = said | cases(variables) | {
        "STEP": double(float(artefact.controller.period)),
        "SAMPLES": "1",
        "MEMBERS": "\n".join([*members, "    int begun; /* whether the law has looked once */"]),
        "DEFAULTS": DEFAULTS.format(name=name),
        "FUNCTIONS": filled(TEMPLATES / "controller.c.txt", said),
    }  # fmt: skip
    units = [file for file in sources if Path(file).suffix == ".c"]
    sources[f"{name}_model.h"] = filled(TEMPLATES / "model.h.txt", parts)
    about, generator = c.title(artefact), artefact.provenance["generator"]
    model = Model(name, about, generator, float(artefact.controller.period), variables, sources, units)
    return archives(model, artefact) | {"README.md": readme(model, artefact, "controller")}


def variables_of(law: Sampled, step: Program) -> list[Variable]:
    """Those of a law and its `step`."""
    found = [clock]
    found += seen("measurement", step.arguments["measurement"], INPUT, "measurement.")
    found += seen("reference", step.arguments.get("reference", ()), INPUT, "reference.")
    found += commands("output", step.results["inputs"], law.vehicle, HELD)
    words = ", ".join(f"{i} {word}: {meaning}" for i, (word, meaning) in enumerate(guard.STATUS.items()))
    kept = "whether the law kept something back"
    found.append(Variable("limited", "m->output.limited", HELD, about=kept, kind="Boolean"))
    found.append(Variable("status", "m->output.status", HELD, about=words, kind="Integer"))
    most = _most(law)
    for field in step.arguments["gains"]:
        name, value = field.name, np.asarray(get(law, field.name), float)
        role = CONSTANT if name == PERIOD else TUNABLE
        rule = capped(rule_of(law, name), most[name]) if name in most else rule_of(law, name)
        facts = {"unit": unit_of(law, name), "rule": rule}
        found += of_field("gains", field, role, values=value, pairs=False, **facts)
    return found


def _most(law: Sampled) -> dict[str, float]:
    """Parameters that what is kept from period to period is too short for beyond: delays, by the inputs stored."""
    parts, period = {"prediction": law.prediction, "compensation": law.compensation}, float(law.period)
    return {f"{part}.{name}": x for part, held in parts.items() for name, x in held.upper_bounds(period).items()}
