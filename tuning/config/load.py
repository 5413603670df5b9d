"""TOML files and `--set` into a configuration and back; one error that names every bad key."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import agvjax

from .complete import complete
from .read import DRAWS, Reader
from .rules import Rules, faults
from .settings import VERSION, Config

PRESETS, BUILT_IN = Path(__file__).with_name("presets"), ("unicycle", "car", "robot")


def load(
    files: Sequence[str],
    overrides: Sequence[str] = (),
    rules: Rules = faults,
    more: Mapping[str, Any] | None = None,
) -> Config:
    """The defaults, each file, each `key=value`, then `more` by dotted key; completed and checked.

    Args:
        files: TOML files, or names of presets.
        overrides: settings as `key=value`.
        rules: what is wrong with a configuration; every room has such a function for what it needs.
        more: values by dotted key.

    Raises:
        agvjax.InputError: lists every bad key, its value and the rule.
    """
    table: dict[str, Any] = {}
    for name in files:
        try:
            file = PRESETS / f"{name}.toml" if name in BUILT_IN else Path(name)
            _merge(table, tomllib.loads(file.read_text(encoding="utf-8-sig")))
        except (OSError, ValueError, RecursionError) as error:
            rule = f"a readable TOML file, or one of {', '.join(BUILT_IN)} ({error})"
            raise agvjax.InputError([agvjax.Fault("--config", name, rule)]) from error
    for text in overrides:
        _merge(table, _override(text))
    for key, value in (more or {}).items():
        _merge(table, _nested(key, value))
    return resolve(table, rules)


def resolve(table: Mapping[str, Any], rules: Rules = faults) -> Config:
    """The configuration that a table of TOML means, completed and checked by `rules`.

    Raises:
        agvjax.InputError: lists every bad key, its value and the rule.
    """
    version = table.get("version", VERSION)
    if version != VERSION:
        raise agvjax.InputError([agvjax.Fault("version", repr(version), f"{VERSION}, the file format of this release")])
    reader = Reader()
    first = {key: table[key] for key in ("scenario",) if key in table}  # a computer takes its vehicle for this one
    config = complete(reader.fields("", Config(), first | dict(table)))
    found = reader.faults + rules(config)
    if found:
        raise agvjax.InputError(found)
    return config


def _override(text: str) -> Any:
    key, equals, value = text.partition("=")
    if not equals or not key.strip() or "\n" in text:
        raise agvjax.InputError([agvjax.Fault("--set", repr(text), "key=value")])
    try:
        parsed = tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        parsed = value.strip()  # a bare word is a string
    return _nested(key.strip(), parsed)


def _nested(key: str, value: Any) -> Any:
    for part in reversed(key.split(".")):
        value = {part: value}
    return value


def _merge(into: dict[str, Any], table: Mapping[str, Any]) -> None:
    for key, value in table.items():
        if isinstance(value, Mapping) and isinstance(into.get(key), str):
            into[key] = {"type": into[key]}  # a name stands for its table
        if isinstance(value, Mapping) and isinstance(into.get(key), dict) and not _another(into[key], value):
            _merge(into[key], value)
        else:
            into[key] = value


def _another(before: Mapping[str, Any], table: Mapping[str, Any]) -> bool:
    """Whether this is a table of another type, or a whole distribution: nothing of the one before it means anything."""
    if "type" in before or "type" in table:
        return before.get("type", table.get("type")) != table.get("type", before.get("type"))
    return all(any(not isinstance(one.get(kind, True), bool) for kind in DRAWS) for one in (before, table))
