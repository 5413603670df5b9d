"""A recorded drive: columns of a CSV file by our names and in SI units, and whether they can be what they say."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

import agvjax
from agvjax import Fault
from agvjax.geometry import wrap

from ..io.csv_file import UNITS, Column, read

POSE = ("x", "y", "heading")
MEASURED = (*POSE, "vx", "vy", "speed", "yaw_rate", "steering_angle")  # m, m, rad, m/s, m/s, m/s, rad/s, rad
LEAST_ROWS = 50
KINDS = {"t": "s ms us ns", "x": "m cm mm", "y": "m cm mm", "heading": "rad deg", "steering_angle": "rad deg"}
KINDS |= dict.fromkeys(("vx", "vy", "speed"), "m/s mm/s km/h") | {"yaw_rate": "rad/s deg/s rpm"}
CLEAR = 5.0  # times its noise: a rate by which a unit can be judged


class Log(NamedTuple):
    """A drive. What was commanded in a row holds until the next one."""

    name: str
    origin: float  # s, the time of the first row by the clock of the file
    t: np.ndarray  # (N,), s, since the first row, or since that of the first of several logs with one clock
    inputs: np.ndarray  # (N, m), in the order of the plant's actuators
    commands: tuple[str, ...]  # names of the inputs
    measured: dict[str, np.ndarray]  # by channel (N,); NaN where nothing was measured

    @property
    def step(self) -> float:
        """The usual time from row to row [s]."""
        return float(np.median(np.diff(self.t)))


def commands_of(plant: agvjax.Plant) -> tuple[str, ...]:
    """The columns of a plant's inputs: the names of its actuators, two for one that takes a vector."""
    zeros: dict[str, Any] = dict.fromkeys(plant.actuators, np.zeros(()))
    zeros |= {"position": np.zeros(2)} if plant.feedthrough else {}
    seen = plant.output(plant.start(agvjax.Start()), zeros)
    asked = plant.allocate(agvjax.Command(position=jnp.zeros(2), heading=jnp.zeros(())), seen)
    columns = [[f"{name}_x", f"{name}_y"] if np.ndim(asked[name]) else [name] for name in plant.actuators]
    return tuple(itertools.chain(*columns))


def columns_of(commands: Sequence[str], actuator: str) -> list[int]:
    """Where among the names of the inputs those of an actuator are: one, or two for one that takes a vector."""
    return [i for i, c in enumerate(commands) if c in (actuator, f"{actuator}_x", f"{actuator}_y")]


def load(file: str, plant: agvjax.Plant, columns: Mapping[str, Column]) -> Log:
    """A log for a plant, its columns by their own names unless `columns` says others.

    Raises:
        agvjax.InputError: the file or a column cannot be read, or a column cannot be in the unit it is taken for.
    """
    commands = commands_of(plant)
    names = ("t", *MEASURED, *commands)
    if faults := _misnamed(columns, names):
        raise agvjax.InputError(faults)
    where = {name: columns.get(name, Column(name)) for name in names}
    needed = [where[name].column for name in ("t", *POSE, *commands)]
    asked = [where[name].column for name in columns if name in MEASURED]  # by name, so it must be there
    measured = [where[name].column for name in MEASURED]  # may be blank, and but for the pose missing
    try:
        table = read(
            file, list(dict.fromkeys([*needed, *asked])), measured[len(POSE) :], LEAST_ROWS, where["t"].column, measured
        )
    except ValueError as error:
        rule = f"a log: a CSV file with {', '.join(needed)}, or others named in [identify.columns] ({error})"
        raise agvjax.InputError([Fault("LOG.csv", str(file), rule)]) from error
    values = {n: table[p.column] * UNITS.get(p.unit, 1.0) * p.factor for n, p in where.items() if p.column in table}
    origin, inputs = float(values["t"][0]), np.column_stack([values[name] for name in commands])
    seen = {name: values[name] for name in MEASURED if name in values}
    log = Log(Path(file).name, origin, values["t"] - origin, inputs, commands, seen)
    if faults := implausible(log, where, not plant.commands_heading):
        raise agvjax.InputError(faults)
    return log


