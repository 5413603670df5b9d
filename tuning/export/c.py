"""C99 of the step: no allocation, nothing but math.h, with a self-test."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import PyTree

from agvjax import Fault, InputError

from . import program
from .artefact import Artefact, filled
from .expressions import FUNCTIONS, Language, expression, text
from .program import Field, Program
from .vectors import table

TEMPLATES = Path(__file__).with_name("c_files")
NAME = "agv_controller"
RESERVED = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if inline int long main"
    " register restrict return short signed sizeof static struct switch typedef union unsigned void volatile"
    " while".split()
)
GROUPS = ("gains", "state", "measurement", "reference")
EMPTY = "unused"  # C99 has no structure without members
LIMITED = "    int limited; /* whether the law kept something back */"


def files(artefact: Artefact, name: str = NAME) -> dict[str, str]:
    """Header, source, self-test, its vectors, Makefile and README by relative paths.

    Raises:
        agvjax.InputError: the name is none of a C library.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name) or name in RESERVED | {"vectors"}:
        rule = "lower-case letters, digits and underscores, a letter first, no word of C, not vectors"
        raise InputError([Fault("--name", name, rule)])
    step, start = program.step(artefact.controller), program.start(artefact.controller)
    header, rows = table(artefact.controller, step)
    inputs = [f"{field.member}{place}" for field in step.results["inputs"] for place, _ in field.elements]
    parts = {
        "NAME": name,
        "UPPER": name.upper(),
        "TITLE": f"{artefact.provenance['law'][1]} for a {artefact.provenance['vehicle']}, one period of"
        f" {float(artefact.controller.period):g} s at a time.",
        "PERIOD": f"{float(artefact.controller.period):g}",
        "ROWS": str(len(rows)),
        "FIRST": inputs[0],
        "COMPARED": "\n".join(f"        got[i++] = (double)output.{place};" for place in inputs),
    }
    same = ("main.c", "Makefile", "README.md")  # but for their parts
    return {file: filled((TEMPLATES / f"{file}.txt").read_text(encoding="utf-8"), parts) for file in same} | {
        f"{name}.h": _header(artefact, step, name),
        f"{name}.c": _source(artefact, step, start, name),
        "vectors.h": _vectors(step, rows),
        "vectors.csv": "\n".join([",".join(header), *(",".join(map(repr, row)) for row in rows.tolist())]) + "\n",
    }


def _language(name: str) -> Language:
    return Language(
        number=lambda x: f"{name.upper()}_R({_double(x)})",
        truth=lambda x: str(int(x)),
        choose=lambda c, yes, no: f"({c}) ? {yes} : {no}",
        call=lambda function: f"{name.upper()}_M({function})",
        both="&&",
        either="||",
        negate=lambda x: f"!{x}",
    )


def _double(x: float) -> str:
    if not np.isfinite(x):
        return "HUGE_VAL" if x > 0 else "-HUGE_VAL" if x < 0 else "(HUGE_VAL - HUGE_VAL)"
    return repr(float(x))


def _struct(name: str, fields: Iterable[Field], notes: dict[str, str], more: Sequence[str] = ()) -> str:
    real = f"{name.rpartition('_')[0]}_real"
    lines = []
    for field in fields:
        shape = "".join(f"[{n}]" for n in field.shape)
        note = notes.get(field.name, "")
        lines.append(f"    {real} {field.member}{shape};" + (f" /* {note} */" if note else ""))
    lines += more or ([] if lines else [f"    {real} {EMPTY};"])
    return "typedef struct {\n" + "\n".join(lines) + f"\n}} {name};"


UNITS = {"position": "m, of the reference point", "velocity": "m/s, of the reference point", "heading": "rad"}
UNITS |= {"yaw_rate": "rad/s", "acceleration": "m/s^2", "heading_rate": "rad/s", "steering_angle": "rad"}


