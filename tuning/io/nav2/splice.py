"""Values put into the text of a YAML file, each in its place or on a line of its own; nothing else is touched."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from yaml.nodes import MappingNode, ScalarNode

from agvjax import Fault, InputError

from ..yaml_text import BLOCKS, Document, Leaf, Path, parse, plain
from .section import NODE

DIGITS = 6  # significant ones of a number that is written


class _Edit(NamedTuple):
    """Characters of a text, from start to end, and what comes in their place."""

    start: int
    end: int
    text: str


def spliced(
    document: Document, plugin: Leaf, found: Mapping[str, Leaf], wanted: Mapping[str, float | bool], controller: str
) -> str:
    """The text with the values wanted in a section, by their names there.

    Args:
        document: the text.
        plugin: the value beside which parameters are written that are not there yet.
        found: the section's values.
        wanted: what they shall be.
        controller: whose section it is, for messages.

    Raises:
        agvjax.InputError: a value would change at another place too.
    """
    edits, added, faults = [], {}, []
    for name, value in wanted.items():
        leaf = found.get(name)
        if leaf is not None and _same(leaf, value):
            continue
        if leaf is None or not leaf.own:
            added[name] = written(value)
        elif others := [other for other in document.others(leaf) if NODE in other.path]:
            faults.append(_shared(f"{controller}.{name}", value, leaf, others))
        else:
            edits.append(_Edit(leaf.start, leaf.end, _like(leaf, value)))
    faults += [
        _homeless(f"{controller}.{name}", added[name], others) for name in added for others in _homes(document, plugin)
    ]
    if faults:
        raise InputError(faults)
    edits += [_addition(document.text, plugin, plugin.table, added)] if added and plugin.table else []
    text = _applied(document.text, edits)
    _guard(document, text, {leaf.path for name, leaf in found.items() if name in wanted}, controller)
    return text


def written(value: float | bool) -> str:
    """A value as YAML and ROS read it: true, false, or a number with a point."""
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    return np.format_float_positional(float(value), DIGITS, unique=False, fractional=False, trim="0")


def _same(leaf: Leaf, value: float | bool) -> bool:
    """Whether the value already stands there, to the digits that would be written."""
    old = plain(leaf.node)
    if isinstance(value, (bool, np.bool_)) or not isinstance(old, float):
        return isinstance(old, bool) and old == bool(value)
    return np.isfinite(old) and written(old) == written(value)


def _like(leaf: Leaf, value: float | bool) -> str:
    """The value, with the old one's capital letter; in an empty place with a space before it."""
    text = written(value)
    old = str(leaf.node.value)
    text = text.capitalize() if isinstance(value, (bool, np.bool_)) and old[:1].isupper() else text
    return f" {text}" if leaf.start == leaf.end else text


def _shared(key: str, value: float | bool, leaf: Leaf, others: list[Leaf]) -> Fault:
    """A value whose text is that of others."""
    names = ", ".join(".".join(other.path) for other in others)
    rule = f"written out for this controller: line {leaf.line}, by its anchor, is also the value of {names}"
    return Fault(key, written(value), rule)


def _homes(document: Document, plugin: Leaf) -> list[list[Path]]:
    """The other paths to the table that parameters would be added to, in a list; empty without any.

    A table that only holds an anchor, outside of every node, is nobody's.
    """
    paths = [path for path in document.tables[id(plugin.table)] if path != plugin.path[: len(path)] and NODE in path]
    return [paths] if paths else []


def _homeless(key: str, text: str, others: list[Path]) -> Fault:
    """A parameter that would be added to a table of others too."""
    names = ", ".join(".".join(path) for path in others)
    return Fault(key, text, f"in a table of its own: the one it would be added to is also that of {names}")


def _addition(text: str, plugin: Leaf, table: MappingNode, added: Mapping[str, str]) -> _Edit:
    """Parameters on lines of their own below the plugin's, or before all else of a table that has it from elsewhere."""
    first = plugin.key if plugin.own and plugin.key is not None else table.value[0][0]
    key = str(plugin.key.value) if isinstance(plugin.key, ScalarNode) else ""
    prefix = key.rpartition(".")[0] + "." if "." in key else ""
    quote = first.style if plugin.own and first.style in ("'", '"') else ""  # JSON is YAML with quoted keys
    entries = [f"{quote}{prefix}{name}{quote}: {value}" for name, value in added.items()]
    behind = plugin.own and not (isinstance(plugin.node, ScalarNode) and plugin.node.style in BLOCKS)
    at = plugin.end if behind else first.start_mark.index
    if table.flow_style:
        return _Edit(at, at, ", " + ", ".join(entries) if behind else ", ".join(entries) + ", ")
    line = text.find("\n", at)
    end = "\r\n" if line > 0 and text[line - 1] == "\r" else "\n"
    indent = " " * first.start_mark.column
    if not behind:
        return _Edit(at, at, "".join(f"{entry}{end}{indent}" for entry in entries))
    at = len(text) if line < 0 else line - (end == "\r\n")
    return _Edit(at, at, "".join(f"{end}{indent}{entry}" for entry in entries))


def _applied(text: str, edits: list[_Edit]) -> str:
    for edit in sorted(edits, reverse=True):
        text = text[: edit.start] + edit.text + text[edit.end :]
    return text


def _guard(document: Document, text: str, changed: set[Path], controller: str) -> None:
    """Read again what was written: every other parameter must be what it was.

    Raises:
        agvjax.InputError: it is not, or it cannot be read: the file has a form that this program does not write.
    """
    try:
        after = {leaf.path: leaf.node.value for leaf in parse(text).leaves}
    except ValueError:
        after = {}
    before = [leaf for leaf in document.leaves if NODE in leaf.path and leaf.path not in changed]
    if any(after.get(leaf.path) != leaf.node.value for leaf in before):
        rule = "written by hand: the file has a form in which this program would change more than that"
        raise InputError([Fault("controller", controller, rule)])
