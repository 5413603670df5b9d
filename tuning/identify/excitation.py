"""A drive that would tell deadzones best: forth and back and to both sides, its frequencies chosen for what they tell.

Speed and yaw rate are sums of sines around 0, so that the vehicle stays where it is on the whole, uses both sides of
every actuator, and crosses every level of command; now and then it stands. The inputs are what the plant needs for
that, its deadzones undone as far as they are known. Of many such drives the one is taken after which the deadzones
would be known best.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import agvjax

from .fit import Search, information, weighed
from .log import Log
from .model import Model, compiled
from .parameters import Parameter
from .segments import Segments, cut
from .states import first_states
from .verdict import Z95, inverse

SINES = 3  # in speed and in yaw rate
SLOWEST, FASTEST = 0.3, 3.0  # rad/s
LEAST, RISE = 0.3, 2.0  # of a sine's weight beside the others; s, from rest
EVERY, REST, EASE = 10.0, 2.0, 0.5  # s: from rest to rest, at rest, and of coming to rest and setting off
FAR = 1e12  # of what is worth nothing
SHARES = (0.5, 1.0)  # of the allowed speed and yaw rate that a candidate may use


class Drive(NamedTuple):
    """A suggested drive, and what it would tell."""

    t: np.ndarray  # (N,), s
    commands: tuple[str, ...]
    inputs: np.ndarray  # (N, m), to be held from row to row
    path: np.ndarray  # (N, 2), m, where the scenario says that it leads
    heading: np.ndarray  # (N,), rad
    expected: dict[str, float]  # half of the 95 % interval that each parameter would have
    candidates: int


class Room(NamedTuple):
    """Within what limits a suggested drive must stay."""

    speed: float  # m/s
    yaw_rate: float  # rad/s
    limits: tuple[float, ...]  # of each command; infinite where none
    extent: float  # m, along x and y; exceeded only where no candidate keeps to it
    duration: float  # s
    period: float  # s, between commands


@dataclasses.dataclass(frozen=True)
class Designer:
    """Drives for one scenario, and what they would tell of its parameters p, measured with deviations `sigma` (C,)."""

    model: Model
    parameters: Sequence[Parameter]
    p: np.ndarray
    sigma: np.ndarray
    room: Room
    length: float  # of a stretch, s
    memory: float  # of the actuators, s

    @functools.cached_property
    def predict(self) -> Callable[..., Array]:
        """What a drive looks like; compiled once."""
        return jax.jit(self.model.predict)

    def suggest(self, candidates: int, seed: int, tick: Callable[[str], object] = lambda text: None) -> Drive:
        """The best of so many candidates: that after which the deadzones, or else all parameters, are known best."""
        from scipy.stats import qmc  # late: a second that few runs need

        judged = np.array([q.name.startswith("deadzone.") for q in self.parameters])
        judged = judged if judged.any() else ~judged
        size = np.maximum(np.abs(self.p), [max(q.floor, 1e-6) for q in self.parameters])
        points = qmc.Sobol(2 * (3 * SINES + 1), rng=seed).random_base2(int(np.ceil(np.log2(max(candidates, 2)))))
        scenario, best, worth = self.model.at(jnp.asarray(self.p)), None, np.inf
        for k, share in enumerate(points[:candidates]):
            log = self.driven(*candidate(scenario, self.room, share))
            half = self.expected(log)
            path = np.column_stack([log.measured["x"], log.measured["y"]])
            beyond = max(float(np.ptp(path, axis=0).max()) - self.room.extent, 0.0)
            value = float(np.mean((half / size)[judged] ** 2)) if beyond == 0 else FAR * (1 + beyond)
            if value < worth:
                intervals = dict(zip((q.name for q in self.parameters), half.tolist(), strict=True))
                heading, worth = log.measured["heading"], value
                best = Drive(log.t, log.commands, log.inputs, path, heading, intervals, candidates)
            tick(f"drive {k + 1} of {candidates}")
        if best is None:
            rule = "so low that the model of the vehicle can be computed along at least one of identify.drives"
            raise agvjax.InputError([agvjax.Fault("identify.speed", self.room.speed, rule)])
        return best

    def driven(self, t: np.ndarray, inputs: np.ndarray) -> Log:
        """A drive from rest as the scenario has it: a log without noise."""
        steps, nothing = np.append(np.diff(t), t[-1] - t[-2]), np.zeros((t.size, len(self.model.channels)))
        live, rows, first = np.ones(t.size), np.arange(t.size), np.zeros((), int)
        stretch = Segments(t, steps, inputs, live, seen=nothing, weight=nothing, rows=rows, log=first)
        still = self.model.start(jnp.array([0.0, 0.0, 0.0, 1e-6, 0.0, 0.0]))
        seen = np.asarray(self.predict(jnp.asarray(self.p), still, stretch))
        return Log("drive", 0.0, t, inputs, self.model.commands, dict(zip(self.model.channels, seen.T, strict=True)))

    def expected(self, log: Log) -> np.ndarray:
        """Half of the 95 % interval of each parameter (P,) after a drive."""
        run_up = self.model.run_up(self.memory)
        segments = weighed(cut([log], self.length, self.memory, np.inf, before=run_up)[0], self.sigma)
        states = first_states(self.model, [log], segments)
        sums = Search(compiled(self.model), segments, self.parameters, states).sums(self.p)
        return Z95 * np.sqrt(np.diag(inverse(information(sums, self.parameters))))


def candidate(scenario: agvjax.Scenario, room: Room, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Instants and inputs of one candidate, from numbers in [0, 1)."""
    t = np.arange(round(room.duration / room.period) + 1) * room.period
    first, second = share.reshape(2, -1)
    v, a = _sines(t, first, room.speed)
    w, alpha = _sines(t, second, room.yaw_rate)
    moves, rate = _moving(t)
    v, a, w, alpha = moves * v, moves * a + rate * v, moves * w, moves * alpha + rate * w
    needed = scenario.plant.needs(motion(t, v, w, a, alpha))
    columns = []
    for name, limit in zip(scenario.plant.actuators, room.limits, strict=True):
        dead = agvjax.leaves(scenario.deadzone[name])
        d = np.asarray(needed[name], float)
        right = d / float(dead["slope_right"]) + float(dead["threshold_right"])
        left = d / float(dead["slope_left"]) - float(dead["threshold_left"])
        columns.append(np.clip(np.where(d > 0, right, np.where(d < 0, left, 0.0)), -limit, limit))
    return t, np.column_stack(columns)


