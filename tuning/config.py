"""TOML files and `--set` into objects and back; one error that names every bad key.

The names of classes live here and nowhere else: `type = "circle"` in a table, or `filter = "literal"` where a class has
nothing to set.
"""

from __future__ import annotations

import dataclasses
import difflib
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

import agvjax
from agvjax.leaves import children

from .ensemble import Between, Draw, Times, default_draws
from .free import tunable
from .objective import METRICS
from .settings import CHOICES, VERSION, Config, problems

LAWS = {
    "neuro_backstepping": agvjax.NeuroBackstepping,
    "backstepping": agvjax.Backstepping,
    "full_weight": agvjax.FullWeightBackstepping,
    "osfc": agvjax.OSFC,
    "asmc": agvjax.ASMC,
    "dfc": agvjax.DFC,
    "ftsmc": agvjax.FTSMC,
    "super_twisting_ftsmc": agvjax.SuperTwistingFTSMC,
}
FILTERS = {"command": agvjax.CommandFilter, "literal": agvjax.LiteralFilter, "none": agvjax.NoFilter}
CLASSES: dict[str, dict[str, Any]] = {
    "controller": LAWS | {"event_triggered": agvjax.EventTriggered, "fractional": agvjax.FractionalBackstepping},
    "controller.inner": LAWS,
    "controller.filter": FILTERS,
    "controller.inner.filter": FILTERS,
    "scenario.plant": {"decoupled": agvjax.Decoupled},
    "scenario.plant.yaw_rate": {"delivered": agvjax.DeliveredYawRate, "kinematic": agvjax.KinematicYawRate},
    "scenario.plant.coupling": {"turned_velocity": agvjax.TurnedVelocity, "forward_speed": agvjax.ForwardSpeed},
    "scenario.path": {
        "dumbbell": agvjax.Dumbbell,
        "circle": agvjax.Circle,
        "lemniscate": agvjax.Lemniscate,
        "line": agvjax.Line,
    },
    "scenario.heading": {
        "default": None,
        "bearing": agvjax.Bearing,
        "bearing_raw": agvjax.RawBearing,
        "bearing_swapped": agvjax.SwappedBearing,
        "tangent": agvjax.Tangent,
    },
    "scenario.disturbance": {
        "cosine": agvjax.Cosine,
        "none": agvjax.NoDisturbance,
        "step": agvjax.Step,
        "cosine_sum": agvjax.CosineSum,
    },
}


