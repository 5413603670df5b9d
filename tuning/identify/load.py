"""A log from a CSV file or a recording: its columns by our names and in SI units."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import agvjax
from agvjax import Fault
from agvjax.plants.base import Driven

from ..io import geo
from ..io import logs as recordings
from ..io.csv_file import KINDS, LARGEST, UNITS, Column, names, read, units_like
from ..io.headings import unwrapped
from ..io.logs.roles import chosen
from ..io.logs.rows import Rows
from ..io.logs.rows import table as rows_of
from ..io.track_names import guessed
from .log import LEAST_ROWS, MEASURED, POSE, Log, Sent, commands_of, in_files
from .model import steers
from .plausible import AS_QUATERNION, implausible

ON_EARTH = ("lat", "lon")  # [deg], in place of x and y
TWIST = ("cmd_v", "cmd_w")  # speed [m/s] and yaw rate [rad/s], as ROS sends them
ANGLE = "steering_angle"  # measured [rad]
NONE = Column("")
NOT_NAMED: Mapping[str, str] = {}
Count = Callable[[int], object]  # is told how many more rows or messages were read


def uncounted(more: int) -> None:
    """Nobody watches."""


# long: the checks stand in their order
def load(
    file: str,
    plant: agvjax.Plant,
    columns: Mapping[str, Column],
    ahead: float = 0.0,
    topics: Mapping[str, str] = NOT_NAMED,
    stamps: str = "auto",
    count: Count = uncounted,
) -> Log:
    """A log for a plant, its columns by their own names unless `columns` says others.

    Args:
        file: the CSV file, or a recording as robots make them.
        plant: as it is assumed; one that is driven by velocities may be told `TWIST` in place of its own commands,
            which its own numbers (the track) then make of them.
        columns: where quantities stand that have another name, unit or sign there.
        ahead: how far ahead of the measured point, along its heading, the reference point is [m].
        topics: of a recording, by role the topic that serves as it, where several could.
        stamps: of a recording, whose times: "header", "arrival", or "auto".
        count: is told how much was read.

    Raises:
        agvjax.InputError: the file or a column cannot be read, or a column cannot be in the unit it is taken for.
    """
    commands, tongues = commands_of(plant), tongues_of(plant)
    names = ("t", *MEASURED, *ON_EARTH, *dict.fromkeys(itertools.chain(*tongues)))
    pose = (*(ON_EARTH if any(name in columns for name in ON_EARTH) else POSE[:2]), POSE[2])
    named = [tongue for tongue in tongues if any(columns.get(name, NONE).parts for name in tongue)]
    tongue = named[0] if named else tongues[0] if len(tongues) == 1 else None  # None: the file decides
    needed = ("t", *pose, *(tongue or ()))
    if faults := _misnamed(columns, names, needed, kinds(plant)):
        raise agvjax.InputError(faults)
    where = _places(columns, [name for name in names if name in pose or name not in (*POSE[:2], *ON_EARTH)])
    asked = [name for name in columns if name in (*MEASURED, *ON_EARTH) and name in where]  # so it must be there
    must, may = ([part for name in ns for part in where[name].parts] for ns in ((*needed, *asked), where))
    blank = [part for name in (*MEASURED, *ON_EARTH) if name in where for part in where[name].parts]  # cells may be
    must, time, notes = list(dict.fromkeys(must)), where["t"], ()
    more = [part for part in may if part not in must]
    try:
        if recordings.is_recording(file):
            here = {name: where[name] for name in columns if name in where}  # the others stand where their types say
            rows = _recorded(file, here, {*itertools.chain(*tongues)}, topics, stamps, count)
            values, notes = rows.columns, rows.notes
            values = {name: x for name, x in values.items() if columns.get(name) != NONE}  # empty: not to be read
            tongue = tongue or _tongue(tongues, values)
            values = _told(values, (*pose, *asked), tongue)
        else:
            table = read(file, must, more, LEAST_ROWS, time.column, blank, time.nanoseconds)
            count(len(table[time.column]))
            values = {name: place.values(table) for name, place in where.items() if {*place.parts} <= table.keys()}
            if tongue is None and len(both := [t for t in tongues if all(name in values for name in t)]) > 1:
                raise ValueError(_twice(both))
            tongue = tongue or _tongue(tongues, values)
        if "lat" in pose:
            values |= _in_plane(file, values["lat"], values["lon"])
    except ValueError as error:
        kinds_of = " or ".join(", ".join(t) for t in ([tongue] if tongue else tongues))
        rule = f"a log: a CSV file or a recording with t, {', '.join(pose)} and {kinds_of}, or others named in"
        rule += " [identify.columns]"
        more = "" if recordings.is_recording(file) else _otherwise(file, columns)
        raise agvjax.InputError([Fault("LOG.csv", str(file), f"{rule} ({error}{more})")]) from error
    if faults := _too_large(values, where):
        raise agvjax.InputError(faults)
    origin, given = float(values["t"][0]), np.column_stack([values[name] for name in tongue])
    seen = {name: values[name] for name in MEASURED if name in values}
    if ANGLE in seen and not steers(plant):
        if ANGLE in columns:
            rule = f"left out: {type(plant).__name__} has no wheel that is steered"
            raise agvjax.InputError([Fault(f"identify.columns.{ANGLE}", where[ANGLE].words, rule)])
        del seen[ANGLE]
        notes = (*notes, f"{ANGLE} is not used: {type(plant).__name__} has no wheel that is steered")
    into = functools.partial(inputs_of, plant) if isinstance(plant, Driven) and tongue == TWIST else np.asarray
    spoken = Sent(tongue, given, into)
    log = Log(Path(file).name, origin, values["t"] - origin, into(given), commands, seen, spoken, notes)
    if faults := implausible(log, where, not plant.commands_heading):
        raise agvjax.InputError([_by_its_file(fault, log, recordings.is_recording(file)) for fault in faults])
    return _from_ahead(log._replace(measured={**seen, "heading": unwrapped(seen["heading"])}), ahead)


def _recorded(
    file: str,
    named: Mapping[str, Column],
    commands: Collection[str],
    topics: Mapping[str, str],
    stamps: str,
    count: Count,
) -> Rows:
    """The rows of a recording by our names, as a topic's type tells them or as they are named, TOPIC.FIELD.

    Raises:
        ValueError: it cannot be read.
    """
    recording = recordings.read(file, count)
    if "t" in named:
        raise ValueError(f"t = {named['t'].words} must be left out: a recording has the times of its messages")
    found = chosen(recording, topics, list(named))
    rows = rows_of(recording, found, named, commands, stamps)
    return rows._replace(notes=(*(f"missing: {line}" for line in recording.lost), *rows.notes))


def _told(table: Mapping[str, np.ndarray], must: Sequence[str], commands: Sequence[str]) -> dict[str, np.ndarray]:
    """The rows in which every command is known; the others leave a gap.

    Raises:
        ValueError: a column is not there that must be, or too few rows are left.
    """
    if lacks := [name for name in dict.fromkeys((*must, *commands)) if name not in table]:
        raise ValueError(f"it has no {', '.join(lacks)}; any of its numbers may be named, as TOPIC.FIELD")
    keep = np.logical_and.reduce([np.isfinite(table[name]) for name in commands])
    if keep.sum() < LEAST_ROWS:
        raise ValueError(f"{int(keep.sum())} rows in which every command is known, fewer than {LEAST_ROWS}")
    return {name: column[keep] for name, column in table.items()}


def tongues_of(plant: agvjax.Plant) -> list[tuple[str, ...]]:
    """The names under which a plant's commands may stand in a file: its own, or of velocities a twist."""
    own = in_files(commands_of(plant))
    return [own, TWIST] if isinstance(plant, Driven) else [own]


