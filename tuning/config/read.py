"""Tables of TOML into objects, and what is wrong with them."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import agvjax
from agvjax.metric_table import metrics_of

from . import mapped, routes
from .codecs import CODECS
from .names import CLASSES, Classes
from .old import RETIRED
from .recipes import RECIPES, Recipe
from .settings import Config, Limit, default_limits
from .spellings import Toml, numbers


class Reader:
    """Builds objects from tables and collects what is wrong on the way."""

    def __init__(self, classes: Classes = CLASSES) -> None:
        self.faults: list[agvjax.Fault] = []
        self.notes: list[str] = []  # what was not read
        self.classes = classes
        self.plant: agvjax.Plant = agvjax.Decoupled()  # the scenario's
        self.deadzone: Mapping[str, agvjax.Element] = {}  # the scenario's
        self.limits: Mapping[str, Limit] = {}  # the usual ones of law and scenario

    def wrong(self, key: str, value: Toml, rule: str, source: str = "") -> None:
        """Note what is wrong."""
        word = repr(value) if isinstance(value, str) else value
        self.faults.append(agvjax.Fault(key, word, rule, source))

    def unknown(self, key: str, value: Toml, known: Sequence[str]) -> None:
        """Note a name that is not known."""
        near = difflib.get_close_matches(key.rpartition(".")[2], known, 1, 0.5)
        self.wrong(key, value, f"a known key; did you mean {near[0]}?" if near else f"one of {', '.join(known)}")

    def named(self, key: str, table: Mapping[str, Toml], known: Sequence[str]) -> dict[str, Toml]:
        """What has a known name in the table at `key`; names that are not known are noted."""
        for name in table:
            if name not in known:
                self.unknown(f"{key}.{name}", table[name], known)
        return {name: part for name, part in table.items() if name in known}

    def config(self, table: Mapping[str, Toml], default: Config) -> Config:
        """A configuration; its scenario first, then its law, since settings of the tools depend on them."""
        if "scenario" in table:
            default = dataclasses.replace(default, scenario=self.scenario(default.scenario, table["scenario"]))
        self.plant, self.deadzone = default.scenario.plant, default.scenario.deadzone
        if "controller" in table:
            law = self.read("controller", default.controller, table["controller"])
            default = dataclasses.replace(default, controller=law)
        self.limits = default_limits(metrics_of(default.scenario), default.controller.follows())
        rest = {name: part for name, part in table.items() if name not in ("scenario", "controller")}
        config, wrong = mapped.draws(self.fields("", default, rest), -1)
        self.faults += wrong
        return config

    def scenario(self, default: agvjax.Scenario, table: Toml) -> agvjax.Scenario:
        """A scenario; its plant first, which has the actuators and their nominal deadzones.

        Where no start is said, a path through points has its own.
        """
        if isinstance(table, Mapping) and "plant" in table:
            plant = self.read("scenario.plant", default.plant, table["plant"])
            nominal = default.deadzone if plant.actuators == default.plant.actuators else plant.deadzones()
            default = dataclasses.replace(default, plant=plant, deadzone=nominal)
            table = {name: part for name, part in table.items() if name != "plant"}
        self.plant = default.plant
        if not isinstance(table, Mapping) or "path" not in table:
            return self.fields("scenario", default, table)
        path, begun = self.read("scenario.path", default.path, table["path"]), table.get("start", {})
        default = dataclasses.replace(default, path=path)
        if isinstance(path, routes.MADE) and isinstance(begun, Mapping) and "position" not in begun:
            default = mapped.start(dataclasses.replace(default, start=mapped.begun(path)), 1)
        rest = {name: part for name, part in table.items() if name != "path"}
        return mapped.start(self.fields("scenario", default, rest), -1)

    def read(self, key: str, default: Any, table: Toml, choices: Sequence[str | int] = ()) -> Any:
        """What stands at `key`: the default, changed by the table."""
        if key in self.classes:
            return self.pick(key, default, table)
        if key in CODECS:
            return self.coded(key, default, table)
        if key.startswith("controller.") and (type(default) in (float, int) or isinstance(default, agvjax.Schedule)):
            begun = default if isinstance(default, agvjax.Schedule) else agvjax.Schedule()
            if isinstance(table, Mapping) and (begun is default or set(table) & set(vars(begun))):
                return self.fields(key, begun, table)
            default = 1.0 if isinstance(default, agvjax.Schedule) else default
        if default is None:
            self.wrong(key, table, "absent: it can be set in Python only")
            return default
        if dataclasses.is_dataclass(default):
            return self.fields(key, default, table)
        return self.plain(key, default, table, choices)

    def coded(self, key: str, default: Any, table: Toml) -> Any:
        """What its codec makes of the table; the default where that is wrong, so that nothing more is said of it."""
        codec, before = CODECS[key], len(self.faults)
        if not isinstance(table, codec.table):
            self.wrong(key, table, codec.rule)
            return default
        value = codec.read(self, key, default, table)
        return value if len(self.faults) == before else default

    def fields(self, key: str, default: Any, table: Toml) -> Any:
        """A dataclass from a table."""
        if not isinstance(table, Mapping):
            self.wrong(key, table, "a table")
            return default
        fields = {field.name: field for field in dataclasses.fields(default)}
        counts = [f.name for f in fields.values() if f.metadata.get("static") and type(f.default) is int]
        new = {}
        for name, value in table.items():
            part = f"{key}.{name}" if key else name
            if part in RETIRED:
                if value:
                    self.wrong(part, value, RETIRED[part])
            elif name not in fields:
                self.unknown(part, value, list(fields))
            elif name in counts and (type(value) is not int or value < 1):
                self.wrong(part, value, "a whole number >= 1")
            else:
                new[name] = self.read(part, getattr(default, name), value, fields[name].metadata.get("choices", ()))
        return dataclasses.replace(default, **new)

    def pick(self, key: str, default: Any, table: Toml) -> Any:
        """An object of the class that the table names."""
        classes = self.classes[key]
        table = {"type": table} if isinstance(table, str) else table
        if not isinstance(table, Mapping):
            self.wrong(key, table, "a table or the name of a type")
            return default
        kind = table.get("type")
        if kind is not None and (not isinstance(kind, str) or kind not in classes):
            self.wrong(f"{key}.type", kind, f"one of {', '.join(classes)}")
            return default
        rest = {name: value for name, value in table.items() if name != "type"}
        cls = type(default) if kind is None else classes[kind]
        if cls in RECIPES:
            return self.make(key, default, rest, RECIPES[cls])
        if kind is not None and type(default) is not cls:
            default = None if cls is None else cls()
            default = self.of_scenario(default)
        if default is None:
            for name, value in rest.items():
                self.wrong(f"{key}.{name}", value, "absent: this type has nothing to set")
            return None
        return self.fields(key, default, rest)

    def of_scenario(self, default: Any) -> Any:
        """What a law takes vehicle and deadzones for where nothing is said: the scenario's."""
        if isinstance(default, agvjax.Compensated):
            default = dataclasses.replace(default, compensation=self.of_scenario(default.compensation))
        if isinstance(default, (agvjax.Sampled, agvjax.Compensated)):
            return dataclasses.replace(default, vehicle=self.plant)
        if isinstance(default, (agvjax.Inverse, agvjax.Predictor)):
            return dataclasses.replace(default, believed=self.deadzone)
        return default

    def make(self, key: str, default: Any, table: Mapping[str, Toml], recipe: Recipe) -> Any:
        """An object that a recipe makes from the table."""
        self.named(key, table, list(recipe.keys))
        try:
            instance = recipe.make(table, self.notes.append)
        except agvjax.InputError as error:
            for fault in error.faults:
                self.wrong(f"{key}.{fault.key}", fault.value, fault.rule, fault.source)
            return default
        return instance

    def plain(self, key: str, default: Any, value: Toml, choices: Sequence[str | int] = ()) -> Any:
        """A number, array, word or flag."""
        if isinstance(default, (bool, str)):
            if type(value) is not type(default):
                self.wrong(key, value, "true or false" if isinstance(default, bool) else "a string")
                return default
        else:
            array = numbers(value)
            listed = key.startswith(("controller.", "scenario."))  # the rule of a leaf says whether it may be an array
            if array is None or (array.ndim and not listed):
                self.wrong(key, value, "a number or a list of numbers" if listed else "a number")
                return default
            if array.ndim:
                return array
            whole = isinstance(default, int) and np.isfinite(array) and array == np.round(array)
            value = int(array) if whole else float(array)
        if choices and value not in choices:
            words = [str(x) for x in choices]
            self.wrong(key, value, " or ".join(words) if len(words) < 3 else f"one of {', '.join(words)}")
            return default
        return value