class _Reader:
    """Builds objects from tables and collects what is wrong on the way."""

    def __init__(self) -> None:
        self.problems: list[agvjax.Problem] = []

    def wrong(self, key: str, value: Any, rule: str, source: str = "") -> None:
        self.problems.append(
            agvjax.Problem(key, value if isinstance(value, (int, float)) else repr(value), rule, source)
        )

    def unknown(self, key: str, value: Any, known: Sequence[str]) -> None:
        name = key.rpartition(".")[2]
        near = difflib.get_close_matches(name, known, 1, 0.5)
        self.wrong(key, value, f"a known key; did you mean {near[0]}?" if near else f"one of {', '.join(known)}")

    def build(self, key: str, default: Any, given: Any) -> Any:
        """The object at `key`: the default with what the table gives."""
        if key in CLASSES:
            return self.pick(key, default, given)
        if default is None:
            self.wrong(key, given, "absent: it can be set in Python only")
            return default
        if key == "ensemble.draws":
            return self.draws(key, given)
        if key == "tune.bounds":
            return self.bounds(key, given)
        if key.endswith((".Pi_hat", ".Pi_psi_hat")) and isinstance(given, Mapping):
            return self.fields(key, agvjax.KnownSlopes(), given)
        if dataclasses.is_dataclass(default) and not isinstance(default, type):
            return self.fields(key, default, given)
        if isinstance(default, dict):
            return self.mapping(key, default, given)
        return self.scalar(key, default, given)

    def fields(self, key: str, default: Any, given: Any) -> Any:
        if not isinstance(given, Mapping):
            self.wrong(key, given, "a table")
            return default
        known = [f.name for f in dataclasses.fields(default)]
        new = {}
        for name, value in given.items():
            part = f"{key}.{name}" if key else name
            if name not in known:
                self.unknown(part, value, known)
            else:
                new[name] = self.build(part, getattr(default, name), value)
        return dataclasses.replace(default, **new)

    def pick(self, key: str, default: Any, given: Any) -> Any:
        classes = CLASSES[key]
        if isinstance(given, str):
            given = {"type": given}
        if not isinstance(given, Mapping):
            self.wrong(key, given, "a table or the name of a type")
            return default
        kind = given.get("type")
        if kind is not None and (not isinstance(kind, str) or kind not in classes):
            self.wrong(f"{key}.type", kind, f"one of {', '.join(classes)}")
            return default
        if kind is not None and (classes[kind] is None or type(default) is not classes[kind]):
            default = None if classes[kind] is None else classes[kind]()
        rest = {name: value for name, value in given.items() if name != "type"}
        if default is None:
            for name, value in rest.items():
                self.wrong(f"{key}.{name}", value, "absent: this type has nothing to set")
            return None
        return self.fields(key, default, rest)

    def mapping(self, key: str, default: dict[str, Any], given: Any) -> Any:
        if not isinstance(given, Mapping):
            self.wrong(key, given, "a table")
            return default
        if key == "tune.options":
            return dict(given)
        if key == "tune.limits":
            for name in set(given) - set(METRICS):
                self.unknown(f"{key}.{name}", given[name], tuple(METRICS))
            return default | {name: self.scalar(f"{key}.{name}", 1.0, value) for name, value in given.items()}
        for name in set(given) - set(default):
            self.unknown(f"{key}.{name}", given[name], tuple(default))
        return {n: self.build(f"{key}.{n}", part, given[n]) if n in given else part for n, part in default.items()}

    def scalar(self, key: str, default: Any, given: Any) -> Any:
        if isinstance(default, bool) or isinstance(default, str):
            if type(given) is not type(default):
                self.wrong(key, given, "true or false" if isinstance(default, bool) else "a string")
                return default
            if given not in CHOICES.get(key, (given,)):
                self.wrong(key, given, f"one of {', '.join(CHOICES[key])}")
                return default
            return given
        if isinstance(default, tuple):
            if not isinstance(given, list) or not given or not all(isinstance(x, str) for x in given):
                self.wrong(key, given, "a list of names")
                return default
            return tuple(given)
        array = _numbers(given)
        listed = key.startswith(("controller.", "scenario."))  # where a leaf may be an array its own rule says which
        if array is None or (array.ndim and not listed):
            self.wrong(key, given, "a number or a list of numbers" if listed else "a number")
            return default
        if array.ndim:
            return array.astype(float)
        whole = isinstance(default, int) and np.isfinite(array) and array == np.round(array)
        return int(array) if whole else float(array)

    def draws(self, key: str, given: Any) -> dict[str, Draw]:
        kinds = {"between": Between, "times": Times}
        found: dict[str, Draw] = {}
        before = len(self.problems)
        if not isinstance(given, Mapping):
            self.wrong(key, given, "a table")
            return found
        for name, draw in _flat(given, kinds):
            kind, pair = next(iter(draw.items())) if isinstance(draw, Mapping) and len(draw) == 1 else ("", [])
            if kind not in kinds or not _is_pair(pair):
                rule = "{ between = [low, high] } or { times = [low, high] } with low <= high"
                self.wrong(f"{key}.{name}", draw, rule)
            else:
                found[name] = kinds[kind](float(pair[0]), float(pair[1]))
        return found if len(self.problems) == before else default_draws()

    def bounds(self, key: str, given: Any) -> dict[str, tuple[float, float]]:
        if not isinstance(given, Mapping):
            self.wrong(key, given, "a table")
            return {}
        for name, pair in given.items():
            if not _is_pair(pair):
                self.wrong(f"{key}.{name}", pair, "[low, high] with low <= high")
        return {name: (float(p[0]), float(p[1])) for name, p in given.items() if _is_pair(p)}