def inputs_of(plant: Driven, twists: np.ndarray) -> np.ndarray:
    """What the driver of a vehicle makes of twists (N, 2), with the numbers that it takes its vehicle to have."""
    return np.asarray(jax.vmap(plant.asked)(jnp.asarray(twists)), float)


def kinds(plant: agvjax.Plant) -> dict[str, list[str]]:
    """By quantity of a log the units that its column may have."""
    units = {c: plant.units.get(c.removesuffix("_x").removesuffix("_y"), "") for c in commands_of(plant)}
    commands = dict(zip(in_files(list(units)), units.values(), strict=True))
    twist = dict(zip(TWIST, ("m/s", "rad/s"), strict=True))
    return {name: KINDS[name].split() for name in ("t", *MEASURED, *ON_EARTH)} | {
        name: units_like(unit) for name, unit in (commands | twist).items()
    }


def _in_plane(file: str, lat: np.ndarray, lon: np.ndarray) -> dict[str, np.ndarray]:
    """Positions x and y (N,) [m] of latitudes and longitudes [rad], NaN where one is; raises as `geo.plane`."""
    seen = np.isfinite(lat) & np.isfinite(lon)
    if not seen.any():
        raise ValueError("it has no latitude and longitude in one row")
    x, y = np.full_like(lat, np.nan), np.full_like(lat, np.nan)
    x[seen], y[seen], _ = geo.plane(file, np.degrees(lat[seen]), np.degrees(lon[seen]))
    return {"x": x, "y": y}


