"""TOML files and `--set` into a configuration and back; one error that names every bad key."""

from __future__ import annotations

import importlib
import re
import tomllib
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import agvjax

from ..io.files import text
from ..io.plain import DEEPEST, toml
from .imports import claim, classes, load_files
from .old import present, warned
from .read import Reader
from .rules import Rules, checked, faults
from .settings import VERSION, Config
from .spellings import KINDS, NAMED, Toml, flat

SECTIONS = ("scenario", "scenario.start", "simulate", "criteria", "ensemble", "tune", "tune.search", "pareto", "speed")
SECTIONS += ("margins", "sweep", "certify", "identify", "apply", "watch")
VEHICLES = ("unicycle", "car", "robot")
SOURCES = {  # where the numbers of a path and of a disturbance come from: one of these
    "scenario.path": ("file", "points", "along"),
    "scenario.disturbance": ("file", "times"),
}
ROUNDED = ("radius", "tolerance")  # of corners: one takes the place of the other
KEPT = ("type", "half_width", "limits")  # of a path whose points are others: what is of the vehicle and its corridor
PRESETS = Path(__file__).with_name("presets")
BUILT_IN = (*VEHICLES, "base", "ackermann", "forklift", "paper-goal", "all-gains")


def load(
    files: Sequence[str],
    overrides: Sequence[str] = (),
    rules: Rules | str = faults,
    more: Mapping[str, Toml] | None = None,
    imports: Sequence[str] = (),
    note: Callable[[str], None] | None = None,
) -> Config:
    """The defaults, each file, each `key=value`, then `more` by dotted key; completed and checked.

    Where nothing says a scenario and a file has a controller, as `gains.toml` does, `config.toml` beside that file is
    read before all others.

    Args:
        files: TOML files, or names of presets.
        overrides: settings as `key=value`.
        rules: what is wrong with a configuration; every room has such a function for what it needs.
        more: values by dotted key.
        imports: files of Python with classes of one's own, which TOML then knows by name; they are executed.
        note: told of every name that is old and still read, of a file that is read besides, and of what is not read
            in a file; by default they are warnings.

    Raises:
        agvjax.InputError: lists every bad key, its value and the rule.
    """
    loaded, table = load_files(imports), {}
    read = {name: parsed(name) for name in files}
    said_here = [*map(_override, overrides), *(_nested(key.split("."), x) for key, x in (more or {}).items())]
    parts = [*_started_elsewhere(read, said_here, note or said), *said_here]
    built_in = [name in BUILT_IN for name in read] + [False] * len(said_here)
    if not any("scenario" in part for part in read.values()):  # what is said beside files counts on top of theirs
        whole = _beside(read, any("scenario" in part for part in said_here), note or said)
        parts, built_in = [*whole, *parts], [False] * len(whole) + built_in
    for number, part in enumerate(parts):
        claim(part, loaded)
        _merge(table, _plain_names(present(part, note or warned), table), all(built_in[:number]))
    return resolve(table, rules, imports, note or said)


def said(text: str) -> None:
    """What a caller in Python should know."""
    warnings.warn(text, UserWarning, stacklevel=3)


def _started_elsewhere(
    read: Mapping[str, dict[str, Toml]], others: Sequence[dict[str, Toml]], note: Callable[[str], None]
) -> list[dict[str, Toml]]:
    """The tables of files, those of presets without their start where another lays a path of its own through points."""

    def part(table: Mapping[str, Toml], name: str) -> Mapping[str, Toml]:
        scenario = table.get("scenario")
        found = scenario.get(name) if isinstance(scenario, Mapping) else None
        return found if isinstance(found, Mapping) else {}

    own = [*(table for name, table in read.items() if name not in BUILT_IN), *others]
    laid = any({"file", "points"} & set(part(table, "path")) for table in own)
    told = any("position" in part(table, "start") for table in own)
    begun = [name for name, table in read.items() if laid and not told and name in BUILT_IN and part(table, "start")]
    for name in begun:
        note(f"the start of {name} is of its own path: without scenario.start vehicles start where scenario.path does")
    return [
        {**table, "scenario": {key: x for key, x in table["scenario"].items() if key != "start" or name not in begun}}
        if "scenario" in table
        else table
        for name, table in read.items()
    ]


