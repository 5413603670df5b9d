"""The parameters of the node: names, types, defaults and bounds as `parameters.yaml` states them."""

from __future__ import annotations

import math
from pathlib import Path

import yaml

RULES = {
    "bounds": lambda x, low, high: low <= x <= high,
    "gt": lambda x, low: x > low,
    "gt_eq": lambda x, low: x >= low,
    "lt": lambda x, high: x < high,
    "lt_eq": lambda x, high: x <= high,
    "fixed_size": lambda x, size: len(x) == size,
    "element_bounds": lambda x, low, high: all(low <= part <= high for part in x),
    "lower_element_bounds": lambda x, low: all(low <= part for part in x),
    "upper_element_bounds": lambda x, high: all(part <= high for part in x),
    "not_empty": lambda x: len(x) > 0,
}
TYPES = {"double": float, "double_array": float, "string": str, "bool": bool}


def read(file=None):
    """Every parameter by its dotted name: the table that the file has of it."""
    file = Path(__file__).with_name("parameters.yaml") if file is None else Path(file)
    (tree,) = yaml.safe_load(file.read_text(encoding="utf-8")).values()
    return _flat(tree, "")


def _flat(tree, prefix):
    found = {}
    for name, part in tree.items():
        leaf = isinstance(part.get("type"), str)
        found.update({prefix + name: part} if leaf else _flat(part, f"{prefix}{name}."))
    return found


def problem(name, table, value):
    """Why a value must not be that of the parameter; empty where it may."""
    parts = value if table["type"].endswith("_array") else [value]
    kind = TYPES[table["type"]]
    if not isinstance(parts, (list, tuple)) and not hasattr(parts, "tolist"):
        return f"{name} = {value}: must be a {table['type']}"
    if not all(isinstance(part, kind) for part in parts):
        return f"{name} = {value}: must be a {table['type']}"
    if kind is float and not all(map(math.isfinite, parts)):
        return f"{name} = {value}: must be finite"
    for rule, given in (table.get("validation") or {}).items():
        if not RULES[rule.replace("<>", "")](value, *(given or [])):
            return f"{name} = {value}: must satisfy {rule.replace('<>', '')}({', '.join(map(str, given or []))})"
    return ""
