"""TOML files and `--set` into a configuration and back; one error that names every bad key."""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

import agvjax
from agvjax.actuators import ELEMENTS

from .classes import CLASSES
from .ensemble import Between, Correlated, Correlation, Distribution, OneOf, Span, Times, correlated, default_draws
from .free import tunable
from .objective import metrics_of
from .reader import DRAWS, Reader
from .recordings import RECIPES, Column
from .rules import problems
from .settings import VERSION, Bound, Config, Limit, Weights, default_over

VEHICLES, BUILT_IN = Path(__file__).with_name("vehicles"), ("unicycle", "car", "robot")


def load(
    files: Sequence[str], overrides: Sequence[str], command: str = "tune", more: Mapping[str, Any] | None = None
) -> Config:
    """The defaults, each file, each `key=value`, then `more` by dotted key; "simulate" needs no tuning problem.

    Raises:
        agvjax.InputError: lists every bad key, its value and the rule.
    """
    table: dict[str, Any] = {}
    for name in files:
        try:
            file = VEHICLES / f"{name}.toml" if name in BUILT_IN else Path(name)
            _merge(table, tomllib.loads(file.read_text(encoding="utf-8-sig")))
        except (OSError, ValueError, RecursionError) as error:
            rule = f"a readable TOML file, or one of {', '.join(BUILT_IN)} ({error})"
            raise agvjax.InputError([agvjax.Problem("--config", name, rule)]) from error
    for text in overrides:
        _merge(table, _override(text))
    for key, value in (more or {}).items():
        _merge(table, _nested(key, value))
    return resolve(table, command)


def resolve(table: Mapping[str, Any], command: str = "tune") -> Config:
    """The configuration that a table of TOML means.

    Raises:
        agvjax.InputError: lists every bad key, its value and the rule.
    """
    version = table.get("version", VERSION)
    if version != VERSION:
        raise agvjax.InputError(
            [agvjax.Problem("version", repr(version), f"{VERSION}, the file format of this release")]
        )
    reader = Reader()
    first = {key: table[key] for key in ("scenario",) if key in table}  # a computer takes its vehicle for this one
    config = fitted(reader.fields("", Config(), first | dict(table)), table)
    found = reader.problems
    if config.ensemble.correlation is not None and not found:
        config, found = tied(config)
    found = found + problems(config, command)
    if found:
        raise agvjax.InputError(found)
    return config


def tied(config: Config) -> tuple[Config, list[agvjax.Problem]]:
    """The draws that are correlated, tied together; and what is wrong with that."""
    ensemble = config.ensemble
    assert ensemble.correlation is not None
    several = [n for n in ensemble.correlation.leaves if np.ndim(agvjax.leaves(config.scenario).get(n, 0.0))]
    try:
        if several:
            raise ValueError(f"{', '.join(several)} must each be a single number")
        draws = correlated(ensemble.draws, ensemble.correlation)
    except ValueError as error:
        rule = f"correlations of leaves in [ensemble.draws] ({error})"
        return config, [agvjax.Problem("ensemble.correlation", f"{len(ensemble.correlation.leaves)} leaves", rule)]
    return dataclasses.replace(config, ensemble=dataclasses.replace(ensemble, draws=draws)), []


def fitted(config: Config, given: Mapping[str, Any]) -> Config:
    """The defaults that hang on law and plant, where the table gives nothing of its own."""
    plant, known = config.scenario.plant, metrics_of(config.scenario.plant)

    def own(section: str, key: str) -> Any:
        table = given.get(section, {})
        return table.get(key) if isinstance(table, Mapping) else None

    heading = getattr(plant, "commands_heading", True)
    wanted = own("tune", "limits") if isinstance(own("tune", "limits"), Mapping) else {}
    limits = {name: limit for name, limit in config.tune.limits.items() if name in known or name in wanted}
    gains = config.tune.gains or tunable(config.controller, heading)
    config = dataclasses.replace(config, tune=dataclasses.replace(config.tune, gains=gains, limits=limits))
    if own("sweep", "metrics") is None:
        metrics = tuple(name for name in config.sweep.metrics if name in known)
        config = dataclasses.replace(config, sweep=dataclasses.replace(config.sweep, metrics=metrics))
    if "position" in plant.actuators:
        return config
    if own("ensemble", "draws") is None:
        ensemble = dataclasses.replace(config.ensemble, draws=default_draws(plant.actuators))
        config = dataclasses.replace(config, ensemble=ensemble)
    if own("sweep", "over") is None:
        sweep = dataclasses.replace(config.sweep, over=default_over(plant.actuators[0]))
        config = dataclasses.replace(config, sweep=sweep)
    return config


