"""What a scenario says that a drive must have looked like: the plant under the logged inputs, stretch by stretch."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, ArrayLike, Float, PyTree

import agvjax
from agvjax.engine import loop
from agvjax.geometry import into_body, wrap
from agvjax.plants.base import BaseState, Driven
from agvjax.protocols import Inputs, Plant

from .log import columns_of
from .parameters import parts_of
from .segments import Segments

CHUNK = 16  # stretches computed together
SHARES = (1.0, 0.25, 0.0625)  # of a step of a stretch's state, the longest first
DAMPED = 0.1  # what a yaw rate must move by with the state to tell it: at a standstill a steering angle tells none
INSTANT = 1e-7  # s, no time at all
RUN_UP = 4.0  # memories, for which motors have run when a stretch begins
EASE = 1e-9  # of the normal matrix's own size, added so that a state nobody measured stays where it was guessed


def channels(
    plant: Plant, state: PyTree, delivered: Inputs, names: Sequence[str], sensor: agvjax.Mounted | None = None
) -> Float[Array, " C"]:
    """What is measured of a vehicle in some state, by channel; `sensor` is where it is measured, without its noise."""
    seen = plant.output(state, delivered)
    seen = seen if sensor is None else sensor.seen(seen)
    along, _ = into_body(seen.velocity, seen.heading)
    values: Inputs = {"x": seen.position[0], "y": seen.position[1], "heading": seen.heading}
    values |= {"vx": seen.velocity[0], "vy": seen.velocity[1], "speed": along}
    values |= {"yaw_rate": seen.yaw_rate}
    if (angle := steered(plant, state, seen)) is not None:
        values |= {"steering_angle": angle}
    return jnp.stack([values[name] for name in names])


def steered(plant: Plant, state: PyTree, seen: agvjax.Measurement) -> Array | None:
    """The angle [rad] of the wheel that is steered; None where none is. No law is told that of an `Ackermann`."""
    return state.reached[1] if isinstance(plant, agvjax.Ackermann) else seen.steering_angle


def steers(plant: Plant) -> bool:
    """Whether it has such an angle; computes nothing."""

    def angle() -> Array | None:
        state = plant.start(agvjax.Start())
        return steered(plant, state, plant.output(state, dict.fromkeys(plant.actuators, jnp.zeros(()))))

    return jax.eval_shape(angle) is not None


class Model(NamedTuple):
    """A scenario whose named leaves are parameters, and the measurements it is compared with."""

    scenario: agvjax.Scenario
    names: tuple[str, ...]
    channels: tuple[str, ...]
    commands: tuple[str, ...]
    substeps: int

    @property
    def driven(self) -> bool:
        """Whether it is driven by motors of its own, whose speed follows from the commands alone."""
        return isinstance(self.scenario.plant, Driven)

    @property
    def begun(self) -> int:
        """How many numbers of the state that a stretch begins in are free: of the driven only the pose."""
        return 3 if self.driven else self.start(jnp.zeros(6)).size

    def run_up(self, memory: float) -> float:
        """How long [s] before a stretch commands are wanted, where actuators remember them for `memory` [s]."""
        return RUN_UP * memory if self.driven else memory

    def at(self, p: Float[Array, " P"]) -> agvjax.Scenario:
        """The scenario with these parameters."""
        return agvjax.replace(self.scenario, dict(zip(self.names, p, strict=True)))

    def start(self, measured: Float[Array, "6"]) -> Float[Array, " n"]:
        """The plant's state, flat, for x, y, heading, vx, vy and yaw rate.

        What `Plant.seen` of a plant of one's own makes of a measurement may leave the yaw rate out. Where the state
        tells one, it is moved until that is as measured and the rest stays: a vehicle that spins would else be a turn
        off before a stretch ends.
        """
        plant = self.scenario.plant
        told = agvjax.Measurement(
            position=measured[:2], velocity=measured[3:5], heading=measured[2], yaw_rate=measured[5]
        )
        flat, unflatten = ravel_pytree(plant.seen(told))
        columns = {name: columns_of(self.commands, name) for name in plant.actuators}
        still = self.split(jnp.zeros(sum(map(len, columns.values())), flat.dtype))

        def seen(s: Float[Array, " n"]) -> Float[Array, "6"]:
            return channels(plant, unflatten(s), still, ("x", "y", "heading", "vx", "vy", "yaw_rate"))

        J, missing = jax.jacfwd(seen)(flat), jnp.zeros(6, flat.dtype).at[5].set(measured[5] - seen(flat)[5])
        return flat + J.T @ jnp.linalg.solve(J @ J.T + DAMPED**2 * jnp.eye(6, dtype=flat.dtype), missing)

    def split(self, u: Float[Array, " m"]) -> Inputs:
        """Inputs by actuator."""
        columns = {name: columns_of(self.commands, name) for name in self.scenario.plant.actuators}
        return {name: u[places[0]] if len(places) == 1 else u[jnp.array(places)] for name, places in columns.items()}

    def predict(self, p: Float[Array, " P"], s: Float[Array, " n"], stretch: Segments) -> Float[Array, "K C"]:
        """What would have been measured at the rows of one stretch that begins in state s."""
        scenario, late = prompt(self.at(p))
        plant, sensor = scenario.plant, scenario.sensor if isinstance(scenario.sensor, agvjax.Mounted) else None
        zero = jnp.zeros((), s.dtype)
        blank = agvjax.Start(position=zero + jnp.zeros(2), velocity=zero + jnp.ones(2), heading=zero)
        unflatten = ravel_pytree(plant.start(blank))[1]
        parts = {name: loop.actuator(scenario, name) for name in plant.actuators}
        first = self.split(stretch.inputs[0])
        flows = {name: part.init(first[name]) for name, part in parts.items()}
        memories = {name: part.hold(first[name]) for name, part in parts.items()}
        begins, lengths, inputs = arrivals(stretch, self.substeps, self.split, late)

        def row(carry: PyTree, now: tuple[Array, Array, Array, Inputs, Array]) -> tuple[PyTree, Array]:
            t, first, steps, held, live = now

            def step(carry: PyTree, part: tuple[Array, Array, Inputs]) -> tuple[PyTree, Array]:
                (state, flow, memory), (begin, h, u) = carry, part

                def rate(x: PyTree, signal: PyTree) -> tuple[PyTree, Inputs]:
                    (state, flow), (time, memory) = x, signal
                    answers = {n: part.deliver(flow[n], memory[n], u[n]) for n, part in parts.items()}
                    delivered = {n: answer[0] for n, answer in answers.items()}
                    moved = plant.derivative(state, (), delivered, scenario.disturbance(time))
                    moved = _moving(moved, live)
                    return (moved, {n: answer[1] for n, answer in answers.items()}), delivered

                memory = {n: part.jump(flow[n], memory[n], u[n], h) for n, part in parts.items()}
                signals = [(t + begin + node * h, memory) for node in agvjax.RK4.nodes]
                (after, flow), delivered = agvjax.RK4.advance(rate, (state, flow), h, signals)
                return (after, flow, memory), channels(plant, state, delivered, self.channels, sensor)

            carry, seen = jax.lax.scan(step, carry, (first, steps, held))
            return carry, seen[0]

        rows: Any = (stretch.t, begins, lengths, inputs, stretch.live)
        sent = {n: part.deliver(flows[n], memories[n], first[n])[0] for n, part in parts.items()}
        state = self._begun(unflatten(s), sent, stretch)
        return jax.lax.scan(row, (state, flows, memories), rows)[1]

    def _begun(self, state: PyTree, sent: Inputs, stretch: Segments) -> PyTree:
        """The state with its motors as fast as they are sent, unless nothing is known of what they were sent before.

        From there they run from the commands before the stretch. Were they free, a slow motor would explain whatever
        the model lacks in speed and turning in every stretch anew, and the fit would find one, however fast the true
        one is. Where a log begins they are free.
        """
        if not self.driven:
            return state
        steady = jnp.stack([sent[name] for name in self.scenario.plant.actuators])
        alone = (stretch.live[0] > 0) | (stretch.rows[0] == 0)
        return dataclasses.replace(state, reached=jnp.where(alone, state.reached, steady))

    def residual(self, p: Float[Array, " P"], s: Float[Array, " n"], stretch: Segments) -> Float[Array, "K C"]:
        """Measured less predicted, headings by the shorter way round."""
        off = stretch.seen - self.predict(p, s, stretch)
        turns = np.array([name == "heading" for name in self.channels])
        return jnp.where(jnp.asarray(turns)[None], wrap(jnp.asarray(off)), off)


def _moving(rates: PyTree, live: Array) -> PyTree:
    """Rates of a state: of actuators and motors alone where `live` is 0, of everything where it is 1."""
    moved = jax.tree.map(lambda dx: live * dx, rates)
    return dataclasses.replace(moved, reached=rates.reached) if isinstance(rates, BaseState) else moved


def prompt(scenario: agvjax.Scenario) -> tuple[agvjax.Scenario, dict[str, Array]]:
    """The scenario without its delays, and how late [s] the commands of each actuator come.

    What a line of actuators makes of late commands is late: a log's commands are all known, so that no element has to
    remember them. A delay that jitters stays an element.
    """
    chains, late = {}, {}
    for name, chain in scenario.actuators.items():
        kept = {}
        for key, part in parts_of(chain).items():
            if isinstance(part, agvjax.Delay) and _steady(part):
                late[name] = late.get(name, 0.0) + jnp.asarray(part.time)
            else:
                kept[key] = part
        chains[name] = agvjax.Chain(**kept)
    return dataclasses.replace(scenario, actuators=chains), late


def _steady(delay: agvjax.Delay) -> bool:
    """Whether it never jitters."""
    return not isinstance(delay.jitter, Tracer) and float(delay.jitter) == 0


def arrivals(
    stretch: Segments, substeps: int, split: Callable[[Array], Inputs], late: dict[str, Array]
) -> tuple[Array, Array, Inputs]:
    """The parts of every row within which nothing arrives: their begins and lengths (K, n) [s], what has arrived.

    A command that came within a step would have its effect rounded to the step's end, or through a limit of the
    acceleration to something between: the drive would hardly change with a delay but for leaps. Each comes another
    INSTANT later than it should, so that none comes together with another one or with the begin of a step: there the
    slope would be lost.
    """
    late = {name: time + (i + 1) * INSTANT for i, (name, time) in enumerate(late.items())}
    t, h = jax.lax.cummax(jnp.asarray(stretch.t)), jnp.asarray(stretch.h)  # rows that fill up have no time
    marks = [h[:, None] * jnp.asarray(np.arange(substeps) / substeps, h.dtype)[None]]
    for time in late.values():
        after = jnp.searchsorted(t, t - time + INSTANT / 2, side="right")  # the command that comes next
        there = jnp.where(after < t.size, t[jnp.minimum(after, t.size - 1)] + time - t, h)
        marks.append(jnp.clip(there, 0.0, h)[:, None])
    begins = jnp.sort(jnp.concatenate(marks, axis=1), axis=1)
    lengths = jnp.diff(begins, axis=1, append=h[:, None]) + INSTANT**2  # none is 0: some elements divide by it
    inputs = {}
    for name, own in split(jnp.asarray(stretch.inputs).T).items():
        held = jnp.moveaxis(own, -1, 0)  # (K, ...)
        came = t[:, None] + begins - late.get(name, 0.0) + INSTANT / 2
        at = jnp.searchsorted(t, came.ravel(), side="right").reshape(came.shape) - 1
        before = at.reshape(at.shape + (1,) * (held.ndim - 1)) < 0
        sent = jnp.where(stretch.rows[0] > 0, held[0], 0.0)  # before what is known: the same; before a log nothing
        inputs[name] = jnp.where(before, sent, held[jnp.maximum(at, 0)])
    return begins, lengths, inputs


class Sums(NamedTuple):
    """What each stretch says of the parameters once its own state has been chosen best, S first."""

    matrix: np.ndarray  # (S, P, P), Gauss-Newton, with the weights it was asked with
    slope: np.ndarray  # (S, P), of half the sum of squares
    cost: np.ndarray  # (S,), the sum of squares
    states: np.ndarray  # (S, n), the states to begin in
    residual: np.ndarray  # (S, K, C), unweighted


Says = Callable[[ArrayLike, ArrayLike, Segments], Sums]  # parameters (P,), states (S, n), stretches


@functools.lru_cache(2)
def compiled(model: Model) -> Says:
    """(parameters (P,), states (S, n), stretches) -> what they say, the states one Gauss-Newton step better.

    A step that would make a stretch worse is shortened, and left out where no length of it helps.
    """

    def one(p: Array, s: Array, stretch: Segments) -> Sums:
        size, weight = p.size, jnp.sqrt(stretch.weight)

        def off(z: Array) -> tuple[Array, tuple[Array, Array]]:
            plain = model.residual(z[:size], z[size:], stretch)
            weighted = (weight * plain).ravel()
            return weighted, (weighted, plain)

        J, (r, plain) = jax.jacfwd(off, has_aux=True)(jnp.concatenate([p, s]))
        both = jnp.concatenate([J[:, :size], r[:, None]], axis=1)
        taken = _solve(J[:, size:], both)
        left = both - J[:, size:] @ taken  # what the state cannot take up
        H = left.T @ left
        after = s[None] - jnp.outer(jnp.asarray(SHARES, s.dtype), taken[:, size])
        costs = jax.vmap(lambda z: jnp.sum((weight * model.residual(p, z, stretch)) ** 2))(after)
        better = jnp.nan_to_num(costs, nan=jnp.inf) < r @ r
        states = jnp.where(better.any(), after[jnp.argmax(better)], s)
        parts: Any = (H[:size, :size], H[:size, size], H[size, size], states, plain)
        return Sums(*parts)

    chunk = jax.jit(jax.vmap(one, in_axes=(None, 0, 0)))

    def run(p: ArrayLike, states: ArrayLike, stretches: Segments) -> Sums:
        count, chunks = len(stretches.t), []
        for first in range(0, count, CHUNK):  # of one shape, so that one compilation serves logs of any length
            rows = np.minimum(np.arange(first, first + CHUNK), count - 1)
            part = Segments(*(np.asarray(x)[rows] for x in stretches))
            chunks.append(jax.device_get(chunk(jnp.asarray(p), jnp.asarray(states)[rows], part)))
        return Sums(*(np.concatenate(x)[:count] for x in zip(*chunks, strict=True)))

    return run


def _solve(J: Array, b: Array) -> Array:
    """Least squares by the normal equations, scaled; a column of zeros is left at 0."""
    size = jnp.sqrt(jnp.sum(J**2, axis=0))
    scale = jnp.where(size > 0, size, 1.0)
    A = J / scale[None]
    normal = A.T @ A + EASE * jnp.eye(J.shape[1], dtype=J.dtype)
    return jnp.linalg.solve(normal, A.T @ b) / scale[:, None]
