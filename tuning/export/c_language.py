"""How C99 says the operations of a program."""

from __future__ import annotations

import numpy as np

from . import tables
from .expressions import Language
from .operations import Choice, Least


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
        kinds = [(made, "int" if flag else real) for made, flag in zip(choice.names, choice.flags, strict=True)]
        declared = [f"{kind} {made};" for made, kind in kinds]
        return [*declared, f"if ({condition}) {{", *_indented(yes), "} else {", *_indented(no), "}"]

    def loop(least: Least, count: str, body: list[str], score: str) -> list[str]:
        made, at, lowest = least.name, f"{least.name}_at", f"{least.name}_least"
        head = [f"{real} {made} = 0, {lowest} = {upper}_R(HUGE_VAL);", f"int {at};"]
        head.append(f"for ({at} = 0; {at} < (int){count}; {at}++) {{")
        better = [f"if ({score} < {lowest}) {{", f"    {lowest} = {score};", f"    {made} = {least.number};", "}"]
        return [*head, *_indented([f"const {real} {least.number} = ({real}){at};", *body, *better]), "}"]

    def lookup(table: str, row: int, number: str) -> str:
        count = f"route->{columns[table]}"
        return f"{name}_look(route->{table} + {row} * {count}, {number}, {count})"

    return Language(
        number=lambda x: f"{upper}_R({double(x)})",
        truth=lambda x: str(int(x)),
        choose=lambda c, yes, no: f"({c}) ? {yes} : {no}",
        call=lambda function: f"{upper}_M({function})",
        both="&&",
        either="||",
        negate=lambda x: f"!{x}",
        define=lambda made, value, flag: f"const {'int' if flag else real} {made} = {value};",
        assign=lambda made, value: f"{made} = {value};",
        lookup=lookup,
        either_block=either,
        loop=loop,
    )


def _indented(block: list[str]) -> list[str]:
    return [f"    {line}" for line in block]