def _beside(files: Mapping[str, Toml], told: bool, note: Callable[[str], None]) -> list[dict[str, Toml]]:
    """The configurations beside files that have a controller and do not say which vehicle it is for.

    Where there is none, that is no news if settings have `told` of a scenario.
    """
    tables = []
    for name, table in files.items():
        if "controller" not in table or Path(name).name == "config.toml":
            continue
        whole, text = Path(name).with_name("config.toml"), f"{name} has a controller and no scenario"
        if whole.is_file():
            note(f"{text}: what it leaves open is read from {whole}; another --config says another scenario")
            tables.append(parsed(str(whole)))
        elif not told and set(table) <= {"version", "imports", "controller"}:
            note(f"{text}: it is run in the paper's; another --config says another scenario")
    return tables


def resolve(
    table: Mapping[str, Toml],
    rules: Rules | str = faults,
    imports: Sequence[str] = (),
    note: Callable[[str], None] = said,
) -> Config:
    """The configuration that a table of TOML means, completed and checked by `rules`; `note` as of `load`.

    Raises:
        agvjax.InputError: lists every bad key, its value and the rule.
    """
    version = table.get("version", VERSION)
    if type(version) is not int or version != VERSION:
        raise agvjax.InputError([agvjax.Fault("version", repr(version), f"{VERSION}, the file format of this release")])
    files = load_files(imports)
    claim(table, files)
    reader = Reader(classes(files))
    table = present({name: part for name, part in table.items() if name != "imports"}, lambda text: None)
    config = reader.config(table, Config(imports=files))
    for line in reader.notes:
        note(line)
    return checked(config, _rules(rules) if isinstance(rules, str) else rules, reader.faults)


def _rules(command: str) -> Rules:
    """The rules of a command by its name, as they were given before each room had its own."""
    warnings.warn(
        f"pass the rules of the command, tuning.{command}.rules.faults, not {command!r}", DeprecationWarning, 4
    )
    return importlib.import_module(f"tuning.{command}.rules").faults if command in ("tune", "sweep") else faults


def parsed(name: str) -> dict[str, Toml]:
    """The table of a file or of a preset."""
    try:
        return toml(text(PRESETS / f"{name}.toml" if name in BUILT_IN else Path(name)))
    except (OSError, ValueError) as error:
        rule = f"a readable TOML file, or one of {', '.join(BUILT_IN)} ({error})"
        raise agvjax.InputError([agvjax.Fault("--config", name, rule)]) from error


def _override(setting: str) -> Toml:
    match = re.fullmatch(rf"\s*({PART}(?:\.{PART})*)\s*=(.*)", setting)
    if match is None:
        rule = "key=value, a part of the key with dots in quotes"
        raise agvjax.InputError([agvjax.Fault("--set", repr(setting), rule)])
    key, value = match.groups()
    try:
        names = [part.strip() for part in re.findall(PART, key)]
        if len(names) > DEEPEST:
            raise ValueError(f"a key of more than {DEEPEST} parts")
        parts = [toml(f"part = {name}")["part"] if name[0] in "\"'" else name for name in names]
        parsed = _value(value)
    except ValueError as error:  # integers of thousands of digits, or nested without end
        raise agvjax.InputError([agvjax.Fault("--set", repr(setting), f"key=value ({error})")]) from error
    return _nested(parts, parsed)


PART = r"""(?:[ \t]*(?:"(?:[^"\\\n]|\\[^\n])*"|'[^'\n]*')[ \t]*|[^."'=\n]*[^."'=\s][^."'=\n]*)"""  # quoted or bare