def _otherwise(file: str, columns: Mapping[str, Column]) -> str:
    """What of a CSV file seems to go by another name, as it would be said in [identify.columns]."""
    try:
        header = names(file)
    except ValueError:
        return ""
    found = {name: f'"{column.column}"' for name, column in guessed(header).items()}
    if {"qz", "qw"} <= {*header}:
        found["heading"] = '{ quaternion = ["qz", "qw"] }'
    lacks = [name for name in ("t", *POSE) if name in found and name not in header and name not in columns]
    return f"; perhaps {', '.join(f'{name} = {found[name]}' for name in lacks)}" if lacks else ""


def _tongue(tongues: Sequence[tuple[str, ...]], values: Mapping[str, np.ndarray]) -> tuple[str, ...]:
    """The first of them whose commands are all there.

    Raises:
        ValueError: of none they are.
    """
    for tongue in tongues:
        if all(name in values for name in tongue):
            return tongue
    raise ValueError(f"it has no columns {', nor '.join(' and '.join(tongue) for tongue in tongues)}")


def _by_its_file(fault: Fault, log: Log, recorded: bool) -> Fault:
    """A fault of times, which of a recording no column can be named for."""
    if not recorded or fault.key != "identify.columns.t":
        return fault
    rule = f"a recording of a control loop: its rows are {log.step:.3g} s apart"
    return Fault("LOG.csv", log.name, f'{rule}; of a folder of tables, times in ms stand in a column "timestamp [ms]"')


def _twice(tongues: Sequence[tuple[str, ...]]) -> str:
    """What is said of a file in which commands may stand under several names: one pair may be what was measured."""
    listed = " and ".join(", ".join(tongue) for tongue in tongues)
    blank = ", ".join(f'{name} = ""' for name in tongues[0])
    kept = ", ".join(f'{name} = "{name}"' for name in tongues[0])
    return f"it has {listed}: say which are the commands, {kept} or {blank} in [identify.columns]"


def _from_ahead(log: Log, ahead: float) -> Log:
    """The log of a point further ahead along the heading.

    Raises:
        agvjax.InputError: the log has velocities of the measured point, along x and y.
    """
    if not ahead:
        return log
    if wrong := [name for name in ("vx", "vy") if name in log.measured]:
        rule = f'0 for a log with velocities of the measured point: leave them out, {wrong[0]} = ""'
        raise agvjax.InputError([Fault("identify.ahead", ahead, f"{rule} in [identify.columns]")])
    seen, heading = log.measured, log.measured["heading"]
    moved = {"x": seen["x"] + ahead * np.cos(heading), "y": seen["y"] + ahead * np.sin(heading)}
    return log._replace(measured={**seen, **moved})


def _places(columns: Mapping[str, Column], names: Sequence[str]) -> dict[str, Column]:
    """Where each name stands: by its own name unless another has that column; not the ones that are not to be read."""
    taken = {part for place in columns.values() for part in place.parts}
    where = {name: columns.get(name, Column("" if name in taken else name)) for name in names}
    where |= {n: where[n]._replace(unit=where[n].unit or "deg") for n in ON_EARTH if n in where}
    return {name: place for name, place in where.items() if place.parts}


def _too_large(values: Mapping[str, np.ndarray], where: Mapping[str, Column]) -> list[Fault]:
    """Columns that a factor makes too large to be computed with."""
    return [
        Fault(f"identify.columns.{name}.factor", where[name].factor, f"so small that no number passes {LARGEST:g}")
        for name, value in values.items()
        if np.any(np.abs(value) > LARGEST)
    ]


def _misnamed(
    columns: Mapping[str, Column], names: Sequence[str], needed: Sequence[str], units: Mapping[str, Sequence[str]]
) -> list[Fault]:
    """Columns of no such name, of a unit that is none of theirs, or given to two names."""
    faults = [
        Fault(f"identify.columns.{name}", columns[name].words, f"one of {', '.join(names)}")
        for name in columns
        if name not in names
    ]
    for name, place in columns.items():
        if not place.parts and name in needed:
            faults.append(Fault(f"identify.columns.{name}", place.column, "the name of a column: a log needs it"))
        if place.nanoseconds and (name != "t" or place.unit not in ("", "s")):
            rule = "left out but for t, in seconds"
            faults.append(Fault(f"identify.columns.{name}.nanoseconds", place.nanoseconds, rule))
        if place.unit and place.unit not in units.get(name, UNITS):
            rule = f"one of {', '.join(units.get(name, UNITS))}"
            rule += f"; a quaternion is {AS_QUATERNION}" if name == "heading" else ""
            faults.append(Fault(f"identify.columns.{name}.unit", place.unit, rule))
        twice = [other for other in columns if other != name and set(columns[other].parts) & set(place.parts)]
        twice += [other for other in needed if other not in columns and other in place.parts and other != name]
        if twice:
            faults.append(Fault(f"identify.columns.{name}", place.words, f"another column than that of {twice[0]}"))
    return faults
