"""One Python file that needs NumPy alone."""

from __future__ import annotations

import json
import pprint
from pathlib import Path

import numpy as np

from ..io.files import finite
from . import guard, program
from .artefact import Artefact, filled
from .expressions import Language, expression, text
from .program import Field, Program
from .vectors import table

TEMPLATE = Path(__file__).with_name("controller.py.txt")
NAME = "agv_controller"
CHECKED = 16  # steps of its self-test
ALIASES = {"fabs": "abs", "atan2": "arctan2", "pow": "power", "atan": "arctan", "asin": "arcsin", "acos": "arccos"}
HALF_AWAY = "(lambda x: np.trunc(x + np.copysign(0.5, x)))"  # NumPy itself rounds halves to even
PYTHON = Language(
    number=lambda x: f"np.{x!r}" if x != x or abs(x) == float("inf") else repr(x),
    truth=str,
    choose=lambda c, yes, no: f"{yes} if {c} else {no}",
    call=lambda name: HALF_AWAY if name == "round" else f"np.{ALIASES.get(name, name)}",
    both="and",
    either="or",
    negate=lambda x: f"not {x}",
)


def files(artefact: Artefact, name: str = NAME) -> dict[str, str]:
    """One file, `NAME.py`."""
    law = artefact.controller
    step, start = program.step(law), program.start(law)
    gains = {name: fact["value"] for name, fact in artefact.provenance["gains"].items()}
    interface = {group: step.arguments[group] for group in ("measurement", "reference")}
    groups = {group: step.arguments[group] for group in ("state", "measurement", "reference")}
    groups |= {"later": step.results["state"], "inputs": step.results["inputs"]}
    checked = {group: {f.name: list(f.shape) for f in fields} for group, fields in groups.items()}
    _, rows = table(law, step)
    parts = {
        "TITLE": f"{artefact.provenance['law'][1]} for a {artefact.provenance['vehicle']}.",
        "GENERATOR": artefact.provenance["generator"],
        "INTERFACE": "\n".join(f"    {group}: {_listed(fields)}" for group, fields in interface.items()),
        "PERIOD": repr(float(law.period)),
        "INPUTS": repr(tuple(artefact.provenance["inputs"])).replace("'", '"'),
        "GAINS": _literal(gains),
        "STATUS": "\n".join(f'{word} = "{word}"  # {meaning}' for word, meaning in guard.STATUS.items()),
        "CHECKED": _literal(checked),
        "ROWS": ",\n    ".join(map(repr, rows[:: len(rows) // CHECKED].tolist())),
        "PROVENANCE": _literal(artefact.provenance),
        "START": _start(start),
        "STEP": _step(step),
    }
    return {f"{name}.py": filled(TEMPLATE, parts)}


def _listed(fields: tuple[Field, ...]) -> str:
    """Names, with shapes where they are arrays."""
    return ", ".join(f"{f.name} {f.shape}" if f.shape else f.name for f in fields)


def _literal(value: object) -> str:
    """A Python literal over several lines; what is not finite becomes None, as in JSON."""
    return pprint.pformat(finite(value), width=110, sort_dicts=False)


def _unpacked(program: Program) -> list[str]:
    """Lines that take the arguments apart into numbers, then one for each operation."""
    read = program.read
    numbers = [
        f"{variable} = np.float64({group}[{json.dumps(field.name)}]{place})"
        for group, fields in program.arguments.items()
        for field in fields
        for place, variable in field.elements
        if variable in read
    ]
    return numbers + [f"{o.name} = {expression(o, PYTHON)}" for o in program.operations]


def _packed(fields: tuple[Field, ...]) -> str:
    """Results as a dictionary of numbers and lists."""
    if not fields:
        return "{}"
    texts = {f.name: np.array([text(v, PYTHON) for v in f.variables], object).reshape(f.shape) for f in fields}
    items = ",\n        ".join(f"{json.dumps(name)}: {_nested(values.tolist())}" for name, values in texts.items())
    return f"{{\n        {items},\n    }}"


def _nested(values: list[str] | str) -> str:
    return f"[{', '.join(map(_nested, values))}]" if isinstance(values, list) else values


def _start(program: Program) -> str:
    head = "def _start(gains, measurement, reference):"
    return "\n    ".join([head, *_unpacked(program), f"return {_packed(program.results['state'])}"])


def _step(program: Program) -> str:
    later, inputs = _packed(program.results["state"]), _packed(program.results["inputs"])
    flags = (field.variables[0] for group in ("limited", "status") for field in program.results[group])
    limited, not_finite, started = (text(flag, PYTHON) for flag in flags)
    head = "def _step(gains, state, measurement, reference):"
    status = f"NOT_FINITE if {not_finite} else STARTED if {started} else OK"
    tail = [f"later = {later}", f"inputs = {inputs}", f"status = {status}"]
    tail += [f"return later, inputs, bool({limited}), status"]
    return "\n    ".join([head, *_unpacked(program), *tail])