def _override(text: str) -> Any:
    key, equals, value = text.partition("=")
    if not equals or not key.strip() or "\n" in text:
        raise agvjax.InputError([agvjax.Problem("--set", repr(text), "key=value")])
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


def dump(config: Config) -> str:
    """The resolved configuration as TOML; `load` reads it back to the same."""
    return tomli_w.dumps(_fields("", config))


def _table(key: str, value: Any) -> Any:
    if isinstance(value, (Between, Times)):
        return {type(value).__name__.lower(): list(value)}
    if isinstance(value, OneOf):
        return {"one_of": list(value.values)}
    if isinstance(value, Correlated):
        return _table(key, value.marginal)
    if isinstance(value, Column):
        more = {name: x for name, x in (("unit", value.unit), ("factor", value.factor)) if x not in ("", 1.0)}
        return {"column": value.column, **more} if more else value.column
    if isinstance(value, Correlation):
        return {"leaves": list(value.leaves), "matrix": [list(row) for row in value.matrix]}
    if isinstance(value, Distribution):
        return {"distribution": value.name, **value.parameters, "times": value.times}
    if isinstance(value, Span):
        return _table(key, value.draw) | (
            {"points": value.points} if value.points and not isinstance(value.draw, OneOf) else {}
        )
    if isinstance(value, (Weights, Limit, Bound)):
        given = {n: x for n, x in vars(value).items() if x != getattr(type(value)(), n)}
        return given or {"value": value.value} if isinstance(value, Bound) else given
    if key.startswith("tune.choices."):
        return value
    if key in CLASSES:
        known = [n for n, c in CLASSES[key].items() if (value is None if c is None else type(value) is c)]
        kind = known[0] if known else f"{type(value).__module__}.{type(value).__qualname__}"  # the user's own
        recipe = RECIPES.get(type(value))
        fields = {} if value is None else recipe.table(value) if recipe else _fields(key, value)
        return {"type": kind, **fields} if fields else kind
    if dataclasses.is_dataclass(value):
        return _fields(key, value)
    if isinstance(value, agvjax.Chain):
        kinds = {cls: kind for kind, cls in ELEMENTS.items()}
        return {name: {"type": kinds[type(part)], **_fields(f"{key}.{name}", part)} for name, part in value.items()}
    if isinstance(value, Mapping):
        return {name: _table(f"{key}.{name}", part) for name, part in value.items()}
    if isinstance(value, tuple):
        return [_table(key, part) for part in value]
    plain = np.asarray(value)
    return value if isinstance(value, (str, bool)) else plain.tolist()


def _fields(key: str, value: Any) -> dict[str, Any]:
    parts = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
    named = {
        n: _table(f"{key}.{n}" if key else n, p) for n, p in parts.items() if p is not None or f"{key}.{n}" in CLASSES
    }
    return named


def gains_table(controller: Any) -> str:
    """`gains.toml`: the controller, which `--config` reads back; of a law of the user's own its numbers."""
    if type(controller) in CLASSES["controller"].values():
        return tomli_w.dumps({"version": VERSION, "controller": _table("controller", controller)})
    numbers = {name: np.asarray(x).tolist() for name, x in agvjax.leaves(controller).items()}
    return tomli_w.dumps({"version": VERSION, "gains": numbers})
