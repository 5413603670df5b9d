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

from agvjax import Fault, InputError
from agvjax.protocols import Disturbance, Element, Heading, Law, Plant, Sensor
from agvjax.protocols import Path as ReferencePath

from ..io import files
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
    owners: dict[str, str] = {}
    for path in paths:
        file = _load(path)
        if imports.setdefault(file.name, file.digest) != file.digest:
            raise _wrong(path, f"of another name: {file.name} is given twice, with different contents")
        for cls in file.classes:
            if owners.setdefault(cls, file.name) != file.name:
                raise _wrong(path, f"without a class {cls}: {owners[cls]} has one")
    return imports


def claim(table: Mapping[str, Toml], loaded: Mapping[str, str]) -> None:
    """Refuse a table whose [imports] name a file that is not `loaded`, or is with another content.

    Raises:
        agvjax.InputError: names every such file and its SHA-256.
    """
    imports, faults = table.get("imports", {}), []
    if not isinstance(imports, Mapping):
        raise InputError([Fault("imports", repr(imports), "a table of files with their SHA-256")])
    for name, digest in imports.items():
        if loaded.get(name) != digest:
            other = f" with this content; that of the one given is {loaded[name]}" if name in loaded else ""
            rule = f"the SHA-256 of a file that was given: give --import {name}{other}"
            faults.append(Fault(f"imports.{name}", digest, rule))
    if faults:
        raise InputError(faults)


def classes(imports: Mapping[str, str]) -> Classes:
    """The classes that can be named in TOML, those of these files among them."""
    loaded = [cls for digest in imports.values() for cls in _FILES[digest].classes.values()]
    usable = {place: {cls.__name__: cls for cls in loaded if place in _places(cls)} for place in CLASSES}
    return {place: {**built_in, **usable[place]} for place, built_in in CLASSES.items()}


def source(cls: type, place: str) -> File | None:
    """The file that a class comes from, if one was given that has it and it may stand in this place."""
    files = (file for file in _FILES.values() if file.classes.get(cls.__name__) is cls and place in _places(cls))
    return next(files, None)


def _places(cls: type) -> tuple[str, ...]:
    return tuple(place for base, places in PLACES.items() if issubclass(cls, base) for place in places)


def _load(path: str) -> File:
    try:
        content = files.content(Path(path))
    except (OSError, ValueError) as error:
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
    defined = [x for x in vars(module).values() if isinstance(x, type) and x.__module__ == module.__name__]
    usable = [cls for cls in defined if _places(cls) and _decorated(path, cls)]
    _FILES[digest] = File(name, digest, {cls.__name__: cls for cls in usable})
    return _FILES[digest]


def _decorated(path: str, cls: type) -> bool:
    """Whether a class is a dataclass, and no base of others only; one that no table could make is refused."""
    for place in _places(cls):
        if cls.__name__ in CLASSES[place] or cls.__name__ in {x.__name__ for x in CLASSES[place].values() if x}:
            raise _wrong(path, f"a file with other names: {cls.__name__} is built in")
    if "__dataclass_fields__" not in vars(cls):
        if not cls.__subclasses__():
            raise _wrong(path, f"a file whose classes stand under @agvjax.pytree: {cls.__name__} does not")
        return False
    for field in dataclasses.fields(cls):
        if field.default is field.default_factory is dataclasses.MISSING:
            rule = f"a file in whose classes every field has a default: {cls.__name__}.{field.name} has none"
            raise _wrong(path, rule)
    return True


def _wrong(path: str, rule: str) -> InputError:
    return InputError([Fault("--import", path, rule)])