def _numbers(given: Any) -> np.ndarray | None:
    """A number or a regular list of numbers as an array; None for anything else."""
    if isinstance(given, bool) or not isinstance(given, (int, float, list)):
        return None
    try:
        array = np.asarray(given)
        return array.astype(float) if array.dtype.kind in "ifO" else None
    except (ValueError, TypeError, OverflowError):  # unequal lists, strings among numbers, integers beyond any float
        return None


def _is_pair(pair: Any) -> bool:
    array = _numbers(pair) if isinstance(pair, list) else None
    return array is not None and array.shape == (2,) and bool(array[0] <= array[1])


def _flat(table: Mapping[str, Any], ends: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    """Dotted keys, quoted or not, as one flat list."""
    rows = []
    for name, value in table.items():
        nested = isinstance(value, Mapping) and not set(value) & set(ends)
        rows += _flat(value, ends, f"{prefix}{name}.") if nested and value else [(prefix + name, value)]
    return rows


def load(files: Sequence[str], overrides: Sequence[str], command: str = "tune") -> Config:
    """The defaults, then each file, then each `key=value`; what only tuning needs is checked for `command` "tune".

    Raises:
        agvjax.InputError: lists every bad key, its value and the rule.
    """
    table: dict[str, Any] = {}
    for name in files:
        try:
            _merge(table, tomllib.loads(Path(name).read_text(encoding="utf-8-sig")))
        except (OSError, ValueError, RecursionError) as error:
            raise agvjax.InputError([agvjax.Problem("--config", name, f"a readable TOML file ({error})")]) from error
    for text in overrides:
        _merge(table, _override(text))
    version = table.get("version", VERSION)
    if version != VERSION:
        raise agvjax.InputError(
            [agvjax.Problem("version", repr(version), f"{VERSION}, the file format of this release")]
        )
    reader = _Reader()
    config = reader.fields("", Config(), table)
    if not config.tune.gains:
        config = dataclasses.replace(config, tune=dataclasses.replace(config.tune, gains=tunable(config.controller)))
    found = reader.problems + problems(config, command)
    if found:
        raise agvjax.InputError(found)
    return config


def _override(text: str) -> Any:
    key, equals, value = text.partition("=")
    if not equals or not key.strip() or "\n" in text:
        raise agvjax.InputError([agvjax.Problem("--set", repr(text), "key=value")])
    try:
        parsed = tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        parsed = value.strip()  # a bare word is a string
    for part in reversed(key.strip().split(".")):
        parsed = {part: parsed}
    return parsed


def _merge(into: dict[str, Any], table: Mapping[str, Any]) -> None:
    for key, value in table.items():
        if isinstance(value, Mapping) and isinstance(into.get(key), dict):
            _merge(into[key], value)
        else:
            into[key] = value


def dump(config: Config) -> str:
    """The resolved configuration as TOML; `load` reads it back to the same."""
    return tomli_w.dumps(_fields("", config))


def _table(key: str, value: Any) -> Any:
    if isinstance(value, (Between, Times)):
        return {type(value).__name__.lower(): list(value)}
    if key in CLASSES:
        kind = next(
            n for n, c in CLASSES[key].items() if (c is None and value is None) or (c is not None and type(value) is c)
        )
        fields = {} if value is None else _fields(key, value)
        return {"type": kind, **fields} if fields else kind
    if dataclasses.is_dataclass(value):
        return _fields(key, value)
    if isinstance(value, Mapping):
        return {name: _table(f"{key}.{name}", part) for name, part in value.items()}
    if isinstance(value, tuple):
        return list(value)
    plain = np.asarray(value)
    return value if isinstance(value, (str, bool)) else plain.tolist()


def _fields(key: str, value: Any) -> dict[str, Any]:
    parts = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
    named = {
        n: _table(f"{key}.{n}" if key else n, p) for n, p in parts.items() if p is not None or f"{key}.{n}" in CLASSES
    }
    return named


def gains_table(controller: Any) -> str:
    """`gains.toml`: the scalar gains of a controller, which `--config` reads back."""
    scalars = {
        n: float(x) for n, x in children(controller).items() if not dataclasses.is_dataclass(x) and np.ndim(x) == 0
    }
    return tomli_w.dumps({"version": VERSION, "controller": scalars})
