"""What C says of a route: its structure, the route of the configuration as data, how a number of it is looked up."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from agvjax import Route

from . import tables
from .artefact import Artefact, filled
from .c_language import double

TEMPLATE = Path(__file__).with_name("c_files") / "route.c.txt"
ACROSS = 5  # numbers in a line
LOOK = """
/* The number of a row of `count`; beyond its ends, and of no number, that at the nearest end. */
static {name}_real {name}_look(const {name}_real *row, {name}_real number, int count)
{{
    int at;
    if (number >= ({name}_real)count) {{
        at = count - 1;
    }} else if (number >= ({name}_real)1.0) {{
        at = (int)number;
    }} else {{
        at = 0;
    }}
    return row[at];
}}
"""
CONFIGURED = """
/* The route of the configuration, in {name}_route.c: data alone, another may be given to start and step. */
extern const {name}_route {name}_configured_route;
"""


def parts(route: Route | None, given: str, name: str) -> dict[str, str]:
    """What templates say of what is asked for: a reference at each instant, or a route."""
    found = {"GIVEN": given, "INITIAL": "", "ROUTE_FILE": "", "LOOK": "", "CONFIGURED": "", "ABOUT_ROUTE": ""}
    found |= {"NUMBERS": "measurement or reference", "POSITIONS": "measurement and reference", "PASSED": given}
    if route is None:
        return found
    about = filled(TEMPLATE.with_name("route.md.txt"), {"NAME": name})
    filled_in = {"INITIAL": f" = {name}_configured_route", "ROUTE_FILE": f" {name}_route.c", "ABOUT_ROUTE": about}
    found |= {"NUMBERS": "the measurement", "POSITIONS": "measurement and route", "PASSED": f"{name}_configured_route"}
    return found | filled_in | {"LOOK": LOOK.format(name=name), "CONFIGURED": CONFIGURED.format(name=name)}


def struct(name: str) -> str:
    """The structure of a route; tables of several rows are one array, row after row."""
    real, lines = f"{name}_real", []
    for member in tables.Sizes._fields:
        kind = real if member in ("length", "reached") else "int"
        lines.append(f"    {kind} {member}; /* {tables.UNITS[member]} */")
    for table in tables.TABLES.values():
        lines.append(f"    const {real} *{table.name}; /* [rows * {table.columns}], {table.meaning} */")
    return "typedef struct {\n" + "\n".join(lines) + f"\n}} {name}_route;"


def files(artefact: Artefact, name: str) -> dict[str, str]:
    """`NAME_route.c`, of a law that follows one."""
    if artefact.route is None:
        return {}
    sizes, arrays = tables.data(artefact.route), tables.arrays(artefact.route)
    members = [f"R({double(sizes[m])})" if m in ("length", "reached") else str(sizes[m]) for m in tables.Sizes._fields]
    said = {
        "NAME": name,
        "GENERATOR": artefact.provenance["generator"],
        "HASH": artefact.provenance["configuration_sha256"],
        "ARRAYS": "\n\n".join(_array(f"{name}_real", table, x) for table, x in arrays.items()),
        "MEMBERS": ",\n".join(f"    {member}" for member in [*members, *arrays]),
    }
    return {f"{name}_route.c": filled(TEMPLATE, said)}


def _array(real: str, table: str, values: np.ndarray) -> str:
    numbers = [f"R({double(x)})" for x in values.ravel().tolist()]
    lines = [", ".join(numbers[i : i + ACROSS]) for i in range(0, len(numbers), ACROSS)]
    body = ",\n".join(f"    {line}" for line in lines)
    return f"static const {real} {table}[{len(numbers)}] = {{\n{body}\n}};"
