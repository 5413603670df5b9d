"""TOML and JSON as plain data, whatever a file holds: what would take forever or all of the stack is refused."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from typing import Any

DEEPEST = 32  # tables and lists within each other; no setting needs half of it


def toml(text: str) -> dict[str, Any]:
    """The table of a text in TOML.

    Raises:
        ValueError: it is none, or nested more than DEEPEST times.
    """
    rule = f"keys, tables or lists are nested more than {DEEPEST} times"
    if any(part.count(".") > DEEPEST for part in re.split(r"[=,\n]", text)):
        raise ValueError(rule)  # the parser takes the square of their number for it
    try:
        table = tomllib.loads(text)
    except RecursionError as error:
        raise ValueError(rule) from error
    if deeper(table, DEEPEST):
        raise ValueError(rule)
    return table


def from_json(text: str) -> Any:
    """What a text in JSON holds.

    Raises:
        ValueError: it is none, or nested more than DEEPEST times.
    """
    try:
        data = json.loads(text)
    except RecursionError as error:
        raise ValueError(f"it is nested more than {DEEPEST} times") from error
    if deeper(data, DEEPEST):
        raise ValueError(f"it is nested more than {DEEPEST} times")
    return data


def deeper(data: Any, most: int) -> bool:
    """Whether tables and lists are within each other more than `most` times."""
    layer = [data]
    for _ in range(most + 1):
        parts = (x.values() if isinstance(x, Mapping) else x for x in layer if isinstance(x, (Mapping, list)))
        layer = [x for part in parts for x in part]
        if not layer:
            return False
    return any(isinstance(x, (Mapping, list)) for x in layer)
