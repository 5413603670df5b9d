"""A configuration as TOML."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np
import tomli_w

import agvjax
from agvjax.metric_table import metrics_of

from . import mapped
from .codecs import CODECS
from .imports import classes, source
from .names import CLASSES
from .read import Reader
from .recipes import RECIPES
from .settings import VERSION, Config, Limit, default_limits
from .spellings import Toml, flat


class Writer:
    """Makes tables of objects; collects what cannot be written in TOML, and the files that classes come from."""

    def __init__(self, plant: agvjax.Plant, limits: Mapping[str, Limit] | None = None) -> None:
        self.faults: list[agvjax.Fault] = []
        self.imports: dict[str, str] = {}
        self.plant = plant  # the scenario's
        self.limits = {} if limits is None else limits  # the usual ones of law and scenario

    def write(self, key: str, value: Any, usual: Any) -> Toml:
        """What stands at `key`; `usual` is the default there."""
        if key in CLASSES:
            return self.typed(key, value, key)
        if key in CODECS:
            codec = CODECS[key]
            return codec.write(self, key, value) if isinstance(value, codec.setting) else value
        if isinstance(value, agvjax.Schedule):
            return self.fields(key, value)
        if not dataclasses.is_dataclass(usual):
            return value
        if type(value) is not type(usual):
            self.refuse(key, value, f"{type(usual).__name__}: no other class can stand here in TOML")
            return {}
        return self.fields(key, value)

    def typed(self, key: str, value: Any, place: str) -> Toml:
        """An object with the name of its class, of those that may stand in a `place`."""
        kind = None if value is None else type(value)
        names = [name for name, cls in CLASSES[place].items() if cls is kind]
        if not names and (file := source(type(value), place)):
            names = [type(value).__name__]
            self.imports[file.name] = file.digest
        if not names:
            self.refuse(key, value, f"of a class that TOML has a name for here: {', '.join(CLASSES[place])}, or one")
            names = [f"{type(value).__module__}.{type(value).__qualname__}"]
        recipe = RECIPES.get(type(value))
        fields = recipe.table(value) if recipe else self.fields(key, value) if dataclasses.is_dataclass(value) else {}
        return {"type": names[0], **fields} if fields or place == "elements" else names[0]

    def fields(self, key: str, value: Any) -> dict[str, Toml]:
        """The fields of a dataclass; None is left out where it has no name."""
        table = {}
        for field in dataclasses.fields(value):
            name, part = f"{key}.{field.name}" if key else field.name, getattr(value, field.name)
            usual = field.default if field.default_factory is dataclasses.MISSING else field.default_factory()
            if part is not None or usual is not None or name in CLASSES:
                table[field.name] = self.write(name, part, usual)
        return table

    def refuse(self, key: str, value: Any, rule: str) -> None:
        """Note what cannot be written."""
        self.faults.append(agvjax.Fault(key, type(value).__name__, rule))

    def plain(self, key: str, value: Toml) -> Toml:
        """Arrays, numbers and tuples as TOML has them."""
        if isinstance(value, Mapping):
            return {str(name): self.plain(f"{key}.{name}" if key else name, part) for name, part in value.items()}
        if isinstance(value, (np.ndarray, np.generic, jax.Array)):
            value = np.asarray(value).tolist()
        if isinstance(value, (list, tuple)):
            return [self.plain(key, part) for part in value]
        if not isinstance(value, (str, int, float)):
            self.refuse(key, value, "what TOML has a word for: a number, a string, true or false, a list, a table")
        return value


def table_of(config: Config, settings: bool = False) -> tuple[dict[str, Toml], Writer]:
    """The table of a configuration, or of all but its law, its scenario and its imports; and its writer."""
    limits = default_limits(metrics_of(config.scenario), config.controller.follows())
    config, wrong = mapped.draws(dataclasses.replace(config, scenario=mapped.start(config.scenario, 1)), 1)
    writer = Writer(config.scenario.plant, limits)
    writer.faults += wrong
    left, default = {"imports", "controller", "scenario"} if settings else {"imports"}, vars(Config())
    parts = {name: part for name, part in vars(config).items() if name not in left}
    table = {name: writer.write(name, part, default[name]) for name, part in parts.items()}
    return writer.plain("", table), writer


def dump(config: Config, strict: bool = True) -> str:
    """The configuration as TOML; `load` reads it back to the same.

    Args:
        config: of which law and plant may be of a class that TOML has no name for where it is not `strict`.
        strict: whether it will be read back.

    Raises:
        agvjax.InputError: TOML has no words for a part of it; lists every such key and what may stand there.
    """
    table, writer = table_of(config)
    imports = {**config.imports, **writer.imports}
    if strict and (faults := writer.faults or _changed(config, table, imports)):
        raise agvjax.InputError(faults)
    return _text(table, imports)


def _text(table: Mapping[str, Toml], imports: Mapping[str, str]) -> str:
    return tomli_w.dumps({"version": VERSION} | ({"imports": imports} if imports else {}) | dict(table))


def _changed(config: Config, table: dict[str, Toml], imports: Mapping[str, str]) -> list[agvjax.Fault]:
    """What would be refused, or mean something else, when it is read back."""
    reader = Reader(classes(imports))
    again = reader.config(table, Config())
    faults = reader.faults or agvjax.faults(again)
    if faults:
        return faults
    before, after = (dict(flat(part, ())) for part in (table, table_of(again)[0]))
    changed = [name for name in before | after if name not in before or before[name] != after.get(name)]
    rule = "what TOML has words for: read back it would be {}"
    return [agvjax.Fault(n, before.get(n, "absent"), rule.format(after.get(n, "absent"))) for n in changed]


def gains_table(controller: agvjax.Law) -> str:
    """`gains.toml`: the controller, which `--config` reads back; of a law that TOML has no name for its numbers."""
    writer = Writer(agvjax.Decoupled())
    table = writer.plain("", {"controller": writer.write("controller", controller, controller)})
    if not writer.faults:
        return _text(table, writer.imports)
    return _text({"gains": {name: np.asarray(x).tolist() for name, x in agvjax.leaves(controller).items()}}, {})
