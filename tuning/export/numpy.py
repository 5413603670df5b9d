"""One Python file that needs NumPy alone."""

from __future__ import annotations

import json
import pprint
from pathlib import Path

import numpy as np

from ..io.files import finite
from . import guard, program, tables
from .artefact import Artefact, filled, plain
from .expressions import Language, lines, text
from .operations import Choice, Least
from .program import Field, Program
from .vectors import GROUPS, table

TEMPLATE = Path(__file__).with_name("controller.py.txt")
NAME = "agv_controller"
CHECKED = 16  # steps of its self-test
ALIASES = {"fabs": "abs", "atan2": "arctan2", "pow": "power", "atan": "arctan", "asin": "arcsin", "acos": "arccos"}
HALF_AWAY = "(lambda x: np.trunc(x + np.copysign(0.5, x)))"  # NumPy itself rounds halves to even


def _either(choice: Choice, condition: str, yes: list[str], no: list[str]) -> list[str]:
    return [f"if {condition}:", *indented(yes), "else:", *indented(no)]


def _loop(least: Least, count: str, body: list[str], score: str) -> list[str]:
    name, number = least.name, least.number
    better = f"if {score} < {name}_least:\n    {name}, {name}_least = {number}, {score}".split("\n")
    head = [f"{name}, {name}_least = np.float64(0.0), np.inf", f"for {number} in map(np.float64, range(int({count}))):"]
    return [*head, *indented(body), *indented(better)]


def indented(block: list[str]) -> list[str]:
    """Lines a level further in."""
    return [f"    {line}" for line in block]


LOOK = '''def read_route(file):
    """The route of a JSON file of `agvjax export`: its numbers and tables, as a step takes them; read it once."""
    return {name: np.asarray(x) for name, x in json.loads(Path(file).read_text(encoding="utf-8")).items()}


def _look(row, number):
    """The number of a row; beyond its ends, and of no number, that at the nearest end."""
    return row[(int(number) if number < len(row) else -1) if number >= 1 else 0]


'''
PYTHON = Language(
    number=lambda x: f"np.{x!r}" if x != x or abs(x) == float("inf") else repr(x),
    truth=str,
    choose=lambda c, yes, no: f"{yes} if {c} else {no}",
    call=lambda name: HALF_AWAY if name == "round" else f"np.{ALIASES.get(name, name)}",
    both="and",
    either="or",
    negate=lambda x: f"not {x}",
    define=lambda name, value, flag: f"{name} = {value}",
    assign=lambda name, value: f"{name} = {value}",
    lookup=lambda table, row, number: f"_look(route[{json.dumps(table)}][{row}], {number})",
    either_block=_either,
    loop=_loop,
)


def files(artefact: Artefact, name: str = NAME) -> dict[str, str]:
    """One file, `NAME.py`; of a law that follows a route that beside it, `NAME_route.json`."""
    route = f"{name}_route.json"
    data = {} if artefact.route is None else {route: json.dumps(tables.data(artefact.route)) + "\n"}
    return {f"{name}.py": module(artefact, route)} | data


def module(artefact: Artefact, route: str) -> str:
    """The text of the file; `route` is the name of the file of the route beside it."""
    law = artefact.controller
    step, start = program.step(law), program.start(law)
    gains = {name: fact["value"] for name, fact in artefact.provenance["gains"].items()}
    interface = {group: step.arguments[group] for group in GROUPS[1:] if group in step.arguments}
    groups = {group: step.arguments[group] for group in GROUPS if group in step.arguments}
    groups |= {"later": step.results["state"], "inputs": step.results["inputs"]}
    checked = {group: {f.name: list(f.shape) for f in fields} for group, fields in groups.items()}
    inputs, (_, rows) = list(artefact.provenance["inputs"]), table(artefact, step)
    parts = {
        **_of_route(artefact, route),
        "TITLE": plain(f"{artefact.provenance['law'][1]} for a {artefact.provenance['vehicle']}."),
        "GENERATOR": artefact.provenance["generator"],
        "INTERFACE": "\n".join(f"    {group}: {_listed(fields)}" for group, fields in interface.items()),
        "PERIOD": repr(float(law.period)),
        "INPUTS": f"({', '.join(map(json.dumps, inputs))}{',' * (len(inputs) == 1)})",
        "GAINS": _literal(gains),
        "STATUS": "\n".join(f'{word} = "{word}"  # {meaning}' for word, meaning in guard.STATUS.items()),
        "CHECKED": _literal(checked),
        "ROWS": ",\n    ".join(map(_row, rows[:: len(rows) // CHECKED].tolist())),
        "PROVENANCE": _literal(artefact.provenance),
        "START": _start(start),
        "STEP": _step(step),
    }
    return filled(TEMPLATE, parts)


def _of_route(artefact: Artefact, route: str) -> dict[str, str]:
    """What the template says of what is asked for: a reference at each instant, or a route."""
    if artefact.route is None:
        found = {"DICTIONARIES": "Measurement and reference are dictionaries", "GIVEN": "reference"}
        return (
            found
            | {"TESTED": 'parts["reference"]'}
            | dict.fromkeys(("IMPORTS", "READ", "READ_ROUTE", "LOOK", "FINITE"), "")
        )
    finite = (
        "        wanted, got = (x[np.isfinite(wanted)] for x in (wanted, got))  # not what is left of a closed route\n"
    )
    return {
        "DICTIONARIES": "Measurement is a dictionary",
        "GIVEN": "route",
        "TESTED": "route",
        "IMPORTS": "import json\nfrom pathlib import Path\n\n",
        "READ": f'    route = read_route("{route}")  # or another, of another export\n',
        "READ_ROUTE": f'    route = read_route(Path(__file__).with_name("{route}"))\n',
        "LOOK": LOOK,
        "FINITE": finite,
    }


def _listed(fields: tuple[Field, ...]) -> str:
    """Names, with shapes where they are arrays."""
    return ", ".join(f"{f.name} {f.shape}" if f.shape else f.name for f in fields)


def _row(numbers: list[float]) -> str:
    return f"[{', '.join(map(PYTHON.number, numbers))}]"


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
    return numbers + lines(program.operations, PYTHON)


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
    head = f"def _start(gains, measurement, {program.given}):"
    return "\n    ".join([head, *_unpacked(program), f"return {_packed(program.results['state'])}"])


def _step(program: Program) -> str:
    later, inputs = _packed(program.results["state"]), _packed(program.results["inputs"])
    flags = (field.variables[0] for group in ("limited", "status") for field in program.results[group])
    limited, not_finite, started = (text(flag, PYTHON) for flag in flags)
    head = f"def _step(gains, state, measurement, {program.given}):"
    status = f"NOT_FINITE if {not_finite} else STARTED if {started} else OK"
    tail = [f"later = {later}", f"inputs = {inputs}", f"status = {status}"]
    tail += [f"return later, inputs, bool({limited}), status"]
    return "\n    ".join([head, *_unpacked(program), *tail])