def _misnamed(columns: Mapping[str, Column], names: Sequence[str]) -> list[Fault]:
    """Columns of no such name, of a unit that is none of theirs, or given to two names."""
    faults = [
        Fault(f"identify.columns.{name}", columns[name].column, f"one of {', '.join(names)}")
        for name in columns
        if name not in names
    ]
    for name, place in columns.items():
        units = KINDS[name].split() if name in KINDS and place.unit in UNITS else UNITS
        if place.unit and place.unit not in units:
            faults.append(Fault(f"identify.columns.{name}.unit", place.unit, f"one of {', '.join(units)}"))
        twice = [other for other in columns if other != name and columns[other].column == place.column]
        if twice:
            faults.append(Fault(f"identify.columns.{name}", place.column, f"another column than that of {twice[0]}"))
    return faults


# long: one reading after the other
def implausible(log: Log, where: Mapping[str, Column], rolls: bool) -> list[Fault]:
    """Columns that cannot be in the unit they are taken for, by the others; what `rolls` goes the way it looks."""

    def suspect(name: str, looks: str, why: str) -> Fault:
        column, taken = where[name].column, where[name].unit or "SI"
        mended = f'{{ column = "{column}", unit = "{looks}" }}'
        rule = f"in the unit it is taken for: {why}; if it is in {looks}, say {mended}"
        return Fault(f"identify.columns.{name}", f"{column} in {taken}", rule)

    if log.step >= 1.0:
        unit = "ms" if log.step < 1e3 else "us" if log.step < 1e6 else "ns"
        return [suspect("t", unit, f"rows are {log.step:g} s apart, too far for a control loop")]
    if log.step < 1e-4:
        return [suspect("t", "s", f"rows are {log.step:g} s apart, closer than any control loop")]
    pose = np.column_stack([log.measured[name] for name in POSE])
    rows = np.isfinite(pose).all(axis=1)
    if rows.sum() < LEAST_ROWS:
        rule = f"a log with at least {LEAST_ROWS} rows of a whole pose; it has {rows.sum()}"
        return [Fault("LOG.csv", log.name, rule)]
    t, path, heading, faults = log.t[rows], pose[rows, :2], pose[rows, 2], []
    moved = _pace(t, path)
    speed = float(np.quantile(moved, 0.75)) if moved.size else 0.0
    if speed > 60.0:
        faults.append(suspect("x", "mm", f"the vehicle would do {speed:.0f} m/s"))
    turns = np.abs(np.diff(heading))
    jumps = np.any((turns > 180) & (turns <= 360.5)) and np.abs(heading).max() > 4 * np.pi
    reading = _reading(path, heading) if rolls else AS_GIVEN
    if reading.degrees or jumps:
        why = "as radians it fits neither the way the vehicle goes nor a whole turn"
        faults.append(suspect("heading", "deg", why))
    if reading.words:
        rule = f"along the way that the vehicle goes, forwards or backwards; it is where {reading.words}"
        faults.append(Fault("identify.columns.heading", f"{where['heading'].column} of {log.name}", rule))
    x, y = path.T
    rates = {"vx": (_smooth_rate(t, x), x), "vy": (_smooth_rate(t, y), y)}  # and what their noise comes from
    if not faults:
        rates["yaw_rate"] = _smooth_rate(t, np.unwrap(heading)), heading
        rates["speed"] = np.hypot(rates["vx"][0], rates["vy"][0]), x
    for name, (rate, source) in rates.items():
        if name not in log.measured or where[name].unit:  # a stated unit is believed
            continue
        if np.nanquantile(np.abs(rate), 0.8) < CLEAR * _noise_of_rate(source, log.step):
            continue  # the pose says too little of it
        if guess := _unit_of(_ratio(log.measured[name][rows], rate), name):
            faults.append(suspect(name, *guess))
    return faults


