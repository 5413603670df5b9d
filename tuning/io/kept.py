"""Parts of a run that are done: a file each, so that a run that was stopped goes on to the same result."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Generic, NamedTuple, TypeVar

from agvjax import Fault, InputError

from . import files
from .plain import from_json

Part = TypeVar("Part", bound=NamedTuple)


class Kept(Generic[Part]):
    """The parts of a run folder.

    Attributes:
        done: by name, as far as the run has come.
    """

    def __init__(self, folder: Path | None, kind: type[Part]):
        """Read what is there.

        Args:
            folder: of the parts, below that of the run; None keeps them in memory alone.
            kind: what a part is; its fields are numbers, strings and tuples of numbers.

        Raises:
            InputError: a file is damaged.
        """
        self.folder, self.done = folder, dict[str, Part]()
        for path in sorted(folder.glob("*.json")) if folder is not None else ():
            try:
                self.done[path.stem] = _read(files.text(path), kind)
            except (OSError, ValueError, TypeError, KeyError) as error:
                rule = f"a run whose files are whole; {path} cannot be read ({error})"
                raise InputError([Fault("--resume", str(path.parent.parent), rule)]) from error

    def keep(self, name: str, part: Part) -> None:
        """Add a part and write it."""
        self.done[name] = part
        if self.folder is not None:
            self.folder.mkdir(exist_ok=True)
            files.write_json(self.folder / f"{name}.json", part._asdict())

    def once(self, name: str, make: Callable[[], Part]) -> Part:
        """A part, made and kept where it has not been yet."""
        if name not in self.done:
            self.keep(name, make())
        return self.done[name]


def _read(text: str, kind: type[Part]) -> Part:
    """A part of its file; a number that JSON has no word for was infinite."""
    table = from_json(text)
    if set(table) != set(kind._fields):
        raise ValueError(f"it must hold {', '.join(kind._fields)}")
    for name, value in table.items():
        if isinstance(value, list):
            table[name] = tuple(math.inf if x is None else float(x) for x in value)
        elif value is None:
            table[name] = math.inf
    return kind._make(table[name] for name in kind._fields)
