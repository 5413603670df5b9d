"""A recorded drive, and how several go together."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

import agvjax
from agvjax import Fault

POSE = ("x", "y", "heading")
MEASURED = (*POSE, "vx", "vy", "speed", "yaw_rate", "steering_angle")  # m, m, rad, m/s, m/s, m/s, rad/s, rad
LEAST_ROWS = 50
CLEAR = 12.0  # deviations between the lowest and the highest of many medians, from which they differ


class Sent(NamedTuple):
    """Commands as a file has them, and what inputs of the plant they are."""

    names: tuple[str, ...]  # of the columns, k of them
    values: np.ndarray  # (N, k)
    inputs: Callable[[np.ndarray], np.ndarray]  # of such numbers


class Log(NamedTuple):
    """A drive. What was commanded in a row holds until the next one."""

    name: str
    origin: float  # s, the time of the first row by the clock of the file
    t: np.ndarray  # (N,), s, since the first row, or since that of the first of several logs with one clock
    inputs: np.ndarray  # (N, m), in the order of the plant's actuators
    commands: tuple[str, ...]  # names of the inputs
    measured: dict[str, np.ndarray]  # by channel (N,); NaN where nothing was measured
    spoken: Sent | None = None  # None: the file has the inputs themselves, by their own names
    notes: tuple[str, ...] = ()  # how it was read, a sentence each

    @property
    def sent(self) -> Sent:
        """The commands as the file has them."""
        return self.spoken or Sent(self.commands, self.inputs, lambda values: values)

    @property
    def step(self) -> float:
        """The usual time from row to row [s]."""
        return float(np.median(np.diff(self.t)))


def commands_of(plant: agvjax.Plant) -> tuple[str, ...]:
    """The columns of a plant's inputs: the names of its actuators, two for one that takes a vector."""
    zeros: dict[str, Any] = dict.fromkeys(plant.actuators, np.zeros(()))
    zeros |= {"position": np.zeros(2)} if plant.feedthrough else {}
    seen = plant.output(plant.start(agvjax.Start()), zeros)
    asked = plant.allocate(agvjax.Command(position=jnp.zeros(2), heading=jnp.zeros(()), twist=jnp.zeros(2)), seen)
    columns = [[f"{name}_x", f"{name}_y"] if np.ndim(asked[name]) else [name] for name in plant.actuators]
    return tuple(itertools.chain(*columns))


def in_files(commands: Sequence[str]) -> tuple[str, ...]:
    """The names of commands in a file, where what is measured may have the same name: `speed_cmd` beside `speed`."""
    return tuple(f"{name}_cmd" if name in MEASURED else name for name in commands)


def columns_of(commands: Sequence[str], actuator: str) -> list[int]:
    """Where among the names of the inputs those of an actuator are: one, or two for one that takes a vector."""
    return [i for i, c in enumerate(commands) if c in (actuator, f"{actuator}_x", f"{actuator}_y")]


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


def white_noise(values: Sequence[np.ndarray]) -> float:
    """Standard deviation of the noise in drives' measurements of one kind, whose value and slope change smoothly."""
    third = np.abs(np.concatenate([np.diff(x[np.isfinite(x)], 3) for x in values]))  # of noise: sqrt(20) times as large
    return float(1.4826 * np.median(third) / np.sqrt(20)) if third.size else np.nan


def same_drive(one: Log, other: Log) -> bool:
    """Whether most rows of the shorter log are in the other one too, at whatever time."""
    tables = (np.column_stack([log.measured["x"], log.measured["y"], log.inputs]) for log in (one, other))
    rows = [set(map(tuple, table[np.isfinite(table).all(axis=1)].tolist())) for table in tables]
    return 2 * len(rows[0] & rows[1]) > min(map(len, rows))


def moved(log: Log) -> bool:
    """Whether anything that is measured changes by more than its noise."""
    return any(shifts(value, log.step) for value in log.measured.values())


def shifts(value: np.ndarray, step: float) -> bool:
    """Whether measurements (N,) every `step` [s] change by more than their noise, second by second."""
    fine = value[np.isfinite(value)]
    count = max(4, round(1 / step))  # rows
    if fine.size < 2 * count:
        return False
    third = np.abs(np.diff(fine, 3)) / np.sqrt(20)
    noise = max(white_noise([fine]), float(np.quantile(third, 0.95)) / 1.96)  # of a coarse sensor most are 0
    middle = np.median(fine[: fine.size // count * count].reshape(-1, count), axis=1)
    return bool(np.ptp(middle) > CLEAR * max(noise / np.sqrt(count), 1e-9 * float(np.abs(middle).max())))
