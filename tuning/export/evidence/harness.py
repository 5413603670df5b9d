"""The exported files with a program around them that runs rows, and what it makes of them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .. import c_route
from ..artefact import Artefact, filled
from ..program import Program
from .check import Bench
from .rows import Layout, routes

FILES = Path(__file__).with_name("files")
STRICT = ("-std=c99", "-ffp-contract=off")


class Subject(NamedTuple):
    """What the evidence is about."""

    artefact: Artefact
    program: Program  # the step
    layout: Layout
    name: str
    texts: dict[str, str]  # the exported files that a robot runs, by name

    @property
    def upper(self) -> str:
        """How macros begin."""
        return self.name.upper()

    @property
    def sources(self) -> list[str]:
        """Those in C."""
        return [file for file in self.texts if file.endswith(".c")]

    def single(self, bits: int) -> list[str]:
        """The option of the precision."""
        return [f"-D{self.upper}_FLOAT"] if bits == 32 else []


def files(subject: Subject) -> dict[str, str]:
    """The program, and the routes that it knows besides that of the configuration."""
    name, layout, laid = subject.name, subject.layout, routes(subject.artefact)
    count = {group: len(columns) for group, columns in layout.columns.items()}
    inputs = [f"output.{f.member}{place}" for f in subject.program.results["inputs"] for place, _ in f.elements]
    state = count["state"] > 0
    parts = {
        "NAME": name,
        "UPPER": subject.upper,
        "REF_TITLE": "" if laid else ", reference",
        "ROW": str(len(layout.names)),
        "MADE": str(len(layout.results) + 2),
        "ROUTES": _declared(name, len(laid)),
        "GIVEN_DECLARED": "" if laid else f"static {name}_reference reference;",
        "GAINS": str(count["gains"]),
        "MEASUREMENT": str(count["measurement"]),
        "TAKE_STATE": f"        at = take(({name}_real *)(void *)&state, {count['state']}, at);" if state else "",
        "TAKE_GIVEN": ""
        if laid
        else f"        at = take(({name}_real *)(void *)&reference, {count['reference']}, at);",
        "PASSED": "routes[(int)row[1]]" if laid else "&reference",
        "PUT_STATE": _put_state(name, count["state"]) if state else "        i = 0;",
        "PUT_INPUTS": "\n".join(f"        made[k++] = (double){place};" for place in inputs),
    }
    made = {"harness.c": filled(FILES / "harness.c.txt", parts)}
    for number, route in enumerate(laid[1:], 1):
        text = c_route.files(subject.artefact._replace(route=route), name)[f"{name}_route.c"]
        made[f"route_{number}.c"] = text.replace(f"{name}_configured_route", f"route_{number}")
    return made


def _put_state(name: str, count: int) -> str:
    number = f"(({name}_real *)(void *)&state)[i]"
    return f"        for (i = 0; i < {count}; i++) {{\n            made[k++] = (double){number};\n        }}"


def _declared(name: str, count: int) -> str:
    if not count:
        return ""
    others = [f"route_{k}" for k in range(1, count)]
    lines = [f"extern const {name}_route {other};" for other in others]
    known = ", ".join(f"&{x}" for x in (f"{name}_configured_route", *others))
    return "\n".join([*lines, f"static const {name}_route *const routes[{count}] = {{{known}}};"])


def compiled(bench: Bench, subject: Subject, compiler: Sequence[str], made: str = "harness") -> list[str]:
    """What a compiler objects to when it builds the program; nothing if it is there."""
    sources = [*subject.sources, *(file for file in files(subject) if file.endswith(".c"))]
    done = bench.call(*compiler, "-o", made, *sources, "-lm")
    return [] if done.returncode == 0 else messages(done.stderr) or [f"{compiler[0]} ended with {done.returncode}"]


def messages(text: str) -> list[str]:
    """The lines of a compiler that begin with a file."""
    return [line for line in text.splitlines() if re.match(r"[\w./]+:\d+", line) and "note:" not in line]


def ran(bench: Bench, subject: Subject, rows: np.ndarray, *command: str) -> tuple[np.ndarray | None, str]:
    """What the program makes of rows, a row of numbers each; None and what was said where it did not end well."""
    (bench.folder / "vectors.bin").write_bytes(np.ascontiguousarray(rows, "<f8").tobytes())
    (bench.folder / "results.bin").unlink(missing_ok=True)
    done = bench.call(*command)
    if done.returncode:
        said = done.stderr.replace(str(bench.folder), ".").strip()
        return None, said[:2000] or f"{command[0]} ended with {done.returncode}"
    columns = len(subject.layout.results) + 2
    made = np.frombuffer((bench.folder / "results.bin").read_bytes(), "<f8")
    if made.size != len(rows) * columns:
        return None, f"{made.size} numbers came out where {len(rows) * columns} should"
    return made.reshape(len(rows), columns), done.stderr


def write(bench: Bench, subject: Subject, more: Mapping[str, str] | None = None) -> None:
    """The files of the subject, and of its program, into the folder."""
    for file, text in (subject.texts | files(subject) | dict(more or {})).items():
        (bench.folder / file).write_text(text, encoding="utf-8")