def _value(text: str) -> Toml:
    """A value as TOML has it; what is no TOML is a number as a person may write it, .3 or 5., or a bare word."""
    try:
        return toml(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        word = text.strip()
    numbers = re.sub(r"(?<![\w.])\.(?=\d)", "0.", re.sub(r"(?<=\d)\.(?![\d.])", ".0", word))
    try:
        return word if numbers == word or re.search("[\"']", word) else toml(f"value = {numbers}")["value"]
    except ValueError:
        return word


def _nested(parts: Sequence[str], value: Toml) -> Toml:
    for part in reversed(parts):
        value = {part: value}
    return value


def _plain_names(table: dict[str, Toml], before: Mapping[str, Toml]) -> dict[str, Toml]:
    """The table with names with dots as one key each, in quotes or not, so that it finds the names `before` it.

    Raises:
        InputError: both spellings of a name are there, and none of them is the later one.
    """
    for key, kinds in NAMED.items():
        section, _, name = key.partition(".")
        inner = table.get(section)
        if not isinstance(inner, Mapping) or not isinstance(inner.get(name), Mapping):
            continue
        rows = flat(inner[name], kinds)
        if twice := [row for row, _ in rows if [other for other, _ in rows].count(row) > 1]:
            raise agvjax.InputError([agvjax.Fault(key, twice[0], "named once, in quotes or not")])
        earlier, placed = before.get(section, {}).get(name, {}), {}
        for row, value in rows:
            head, _, last = row.rpartition(".")
            if row not in earlier and isinstance(earlier.get(head), Mapping):  # one key of what is there
                placed[head] = {**placed.get(head, {}), last: value}
            else:
                placed[row] = value
        table = {**table, section: {**inner, name: placed}}
    return table


def _merge(into: dict[str, Toml], table: Mapping[str, Toml], built_in: bool, at: str = "") -> None:
    """Put a table over another one, all of it `built_in` or not, key by key; `at` is the key of both."""
    for name, value in table.items():
        before, key = into.get(name), f"{at}.{name}" if at else name
        if isinstance(value, Mapping) and isinstance(before, str) and at not in NAMED:
            before = into[name] = {"type": before}  # a name stands for its table
        if isinstance(value, Mapping) and isinstance(before, dict) and not _another(before, value):
            _drop_source(before, value, SOURCES.get(key, ()), built_in or "along" in value)
            _merge(before, value, built_in, key)
        elif key not in SECTIONS or isinstance(value, Mapping) <= isinstance(before, dict | None):
            into[name] = value  # and a section that is no table stays, to be refused


def _drop_source(before: dict[str, Toml], table: Mapping[str, Toml], sources: Sequence[str], anew: bool) -> None:
    """Take out of `before` what a table says otherwise: how corners are rounded; numbers, and what belongs to each.

    `anew` leaves what is `KEPT` alone: the corners' radius and the speed of a built-in path are of that path.
    """
    if sources and any(name in table for name in ROUNDED):
        for name in ROUNDED:
            before.pop(name, None)
    mine, given = ({name for name in sources if name in one} for one in (before, table))
    if not (mine and given):
        return
    lists = {n for n in ("speed", "half_width", "dwell") if isinstance(before.get(n), list)}
    if "half_width" in lists and len(before["half_width"]) == 2:
        lists.remove("half_width")  # left and right, of any points
    gone = {*sources, "columns", "topic", "spacing", "values", *lists}
    gone |= set(before) - set(KEPT) if anew and not mine & given else set()
    rows = table.get("points")
    if isinstance(rows, list) and any(isinstance(row, list) and len(row) == 3 for row in rows):
        gone.add("speed")  # each of the points says its own
    for name in gone:
        before.pop(name, None)


def _another(before: Mapping[str, Toml], table: Mapping[str, Toml]) -> bool:
    """Whether this is a table of another type, or a whole distribution: nothing of the one before it means anything."""
    if "type" in before or "type" in table:
        return before.get("type", table.get("type")) != table.get("type", before.get("type"))
    return all(any(not isinstance(one.get(kind, True), bool) for kind in KINDS) for one in (before, table))
