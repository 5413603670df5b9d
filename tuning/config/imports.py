"""Classes of one's own from files named on the command line: `--import my_laws.py`.

A configuration names its files with their SHA-256 and never executes them: whoever reads it gives them again.
"""

from __future__ import annotations

import dataclasses
import hashlib
import sys
import traceback
import types
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import agvjax
from agvjax.protocols import Disturbance, Element, Heading, Law, Plant, Sensor
from agvjax.protocols import Path as ReferencePath

from .names import CLASSES, Classes
from .spellings import Toml

PLACES = {
    Law: ("controller", "controller.inner"),
    Plant: ("scenario.plant", "controller.vehicle"),
    ReferencePath: ("scenario.path",),
    Heading: ("scenario.heading",),
    Disturbance: ("scenario.disturbance",),
    Element: ("elements",),
    Sensor: ("scenario.sensor",),
}


class File(NamedTuple):
    """A file of classes, by its name without folders and the SHA-256 of its content."""

    name: str
    digest: str
    classes: dict[str, type]


_FILES: dict[str, File] = {}  # by digest, executed once: a class is the same however often its file is given


def load_files(paths: Iterable[str]) -> dict[str, str]:
    """Execute files and keep their classes; their names and digests, as a configuration has them.

    Raises:
        agvjax.InputError: a file cannot be executed, or a class in it cannot be named in TOML.
    """
    imports: dict[str, str] = {}
    for path in paths:
        file = _load(path)
        if imports.setdefault(file.name, file.digest) != file.digest:
            raise _wrong(path, f"of another name: {file.name} is given twice, with different contents")
    owners: dict[str, str] = {}
    for name, digest in imports.items():
        for cls in _FILES[digest].classes:
            if owners.setdefault(cls, name) != name:
                raise _wrong(name, f"without a class {cls}: {owners[cls]} has one")
    return imports


def claim(table: Mapping[str, Toml], given: Mapping[str, str]) -> None:
    """Refuse a table whose [imports] name a file that was not `given` with it, or was with another content.

    Raises:
        agvjax.InputError: names every such file and its SHA-256.
    """
    imports, faults = table.get("imports", {}), []
    if not isinstance(imports, Mapping):
        raise agvjax.InputError([agvjax.Fault("imports", repr(imports), "a table of files with their SHA-256")])
    for name, digest in imports.items():
        if given.get(name) != digest:
            other = f" with this content; that of the one given is {given[name]}" if name in given else ""
            rule = f"the SHA-256 of a file that was given: give --import {name}{other}"
            faults.append(agvjax.Fault(f"imports.{name}", digest, rule))
    if faults:
        raise agvjax.InputError(faults)


def classes(imports: Mapping[str, str]) -> Classes:
    """The classes that can be named in TOML, those of these files among them."""
    own = [
        (cls, place) for digest in imports.values() for cls in _FILES[digest].classes.values() for place in _places(cls)
    ]
    return {
        place: {**named, **{cls.__name__: cls for cls, at in own if at == place}} for place, named in CLASSES.items()
    }


def source(cls: type, place: str) -> File | None:
    """The file that a class comes from, if one was given that has it and it may stand in this place."""
    files = (file for file in _FILES.values() if file.classes.get(cls.__name__) is cls)
    return next(files, None) if place in _places(cls) else None


def _places(cls: type) -> tuple[str, ...]:
    return tuple(place for base, places in PLACES.items() if issubclass(cls, base) for place in places)


def _load(path: str) -> File:
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise _wrong(path, f"a readable file ({error})") from error
    digest, name = hashlib.sha256(content).hexdigest(), Path(path).name
    if digest in _FILES:
        _FILES[digest] = _FILES[digest]._replace(name=name)
        return _FILES[digest]
    module = types.ModuleType(f"{Path(path).stem}_{digest[:8]}")
    module.__file__ = path
    sys.modules[module.__name__] = module  # where dataclasses look for the annotations of a class
    try:
        exec(compile(content, path, "exec"), module.__dict__)
    except Exception as error:  # whatever the file raises
        line = traceback.extract_tb(error.__traceback__)[-1].lineno
        raise _wrong(path, f"a file of Python that runs (line {line}: {type(error).__name__}: {error})") from error
    named = {x.__name__: x for x in vars(module).values() if isinstance(x, type) and x.__module__ == module.__name__}
    usable = {name: cls for name, cls in named.items() if _places(cls)}
    for cls in usable.values():
        _check(path, cls)
    decorated = {name: cls for name, cls in usable.items() if "__dataclass_fields__" in vars(cls)}
    _FILES[digest] = File(name, digest, decorated)
    return _FILES[digest]


def _check(path: str, cls: type) -> None:
    """Refuse a class that no table could make."""
    built_in = {name for place in _places(cls) for name in CLASSES[place]}
    built_in |= {known.__name__ for place in _places(cls) for known in CLASSES[place].values() if known}
    if cls.__name__ in built_in:
        raise _wrong(path, f"a file with other names: {cls.__name__} is built in")
    if "__dataclass_fields__" not in vars(cls):
        if not cls.__subclasses__():
            raise _wrong(path, f"a file whose classes stand under @agvjax.pytree: {cls.__name__} does not")
        return
    bare = [f.name for f in dataclasses.fields(cls) if f.default is f.default_factory is dataclasses.MISSING]
    if bare:
        raise _wrong(path, f"a file in whose classes every field has a default: {cls.__name__}.{bare[0]} has none")


def _wrong(path: str, rule: str) -> agvjax.InputError:
    return agvjax.InputError([agvjax.Fault("--import", path, rule)])
