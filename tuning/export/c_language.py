"""How C99 says the operations of a program."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np

from . import tables
from .artefact import plain
from .expressions import Language, lines, text
from .operations import Choice, Least
from .program import Field, Program

EMPTY = "unused"  # member of a structure that has no other


def double(x: float) -> str:
    """A number, also one that is not finite."""
    if not np.isfinite(x):
        return "HUGE_VAL" if x > 0 else "-HUGE_VAL" if x < 0 else "(HUGE_VAL - HUGE_VAL)"
    return repr(float(x))


def language(name: str) -> Language:
    """C99 with the macros and types of a library of this name."""
    real, upper = f"{name}_real", name.upper()
    columns = {table.name: table.columns for table in tables.TABLES.values()}

    def either(choice: Choice, condition: str, yes: list[str], no: list[str]) -> list[str]:
        kinds = [(made, "_Bool" if flag else real) for made, flag in zip(choice.names, choice.flags, strict=True)]
        declared = [f"{kind} {made};" for made, kind in kinds]
        return [*declared, f"if ({condition}) {{", *_indented(yes), "} else {", *_indented(no), "}"]

    def loop(least: Least, count: str, body: list[str], score: str) -> list[str]:
        made, at, lowest = least.name, f"{least.name}_at", f"{least.name}_least"
        head = [f"{real} {made} = {upper}_R(0.0);", f"{real} {lowest} = {upper}_R(HUGE_VAL);", f"int {at};"]
        head.append(f"for ({at} = 0; {at} < (int){count}; {at}++) {{")
        better = [f"if ({score} < {lowest}) {{", f"    {lowest} = {score};", f"    {made} = {least.number};", "}"]
        return [*head, *_indented([f"const {real} {least.number} = ({real}){at};", *body, *better]), "}"]

    def lookup(table: str, row: int, number: str) -> str:
        count = f"route->{columns[table]}"
        at = count if row == 1 else f"{row} * {count}"
        begins = f"&route->{table}[{at}]" if row else f"route->{table}"
        return f"{name}_look({begins}, {number}, {count})"

    return Language(
        number=lambda x: f"{upper}_R({double(x)})",
        truth=lambda x: str(int(x)),
        choose=lambda c, yes, no: f"({c}) ? {yes} : {no}",
        call=lambda function: f"{upper}_M({function})",
        both="&&",
        either="||",
        negate=lambda x: f"!{x}",
        define=lambda made, value, flag: f"const {'_Bool' if flag else real} {made} = {value};",
        assign=lambda made, value: f"{made} = {value};",
        lookup=lookup,
        either_block=either,
        loop=loop,
    )


def _indented(block: list[str]) -> list[str]:
    return [f"    {line}" for line in block]


def commented(text: str) -> str:
    """As the inside of a comment: nothing in it begins or ends one, or is a trigraph."""
    return re.sub(r"\?(?=\?)", "? ", text.replace("/*", "/ *").replace("*/", "* /"))


def note(text: str) -> str:
    """A text of anybody as the inside of a comment in one line."""
    return commented(plain(text))


def struct(name: str, fields: Iterable[Field], notes: dict[str, str], more: Sequence[str] = ()) -> str:
    """A structure NAME_WORD of numbers, with a note beside those that have one; `more` lines after them.

    Without any it has one member: C99 has no structure without members.
    """
    real, members = f"{name.rpartition('_')[0]}_real", []
    for field in fields:
        shape = "".join(f"[{n}]" for n in field.shape)
        about = note(notes.get(field.name, ""))
        members.append(f"    {real} {field.member}{shape};" + (f" /* {about} */" if about else ""))
    members += [*more] or ([] if members else [f"    {real} {EMPTY};"])
    return "typedef struct {\n" + "\n".join(members) + f"\n}} {name};"


def computed(program: Program, name: str) -> list[str]:
    """What a function reads of its arguments, called as the program's groups, and all that it makes of that."""
    real, read, declared, idle = f"{name}_real", program.read, [], []
    for group, fields in program.arguments.items():
        used = [(f"{f.member}{place}", v) for f in fields for place, v in f.elements if v in read]
        cast = f"({real})" if group == "route" else ""  # whole numbers among it
        declared += [f"const {real} {v} = {cast}{group}->{member};" for member, v in used]
        idle += [] if used else [f"(void){group};"]
    return [*declared, *lines(program.operations, language(name)), *idle]


def assigned(target: str, fields: Iterable[Field], name: str) -> list[str]:
    """Results handed over in the structure that `target` points to."""
    return [
        f"{target}->{field.member}{place} = {text(value, language(name))};"
        for field in fields
        for place, value in field.elements
    ]