def _pace(t: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Speed [m/s] over stretches of about a tenth of a second."""
    every = max(1, round(0.1 / float(np.median(np.diff(t)))))
    return np.linalg.norm(np.diff(path[::every], axis=0), axis=1) / np.diff(t[::every])


def _smooth_rate(t: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Derivative by central differences over a few rows."""
    wide = 3
    rate = np.full(t.size, np.nan)
    rate[wide:-wide] = (value[2 * wide :] - value[: -2 * wide]) / (t[2 * wide :] - t[: -2 * wide])
    return rate


def _noise_of_rate(value: np.ndarray, step: float) -> float:
    """What noise alone makes of `_smooth_rate`."""
    third = np.abs(np.diff(np.unwrap(value), 3)) if value.size > 3 else np.zeros(1)
    return float(1.4826 * np.median(third) / np.sqrt(20) * np.sqrt(2) / (6 * step))


def _ratio(measured: np.ndarray, rate: np.ndarray) -> float:
    """How many times larger what is measured is than what the pose says, by their spread; 1 where there is nothing."""
    both = np.isfinite(measured) & np.isfinite(rate)
    if both.sum() < LEAST_ROWS:
        return 1.0
    a, b = (np.quantile(np.abs(z[both]), 0.8) for z in (measured, rate))
    return float(a / b) if a > 0 and b > 0 else 1.0


def _unit_of(ratio: float, name: str) -> tuple[str, str] | None:
    """The unit that a ratio to what the pose says betrays, and words for it."""
    angle, why = name == "yaw_rate", f"it is {ratio:.3g} times what the pose says"
    units = {180 / np.pi: "deg/s"} if angle else {1000.0: "mm/s", 3.6: "km/h"}
    for factor, unit in units.items():
        if factor / 1.5 < ratio < factor * 1.5:
            return unit, why
    if 0.1 < ratio < 10:
        return None
    other = "t, x, y or heading" if ratio > 1 else "x and y, perhaps in mm,"
    return "rad/s" if angle else "m/s", f"{why}, so that {other} may be off too"


class HeadingReading(NamedTuple):
    """How a heading is to be read so that a vehicle goes where it looks; in words what differs from the convention."""

    degrees: bool
    words: str


AS_GIVEN = HeadingReading(False, "")
WRONG = 0.3  # of its way that a vehicle slides aside, in the median, so that its heading cannot be read as given
TURNED = {  # other conventions, and what they make of an angle
    "": lambda h: h,
    "x and y are exchanged, or heading counts clockwise from the y axis": lambda h: np.pi / 2 - h,
    "heading counts clockwise, or one of x and y has the other sign": lambda h: -h,
}


def _reading(path: np.ndarray, heading: np.ndarray) -> HeadingReading:
    """The way of reading under which a heading fits the way the vehicle goes, where the given one does not at all."""
    picked, last = [], 0  # ends of stretches of at least 2 % of the size of the path, so that noise does not count
    least = 0.02 * float(np.ptp(path, axis=0).max())
    for i in range(path.shape[0]):
        if np.linalg.norm(path[i] - path[last]) >= max(least, 1e-9):
            picked.append((last, i))
            last = i
    if len(picked) < 5:
        return AS_GIVEN
    first, last = np.array(picked).T
    moved, off = path[last] - path[first], {}
    for degrees in (False, True):
        for words, turn in TURNED.items():
            h = turn(np.deg2rad(heading) if degrees else heading)
            middle, turned = h[(first + last) // 2], np.asarray(wrap(h[last] - h[first]))
            aside = moved[:, 1] * np.cos(middle) - moved[:, 0] * np.sin(middle)
            ahead = aside @ turned / max(turned @ turned, 1e-12)  # m, of the reference point before the axle that rolls
            share = np.abs(aside - ahead * turned) / np.linalg.norm(moved, axis=1)
            off[HeadingReading(degrees, words)] = float(np.median(share))
    best = min(off, key=lambda reading: off[reading])
    return best if off[best] < WRONG / 2 and off[AS_GIVEN] > WRONG else AS_GIVEN


def together(logs: Sequence[Log]) -> tuple[tuple[Log, ...], bool]:
    """Several logs on one clock where they have one: then none begins before another has ended; and whether they do."""
    order = sorted(logs, key=lambda log: log.origin)
    one = all(a.origin + a.t[-1] < b.origin for a, b in zip(order[:-1], order[1:], strict=True))
    if one:
        logs = [log._replace(t=log.t + (log.origin - order[0].origin)) for log in logs]
    return tuple(logs), one


def same_channels(logs: Sequence[Log]) -> list[Fault]:
    """Logs that do not measure what the first one does."""
    first = tuple(logs[0].measured)
    rule = f"a log with the same measurements as {logs[0].name}: {', '.join(first)}"
    return [Fault("LOG.csv", log.name, rule) for log in logs[1:] if tuple(log.measured) != first]