# long: one template
def _header(artefact: Artefact, step: Program, name: str) -> str:
    facts = artefact.provenance["gains"]
    notes = {gain: ", ".join(filter(None, (fact["unit"], fact["rule"]))) for gain, fact in facts.items()}
    structs = [
        _struct(f"{name}_gains", step.arguments["gains"], notes),
        _struct(f"{name}_state", step.arguments["state"], {}),
        _struct(f"{name}_measurement", step.arguments["measurement"], UNITS),
        _struct(f"{name}_reference", step.arguments["reference"], UNITS | {"position": "m", "velocity": "m/s"}),
        _struct(f"{name}_output", step.results["inputs"], {}, [LIMITED]),
    ]
    start, one = _signatures(name)
    return f"""/*
{json.dumps(artefact.provenance, indent=2).replace("*/", "* /")}
*/
#ifndef {name.upper()}_H
#define {name.upper()}_H

#ifdef {name.upper()}_FLOAT
typedef float {name}_real;
#else
typedef double {name}_real;
#endif

#define {name.upper()}_PERIOD {_double(float(artefact.controller.period))} /* s */

{chr(10).join(f"{text}{chr(10)}" for text in structs)}
/* The tuned gains. */
extern const {name}_gains {name}_tuned;

/* SHA-256 of the configuration that they were tuned by. */
extern const char {name}_configuration[65];

/* The state of a law that starts now. */
{start};

/* One period: what to ask of the actuators, to be held until the next; the state goes on. */
{one};

#endif
"""


def _signatures(name: str) -> tuple[str, str]:
    """Of the functions that start and that step."""
    arguments = f"const {name}_gains *gains, {name}_state *state, const {name}_measurement *measurement,"
    begun = f"({arguments}\n    const {name}_reference *reference"
    return f"void {name}_start{begun})", f"void {name}_step{begun}, {name}_output *output)"


def _source(artefact: Artefact, step: Program, start: Program, name: str) -> str:
    gains = {key: fact["value"] for key, fact in artefact.provenance["gains"].items()}
    values = [f"    {_initial(gains[f.name], name)}, /* {f.name} */" for f in step.arguments["gains"]]
    used = {o.primitive for o in (*step.operations, *start.operations)}
    functions = sorted({FUNCTIONS[p] for p in used if p in FUNCTIONS} | ({"rint"} if "round" in used else set()))
    start_signature, step_signature = _signatures(name)
    return f"""#include "{name}.h"

#include <math.h>

#define {name.upper()}_R(x) (({name}_real)(x))
#ifdef {name.upper()}_FLOAT
#define {name.upper()}_M(function) function##f
#else
#define {name.upper()}_M(function) function
#endif
/* of math.h: {", ".join(functions)} */

const {name}_gains {name}_tuned = {{
{chr(10).join(values)}
}};

const char {name}_configuration[65] = "{artefact.provenance["configuration_sha256"]}";

{start_signature}
{{
{_body(start, name)}
}}

{step_signature}
{{
{_body(step, name)}
}}
"""


def _initial(value: PyTree, name: str) -> str:
    """A number, or an array in braces."""
    if isinstance(value, list):
        return "{" + ", ".join(_initial(x, name) for x in value) + "}"
    return f"{name.upper()}_R({_double(value)})"


def _body(program: Program, name: str) -> str:
    language, real, read = _language(name), f"{name}_real", program.read
    declared, idle = [], []
    for group in GROUPS:
        fields = program.arguments.get(group, ())
        used = [(f"{f.member}{place}", v) for f in fields for place, v in f.elements if v in read]
        declared += [f"const {real} {v} = {group}->{member};" for member, v in used]
        idle += [] if used or group == "state" else [f"(void){group};"]
    for operation in program.operations:
        kind = "int" if operation.flag else real
        declared.append(f"const {kind} {operation.name} = {expression(operation, language)};")
    targets = {"state": "state", "inputs": "output", "empty": "state", "limited": "output"}
    empty = {} if program.results["state"] else {"empty": (Field(EMPTY, (), (0.0,)),)}
    results = [
        f"{target}->{field.member}{place} = {text(value, language)};"
        for group, target in targets.items()
        for field in (program.results | empty).get(group, ())
        for place, value in field.elements
    ]
    return "\n".join(f"    {line}" for line in (*declared, *idle, *results))


def _vectors(step: Program, rows: np.ndarray) -> str:
    """`vectors.h`: the rows of the self-test, with their number and the sizes of their parts."""
    counts = {group.upper(): sum(len(f.variables) for f in step.arguments[group]) for group in GROUPS[1:]}
    counts["RESULTS"] = counts["STATE"] + sum(len(f.variables) for f in step.results["inputs"])
    lines = ["    {" + ", ".join(map(_double, row)) + "}," for row in rows.tolist()]
    head = "/* Each row: state, measurement, reference; then the state afterwards, the inputs, whether limited. */"
    counts |= {"VECTORS": len(rows), "COLUMNS": rows.shape[1]}
    size = "\n".join(f"#define {key} {value}" for key, value in counts.items())
    return "\n".join([head, size, "static const double vectors[VECTORS][COLUMNS] = {", *lines, "};", ""])
