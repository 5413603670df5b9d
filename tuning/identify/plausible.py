"""Whether the columns of a log can be what they are taken for, by each other."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from agvjax import Fault
from agvjax.geometry import wrap

from ..io.csv_file import Column
from .log import LEAST_ROWS, POSE, Log, shifts, white_noise
from .segments import leaps

CLEAR = 5.0  # times its noise: a motion by which a unit or a heading can be judged
WILD = 1e4  # times what is usual
WRONG, LOST = 0.3, 0.7  # of a motion that a measurement of it is off, in the median, to be taken for something else
BACK = 0.05  # share of the time that a vehicle goes backwards, from which on a speed must have been negative
BODY = "it is in the frame of the vehicle, forwards and to the left"
OTHER = "it is of the other sign"
UNSIGNED = "it has no sign, where the vehicle goes backwards"
RATES = {
    "vx": "how fast x changes",
    "vy": "how fast y changes",
    "speed": "how fast the vehicle goes the way it looks, negative backwards",
    "yaw_rate": "how fast the heading grows",
}


# long: one reading after the other
def implausible(log: Log, where: Mapping[str, Column], rolls: bool) -> list[Fault]:
    """Columns that cannot be in the unit they are taken for, by the others; what `rolls` goes the way it looks."""

    def suspect(name: str, looks: str, why: str) -> Fault:
        column, taken = where[name].words, where[name].unit or "SI"
        mended = f'{{ column = "{column}", unit = "{looks}" }}'
        rule = f"in the unit it is taken for: {why}; if it is in {looks}, say {mended}"
        return Fault(f"identify.columns.{name}", f"{column} in {taken}", rule)

    if wild := _wild(log, where):
        return wild
    if log.step >= 1.0:
        unit = "ms" if log.step < 1e3 else "us" if log.step < 1e6 else "ns"
        return [suspect("t", unit, f"rows are {log.step:g} s apart, too far for a control loop")]
    if log.step < 1e-4:
        return [suspect("t", "s", f"rows are {log.step:g} s apart, closer than any control loop")]
    pose = np.column_stack([log.measured[name] for name in POSE])
    rows = np.asarray(np.isfinite(pose).all(axis=1))
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
    noise = white_noise(list(path.T))
    goes = rolls and any(shifts(value, log.step) for value in path.T)
    sound = ~leaps(log)[rows][:, [list(log.measured).index(name) for name in POSE[:2]]].any(axis=1)
    reading = _reading(path[sound], heading[sound], noise) if goes else AS_GIVEN
    if reading.degrees or jumps:
        why = "as radians it fits neither the way the vehicle goes nor a whole turn"
        faults.append(suspect("heading", "deg", why))
    if reading.words:
        rule = f"along the way that the vehicle goes, forwards or backwards; {reading.words}"
        faults.append(Fault("identify.columns.heading", f"{where['heading'].words} of {log.name}", rule))
    return faults or _rates(log, where, rows, suspect)


def _wild(log: Log, where: Mapping[str, Column]) -> list[Fault]:
    """Commands so far beyond the usual ones that they stand for something else; measurements like that are outliers."""
    faults = []
    for name, given in zip(log.sent.names, log.sent.values.T, strict=True):
        u = np.abs(given)
        usual = float(np.median(u[u > 0])) if np.any(u > 0) else 0.0
        if u.max() > WILD * usual:
            at = f"{given[u.argmax()]:g} at t = {log.t[u.argmax()]:g} s of {log.name}"
            rule = f"a command at most {WILD:g} times as large as is usual, {usual:g}; a row without one is left out"
            faults.append(Fault(f"identify.columns.{name}", f"{where[name].column}: {at}", rule))
    return faults


def _rates(log: Log, where: Mapping[str, Column], rows: np.ndarray, suspect: Callable[..., Fault]) -> list[Fault]:
    """Velocities that are not what the pose says: of another unit, sign or frame."""
    t, x, y, heading = log.t[rows], *(log.measured[name][rows] for name in POSE)
    heading, faults = np.unwrap(heading), []
    vx, vy, turn = (_smooth_rate(t, value) for value in (x, y, heading))
    along, across = vx * np.cos(heading) + vy * np.sin(heading), vy * np.cos(heading) - vx * np.sin(heading)
    forth = np.hypot(vx, vy)
    readings = {  # what a channel may be, the first of them what it is taken for
        "vx": {"": vx, BODY: along, "x and y are exchanged": vy, OTHER: -vx},
        "vy": {"": vy, BODY: across, "x and y are exchanged": vx, OTHER: -vy},
        "speed": {"": along, UNSIGNED: forth, OTHER: -along},
        "yaw_rate": {"": turn, OTHER: -turn},
    }
    for name in [name for name in readings if name in log.measured]:
        seen, ways = log.measured[name][rows], readings[name]
        least = CLEAR * _noise_of_rate(heading if name == "yaw_rate" else x, log.step)
        size = np.abs(turn) if name == "yaw_rate" else forth
        if np.nanquantile(size, 0.8) < least:
            continue  # the pose says too little of it
        if guess := _unit_of(_ratio(seen, ways[""]), name):
            faults += [] if where[name].unit else [suspect(name, *guess)]  # a stated unit is believed
            continue
        off = {words: _off(seen, rate, size, least) for words, rate in ways.items()}
        best = min(off, key=lambda words: off[words])
        lost = name == "speed" and np.nanmin(seen) > -least and np.mean(along[np.isfinite(along)] < -least) > BACK
        if lost:
            faults.append(_not_the_rate(name, where[name].column, log, UNSIGNED))
        elif off[""] > WRONG and off[best] < WRONG / 2:
            faults.append(_not_the_rate(name, where[name].column, log, best))
        elif off[""] > LOST:
            faults.append(_not_the_rate(name, where[name].column, log, "it fits no sign and no frame"))
    return faults


def _off(seen: np.ndarray, rate: np.ndarray, size: np.ndarray, least: float) -> float:
    """How far measurements usually are from a rate, relative to the motion, where that is clear; 0 if it never is."""
    both = np.isfinite(seen) & np.isfinite(rate) & (size > max(least, 0.2 * float(np.nanquantile(size, 0.8))))
    return float(np.median(np.abs(seen - rate)[both] / size[both])) if both.sum() >= LEAST_ROWS else 0.0


def _not_the_rate(name: str, column: str, log: Log, words: str) -> Fault:
    rule = f"what x, y and heading say that it is, {RATES[name]}; {words}"
    mended = f'{name} = {{ column = "{column}", factor = -1 }}' if words == OTHER else ""
    mended = 'speed = "NAME OF THE FORWARD ONE", vx = "", vy = "" if it is' if words == BODY else mended
    mended = mended or f'{name} = "" to leave it out'
    return Fault(f"identify.columns.{name}", f"{column} of {log.name}", f"{rule}; in [identify.columns] say {mended}")


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
    return white_noise([value]) * np.sqrt(2) / (6 * step)


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
AS_QUATERNION = 'heading = { quaternion = ["qx", "qy", "qz", "qw"] }, or its z and w alone'
ASTRAY = "it is not, nor clockwise, in degrees or with x and y exchanged; of a quaternion it is 2 atan2(z, w): say "
ASTRAY += AS_QUATERNION
PART = f"it is where the column is z of a quaternion: say {AS_QUATERNION}"
TURNED = {  # other conventions, and what they make of an angle
    "": lambda h: h,
    'it is where x and y are exchanged (x = "y", y = "x"), or heading counts clockwise from the y axis, as a compass'
    ' does (x = "y", y = { column = "x", factor = -1 }, and factor = -1 for heading)': lambda h: np.pi / 2 - h,
    "it is where heading counts clockwise, or one of x and y has the other sign (factor = -1)": lambda h: -h,
    "it is where x and y, or the heading, are turned by a quarter, 1.5708 rad to one side"
    ' (x = "y", y = { column = "x", factor = -1 }, or the other way round)': lambda h: h + np.pi / 2,
}
SKEW = 0.05  # rad, between where a vehicle looks and where it goes: more is another frame, or a sensor mounted so
HALF = 3.0  # times closer it comes with twice the angle, to be taken for a part of a quaternion
TIED = 0.6  # square of the correlation of way and turn, as on a circle, from which neither tells the angle
FEW, SHARP = 5, 0.5  # stretches by which a heading can be judged; rad, a turn within one that says too little


def _reading(path: np.ndarray, heading: np.ndarray, noise: float) -> HeadingReading:
    """The way of reading under which a heading fits the way the vehicle goes, where the given one does not at all.

    Args:
        path: positions (N, 2) [m].
        heading: as it is taken (N,) [rad].
        noise: of the positions, standard deviation [m].
    """
    picked, last = [], 0  # ends of stretches of at least 2 % of the size of the path, so that noise does not count
    least = max(0.02 * float(np.ptp(path, axis=0).max()), 3 * CLEAR * noise, 1e-9)
    for i in range(path.shape[0]):
        if np.linalg.norm(path[i] - path[last]) >= least:
            picked.append((last, i))
            last = i
    if len(picked) < FEW:
        return AS_GIVEN
    first, last = np.array(picked).T
    moved, off = path[last] - path[first], {}
    for degrees in (False, True):
        for words, turn in TURNED.items():
            h = turn(np.deg2rad(heading) if degrees else heading)
            off[HeadingReading(degrees, words)] = _aside(moved, h[first], h[(first + last) // 2], h[last])
    best = min(off, key=lambda reading: off[reading])
    if off[AS_GIVEN] > WRONG and off[best] < WRONG / 2:
        return best
    if np.abs(heading).max() <= 1:
        h = 2 * np.arcsin(heading)
        if _aside(moved, h[first], h[(first + last) // 2], h[last]) * HALF < off[AS_GIVEN] > SKEW:
            return HeadingReading(False, PART)
    turned, middle = np.arcsin(np.sin(0.5 * (heading[last] - heading[first]))), heading[(first + last) // 2]
    straight = np.abs(np.sin(np.arctan2(moved[:, 1], moved[:, 0]) - middle))[np.abs(turned) < SHARP / 2]
    astray = straight.size >= FEW and np.median(straight) > WRONG
    if skew := _skew(moved, middle, 2 * turned):
        return HeadingReading(False, f"it is off by the same angle throughout: add {skew:.2g} rad to the column")
    return HeadingReading(False, ASTRAY) if off[AS_GIVEN] > WRONG and astray else AS_GIVEN


def _aside(moved: np.ndarray, begins: np.ndarray, middle: np.ndarray, ends: np.ndarray) -> float:
    """How far to the side of where it looks a vehicle usually goes, as a share of its way, along stretches (n, 2).

    What its reference point swings out by, being ahead of the axle that rolls, is not counted.
    """
    turned = np.asarray(wrap(jnp.asarray(ends - begins)))
    aside = moved[:, 1] * np.cos(middle) - moved[:, 0] * np.sin(middle)
    ahead = aside @ turned / max(turned @ turned, 1e-12)  # m
    return float(np.median(np.abs(aside - ahead * turned) / np.linalg.norm(moved, axis=1)))


def _skew(moved: np.ndarray, middle: np.ndarray, turned: np.ndarray) -> float:
    """By how much [rad] a vehicle goes to the left of where it looks, however it turns; 0 where that is not clear."""
    along = moved[:, 0] * np.cos(middle) + moved[:, 1] * np.sin(middle)
    aside = moved[:, 1] * np.cos(middle) - moved[:, 0] * np.sin(middle)
    table, kept = np.column_stack([along, turned]), np.abs(turned) < SHARP / 2
    slope, square, usual = np.zeros(2), np.eye(2), 0.0
    for _ in range(3):  # the second column is what the reference point swings out by; without outliers
        square = table[kept].T @ table[kept]
        if kept.sum() < 2 * FEW or square[0, 1] ** 2 > TIED * square[0, 0] * square[1, 1]:
            return 0.0
        slope = np.linalg.lstsq(table[kept], aside[kept], rcond=None)[0]  # of a drive that never turns it has one part
        left = np.abs(aside - table @ slope)
        usual = float(np.median(left[kept]))
        kept &= left <= CLEAR * max(usual, 1e-12)
    deviation = 1.4826 * usual * np.sqrt(np.linalg.pinv(square)[0, 0])
    return float(np.arctan(slope[0])) if abs(slope[0]) > max(SKEW, CLEAR * deviation) else 0.0
