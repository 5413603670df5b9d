"""A log from a CSV file: its columns by our names and in SI units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

import agvjax
from agvjax import Fault

from ..io.csv_file import KINDS, LARGEST, UNITS, Column, read
from .log import LEAST_ROWS, MEASURED, POSE, Log, commands_of
from .plausible import implausible


def load(file: str, plant: agvjax.Plant, columns: Mapping[str, Column]) -> Log:
    """A log for a plant, its columns by their own names unless `columns` says others.

    Raises:
        agvjax.InputError: the file or a column cannot be read, or a column cannot be in the unit it is taken for.
    """
    commands = commands_of(plant)
    names = ("t", *MEASURED, *commands)
    if faults := _misnamed(columns, names):
        raise agvjax.InputError(faults)
    where = _places(columns, names)
    needed = [where[name].column for name in ("t", *POSE, *commands)]
    asked = [where[name].column for name in columns if name in MEASURED and name in where]  # so it must be there
    measured = [where[name].column for name in MEASURED if name in where]  # cells may be blank
    must, time = list(dict.fromkeys([*needed, *asked])), where["t"]
    try:
        table = read(file, must, measured[len(POSE) :], LEAST_ROWS, time.column, measured, time.nanoseconds)
    except ValueError as error:
        rule = f"a log: a CSV file with {', '.join(needed)}, or others named in [identify.columns] ({error})"
        raise agvjax.InputError([Fault("LOG.csv", str(file), rule)]) from error
    with np.errstate(over="ignore"):  # of an absurd factor, which is refused below
        values = {n: table[p.column] * UNITS.get(p.unit, 1.0) * p.factor for n, p in where.items() if p.column in table}
    if faults := _too_large(values, where):
        raise agvjax.InputError(faults)
    origin, inputs = float(values["t"][0]), np.column_stack([values[name] for name in commands])
    seen = {name: values[name] for name in MEASURED if name in values}
    log = Log(Path(file).name, origin, values["t"] - origin, inputs, commands, seen)
    if faults := implausible(log, where, not plant.commands_heading):
        raise agvjax.InputError(faults)
    return log._replace(measured={**seen, "heading": _unwrapped(seen["heading"])})


def _unwrapped(heading: np.ndarray) -> np.ndarray:
    """Headings without the leaps of a whole turn that the range of an angle makes; NaN stays NaN."""
    whole, fine = heading.copy(), np.isfinite(heading)
    whole[fine] = np.unwrap(heading[fine])
    return whole


def _places(columns: Mapping[str, Column], names: Sequence[str]) -> dict[str, Column]:
    """Where each name stands: by its own name unless another has that column; not the ones that are not to be read."""
    taken = {place.column for place in columns.values()}
    where = {name: columns.get(name, Column("" if name in taken else name)) for name in names}
    return {name: place for name, place in where.items() if place.column}


def _too_large(values: Mapping[str, np.ndarray], where: Mapping[str, Column]) -> list[Fault]:
    """Columns that a factor makes too large to be computed with."""
    return [
        Fault(f"identify.columns.{name}.factor", where[name].factor, f"so small that no number passes {LARGEST:g}")
        for name, value in values.items()
        if np.any(np.abs(value) > LARGEST)
    ]


def _misnamed(columns: Mapping[str, Column], names: Sequence[str]) -> list[Fault]:
    """Columns of no such name, of a unit that is none of theirs, or given to two names."""
    faults = [
        Fault(f"identify.columns.{name}", columns[name].column, f"one of {', '.join(names)}")
        for name in columns
        if name not in names
    ]
    needed = [name for name in names if name not in MEASURED[len(POSE) :]]
    for name, place in columns.items():
        if not place.column and name in needed:
            faults.append(Fault(f"identify.columns.{name}", place.column, "the name of a column: a log needs it"))
        if place.nanoseconds and (name != "t" or place.unit not in ("", "s")):
            rule = "left out but for t, in seconds"
            faults.append(Fault(f"identify.columns.{name}.nanoseconds", place.nanoseconds, rule))
        units = KINDS[name].split() if name in KINDS else UNITS
        if place.unit and place.unit not in units:
            faults.append(Fault(f"identify.columns.{name}.unit", place.unit, f"one of {', '.join(units)}"))
        twice = [other for other in columns if other != name and columns[other].column == place.column != ""]
        twice += [other for other in needed if other not in columns and other == place.column != name]
        if twice:
            faults.append(Fault(f"identify.columns.{name}", place.column, f"another column than that of {twice[0]}"))
    return faults