def motion(t: np.ndarray, v: np.ndarray, w: np.ndarray, a: np.ndarray, alpha: np.ndarray) -> agvjax.Motion:
    """A motion of speed v, yaw rate w and their rates (N,), as every kind of plant is asked what it needs for it."""
    heading = np.r_[0.0, np.cumsum(w[:-1] * np.diff(t))]
    forth = np.column_stack([np.cos(heading), np.sin(heading)])
    velocity, nothing = v[:, None] * forth, np.zeros_like(forth)
    asked = agvjax.Reference(
        position=jnp.asarray(nothing),
        velocity=jnp.asarray(velocity),
        acceleration=jnp.asarray(nothing),
        heading=jnp.asarray(heading),
        heading_rate=jnp.asarray(w),
    )
    return agvjax.Motion(v, w, a, alpha, asked)


def _moving(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """1 while it moves and 0 while it stands, and the derivative; a rest ends every `EVERY` seconds.

    What moves all the while does not tell a drift from thresholds that differ from side to side.
    """
    left = t - EVERY * np.floor(t / EVERY) - (EVERY - REST)  # since the rest began [s]
    ease = np.clip(np.minimum(-left, left + EVERY - REST) / EASE, 0, 1) * np.pi
    rate = np.where(left < -(EVERY - REST) / 2, 1.0, -1.0) * np.sin(ease) * np.pi / (2 * EASE)
    return (1 - np.cos(ease)) / 2, np.where((ease > 0) & (ease < np.pi), rate, 0.0)


def _sines(t: np.ndarray, share: np.ndarray, most: float) -> tuple[np.ndarray, np.ndarray]:
    """A sum of sines that begins at rest and stays within `most`, and its derivative."""
    place, phase, weight = share[: 3 * SINES].reshape(3, SINES)
    omega = SLOWEST * (FASTEST / SLOWEST) ** ((np.arange(SINES) + place) / SINES)
    angle = omega * t[:, None] + 2 * np.pi * phase
    weight = LEAST + weight
    value, rate = np.sin(angle) @ weight, np.cos(angle) @ (weight * omega)
    rise = np.clip(t / RISE, 0, 1)
    value, rate = rise * value, rise * rate + np.where(t < RISE, value / RISE, 0.0)
    size = most * (SHARES[0] + (SHARES[1] - SHARES[0]) * share[-1]) / np.abs(value).max()
    return size * value, size * rate
