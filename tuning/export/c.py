"""C99 of the step: no allocation, nothing but math.h, with a self-test."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from jaxtyping import PyTree

from agvjax import InputError
from agvjax.engine.loop import farthest

from . import c_route, guard, names, program
from .artefact import Artefact, filled, plain
from .c_language import EMPTY, assigned, commented, computed, double, struct
from .expressions import FUNCTIONS
from .operations import Operand, flat
from .program import Field, Program
from .vectors import table

TEMPLATES = Path(__file__).with_name("c_files")
NAME = "agv_controller"
GROUPS = ("state", "measurement", "reference")  # of a row of the self-test; a route is none of them
TARGETS = (("state", "state"), ("inputs", "output"))  # which structure has which results; truth values besides
OUTPUT = ["limited", "status"]  # members of its structure besides the inputs
FLAGS = (
    "    int limited; /* whether the law kept something back */",
    "    int status; /* one of the words of the status above: look at it every period */",
)


def files(artefact: Artefact, name: str = NAME) -> dict[str, str]:
    """Header, source, self-test, its vectors, Makefile and README by relative paths.

    Raises:
        agvjax.InputError: the name is none of a C library.
        ValueError: the law or the vehicle names a number as C cannot.
    """
    step = program.step(artefact.controller)
    texts, parts = _library(artefact, step, name)
    header, rows = table(artefact, step)
    inputs = [f"{field.member}{place}" for field in step.results["inputs"] for place, _ in field.elements]
    parts |= {
        "TITLE": title(artefact),
        "PERIOD": f"{float(artefact.controller.period):g}",
        "ROWS": str(len(rows)),
        "FIRST": inputs[0],
        "COMPARED": "\n".join(f"        got[i++] = (double)output.{place};" for place in inputs),
    }
    texts |= {file: filled(TEMPLATES / f"{file}.txt", parts) for file in ("main.c", "Makefile", "README.md")}
    lines = [",".join(header), *(",".join(map(repr, row)) for row in rows.tolist())]
    return texts | {"vectors.h": _vectors(step, rows), "vectors.csv": "\n".join(lines) + "\n"}


def library(artefact: Artefact, step: Program, name: str) -> dict[str, str]:
    """Header and source of a `step`, and the route where there is one: what a program links; raises as `files` does."""
    return _library(artefact, step, name)[0]


def title(artefact: Artefact) -> str:
    """What it is, in a line."""
    facts, period = artefact.provenance, float(artefact.controller.period)
    return plain(f"{facts['law'][1]} for a {facts['vehicle']}, one period of {period:g} s at a time.")


def _library(artefact: Artefact, step: Program, name: str) -> tuple[dict[str, str], dict[str, str]]:
    """These files, and what templates say of them."""
    if wrong := names.faults(name):
        raise InputError(wrong)
    _check(step)
    start, facts = program.start(artefact.controller), artefact.provenance
    gains = [f"    {_initial(facts['gains'][f.name]['value'], name)}, /* {f.name} */" for f in step.arguments["gains"]]
    parts = {
        "NAME": name,
        "UPPER": name.upper(),
        **c_route.parts(artefact.route, step.given, name),
        "EXACT_PERIOD": double(float(artefact.controller.period)),
        "STATUS": _status(name),
        "STRUCTS": _structs(artefact, step, name),
        "FUNCTIONS": ", ".join(sorted(_functions(step, start))),
        "GAINS": "\n".join(gains),
        "HASH": facts["configuration_sha256"],
        "START": _body(start, name),
        "STEP": _body(step, name),
        "PROVENANCE": commented(json.dumps(facts, indent=2)),
    }
    texts = {f"{name}.{end}": filled(TEMPLATES / f"controller.{end}.txt", parts) for end in ("h", "c")}
    return texts | c_route.files(artefact, name), parts


def _check(step: Program) -> None:
    """Raise a ValueError for a number that is named as none can be in C."""
    for group, fields in (step.arguments | {"output": step.results["inputs"]}).items():
        names.check_members(group, [field.member for field in fields] + OUTPUT * (group == "output"))


def _functions(*programs: Program) -> set[str]:
    """What they call of math.h."""
    used = {operation.primitive for one in programs for operation in flat(one.operations)}
    return {FUNCTIONS[p] for p in used if p in FUNCTIONS} | ({"rint"} if "round" in used else set())


def _status(name: str) -> str:
    coarse = "in single precision: the step was taken with a position beyond FAR, which a float does not tell to 1 mm"
    words = enumerate((guard.STATUS | {"COARSE": coarse}).items())
    lines = [f"#define {name.upper()}_{word} {i} /* {meaning} */" for i, (word, meaning) in words]
    return "\n".join([*lines, f"#define {name.upper()}_FAR {farthest('float32'):.1f}f /* m */"])


UNITS = {"position": "m, of the reference point", "velocity": "m/s, of the reference point", "heading": "rad"}
UNITS |= {"yaw_rate": "rad/s", "acceleration": "m/s^2", "heading_rate": "rad/s", "steering_angle": "rad"}


def _structs(artefact: Artefact, step: Program, name: str) -> str:
    facts = artefact.provenance["gains"]
    gains = {gain: ", ".join(filter(None, (fact["unit"], fact["rule"]))) for gain, fact in facts.items()}
    structs = [
        struct(f"{name}_gains", step.arguments["gains"], gains),
        struct(f"{name}_state", step.arguments["state"], {}),
        struct(f"{name}_measurement", step.arguments["measurement"], UNITS),
        _given(step, name),
        struct(f"{name}_output", step.results["inputs"], {}, FLAGS),
    ]
    return "\n\n".join(structs)


def _given(step: Program, name: str) -> str:
    """The structure of what is asked for."""
    if step.given == "route":
        return c_route.struct(name)
    return struct(f"{name}_reference", step.arguments["reference"], UNITS | {"position": "m", "velocity": "m/s"})


def _initial(value: PyTree, name: str) -> str:
    """A number, or an array in braces."""
    if isinstance(value, list):
        return "{" + ", ".join(_initial(x, name) for x in value) + "}"
    return f"{name.upper()}_R({double(value)})"


def _body(program: Program, name: str) -> str:
    results = [line for group, target in TARGETS for line in assigned(target, program.results.get(group, ()), name)]
    if not program.results["state"]:
        results += assigned("state", [Field(EMPTY, (), (0.0,))], name)
    results += _said(program, name)
    return "\n".join(f"    {line}" for line in (*computed(program, name), *results))


def _said(program: Program, name: str) -> list[str]:
    """What a step says of itself: whether the law kept something back, and the word of its status."""
    if "status" not in program.results:
        return []
    (limited,), flags = (program.results[group] for group in ("limited", "status"))
    usual, *words = (f"output->status = {name.upper()}_{word};" for word in guard.STATUS)
    kept_back = _cases([(limited.variables[0], "output->limited = 1;")], "output->limited = 0;")
    return kept_back + _cases([(x.variables[0], word) for x, word in zip(flags, words, strict=True)], usual)


def _cases(cases: list[tuple[Operand, str]], otherwise: str) -> list[str]:
    """The statement of the first condition that holds; one that is known not to hold is not written."""
    written: list[str] = []
    for condition, statement in cases:
        if condition is True:
            otherwise = statement
            break
        if condition is not False:
            written += [f"{'} else ' if written else ''}if ({condition}) {{", f"    {statement}"]
    return [*written, "} else {", f"    {otherwise}", "}"] if written else [otherwise]


def _vectors(step: Program, rows: np.ndarray) -> str:
    """`vectors.h`: the rows of the self-test, with their number and the sizes of their parts."""
    groups = {group: step.arguments.get(group, ()) for group in GROUPS}
    counts = {group.upper(): sum(len(f.variables) for f in fields) for group, fields in groups.items()}
    counts["RESULTS"] = counts["STATE"] + sum(len(f.variables) for f in step.results["inputs"])
    lines = ["    {" + ", ".join(map(double, row)) + "}," for row in rows.tolist()]
    head = "/* Each row: state, measurement, reference; then the state afterwards, the inputs, whether limited. */"
    counts |= {"VECTORS": len(rows), "COLUMNS": rows.shape[1]}
    size = "\n".join(f"#define {key} {value}" for key, value in counts.items())
    return "\n".join([head, size, "static const double vectors[VECTORS][COLUMNS] = {", *lines, "};", ""])
