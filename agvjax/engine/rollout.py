"""One closed loop over its steps: tables of what depends on time alone, chunks, freezing of diverged runs."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float, PyTree

from .._pytree import Real, pytree
from ..leaves import cast, misshapen
from ..messages import Reference
from ..paths.heading import default_heading, reference, says
from ..paths.place import Place
from ..protocols import Law
from ..scenario import Scenario
from ..timing import Timing
from . import loop
from .contracts import check_contracts, route_of
from .scalarise import MOST_SCALARS, scalarise, split_tree

CHUNK = 100  # steps, about, whose time-only signals are tabulated at once; also the unit of checkpointing
FEW_CHUNKS = 64  # fewer make one group


@pytree
class Meter:
    """What accumulates over the steps of a run; this one accumulates nothing."""

    def weights(self, t: Array, left: Array, right: Array, end: Array) -> PyTree:
        """What it wants to know of the instant `t`: `left` and `right` [s] to its neighbours, the run's `end` [s]."""
        return ()

    def start(self, sample: loop.Sample) -> PyTree:
        """What is accumulated before the first sample."""
        return ()

    def update(self, tally: PyTree, sample: loop.Sample, weights: PyTree) -> PyTree:
        """The same with one more sample and its weights."""
        return tally


@pytree
class Carry:
    """What one step hands to the next."""

    flow: loop.Flow
    memory: loop.Memory
    ok: Bool[Array, ""]
    meter: PyTree


TimeOnly = tuple[Reference, Array]  # what the path asks for, and the shape of the disturbance


class Row(NamedTuple):
    """What of a step depends on time alone; of several steps with one more leading axis."""

    number: Array  # from 0; the last instant's where there is no further step
    h: Array  # s, its length
    t: Array  # s, instants of the integrator's nodes
    signals: TimeOnly  # at these
    weights: PyTree  # the meter's


class Rollout:
    """One closed loop ready to be stepped: the objects, cast to the run's dtype, and how to step them.

    The weights that the `meter` asks for are tabulated with the other signals that depend on time alone.
    """

    def __init__(
        self,
        controller: Law,
        scenario: Scenario,
        *,
        timing: Timing,
        dtype: DTypeLike | None,
        meter: Meter,
    ):
        if not isinstance(scenario, Scenario):
            kind = type(scenario).__name__
            raise TypeError(f"scenario must be one agvjax.Scenario, after the controller; got {kind}")
        check_contracts(controller, scenario)
        known, kind = set(scenario.plant.actuators), type(scenario.plant).__name__
        if set(scenario.deadzone) != known or not set(scenario.actuators) <= known:
            named = tuple(dict.fromkeys((*scenario.deadzone, *scenario.actuators)))
            raise ValueError(f"{kind} has the actuators {scenario.plant.actuators}; the scenario has {named}")
        self.dtype = jnp.dtype(jnp.result_type(float) if dtype is None else dtype)
        self.controller, self.scenario, self.meter = (cast(x, self.dtype) for x in (controller, scenario, meter))
        for name, tree in (("controller", self.controller), ("scenario", self.scenario)):
            if wrong := misshapen(tree):
                raise ValueError(f"{name}.{wrong}")
        self.dt = jnp.asarray(timing.dt, self.dtype)
        self.n_steps, self.every, self.integrator = timing.n_steps, timing.control_every, timing.integrator
        period = self.controller.control_period()
        if period is not None:
            if timing.control_every != 1:
                rule = "control_every must be 1 for a law with a period of its own"
                raise ValueError(f"{rule}; got {timing.control_every}")
            self.every = jnp.maximum(jnp.round(period / self.dt), 1).astype(int)
        self.end = self.dt * timing.n_steps

        path, disturbance = self.scenario.path, self.scenario.disturbance
        self.route = route_of(self.controller, path)
        self.heading = default_heading(path) if self.scenario.heading is None else self.scenario.heading
        # what knows the instant nearest to `t` at which a signal jumps
        nearest = functools.partial(self.heading.nearest_jump, path), disturbance.nearest_jump
        self.jumps: list[Callable[[Array], Any]] = list(filter(says, nearest))

    def instant(self, index: Array | int) -> tuple[Array, Array, Array]:
        """When step `index` begins: t = index * dt, moved onto a jump that is within half a step.

        Returns t [s], by how much it was moved, and how far from the jump signals are looked at, before and after it.
        """
        t = jnp.asarray(index).astype(self.dtype) * self.dt
        moved = gap = jnp.zeros_like(t)
        small = float(jnp.finfo(self.dtype).eps) ** 0.5  # a bearing's rate this close to its jump is off by as much
        for nearest_jump in self.jumps:
            away = nearest_jump(t) - t
            near = (-self.dt / 2 < away) & (away <= self.dt / 2)
            moved = jnp.where(near, away, moved)
            gap = jnp.where(near, jnp.minimum(small, self.dt / 4), gap)
        return t + moved, moved, gap

    def weights(self, index: Array | int) -> PyTree:
        """What the meter wants to know of an instant; time-only."""
        (_, before, _), (t, moved, _), (_, after, _) = (self.instant(index + i) for i in (-1, 0, 1))
        return self.meter.weights(t, self.dt + (moved - before), self.dt + (after - moved), self.end)

    def time_only(self, t: Float[Array, ""], side: Real = 0.0) -> TimeOnly:
        """What depends on time alone, and on nothing a batch usually varies; what jumps is looked at `side` [s] off."""
        shape, path = self.scenario.disturbance.shape(t + side), self.scenario.path
        if self.route is not None and self.controller.follows():  # it looks at no clock
            nothing, zero = jnp.zeros(2, t.dtype), jnp.zeros_like(t)
            asked = Reference(position=nothing, velocity=nothing, acceleration=nothing, heading=zero, heading_rate=zero)
        else:
            asked = reference(path, lambda path, time: self.heading(path, time + side), t)
        return (asked if self.route is None else dataclasses.replace(asked, arc=self.route.clock(t)[0])), shape

    def signals(self, t: Float[Array, ""], row: TimeOnly) -> loop.Signals:
        """A row of the table made whole: inside the loop only the disturbance's scale is left to apply."""
        ref, shape = row
        if self.route is not None:
            ref = dataclasses.replace(ref, route=self.route)
        return loop.Signals(time=t, reference=ref, disturbance=self.scenario.disturbance.scale(shape))

    def table(self, first: Array, steps: int) -> Row:
        """Time-only signals of `steps` steps from number `first`, at the nodes of the integrator."""
        return jax.vmap(self.row)(first + jnp.arange(steps))

    def row(self, index: Array) -> Row:
        """All of one step that depends on time alone; past the end that of the last instant, with no weight."""
        past_end, index = index > self.n_steps, jnp.minimum(index, self.n_steps)
        (begin, moved, past), (_, moved_next, short) = self.instant(index), self.instant(index + 1)
        h = self.dt + (moved_next - moved) if self.jumps else self.dt
        nodes = self.integrator.nodes
        t = [begin + node * h if self.jumps else (index.astype(self.dtype) + node) * self.dt for node in nodes]
        sides = [past if node == 0 else -short if node == 1 else jnp.zeros_like(h) for node in nodes]
        t, sides = jnp.stack(t), jnp.stack(sides)
        signals = jax.vmap(self.time_only)(t, sides) if self.jumps else jax.vmap(self.time_only)(t)
        weights = jax.tree.map(lambda x: jnp.where(past_end, jnp.zeros_like(x), x), self.weights(index))
        return Row(index, h, t, signals, weights)

    def begin(self) -> Carry:
        """The first carry."""
        row = self.row(jnp.zeros((), int))
        signals = self.signals(row.t[0], _first(row.signals))
        flow, memory, ok = loop.start(self.controller, self.scenario, signals)
        sample = loop.derivative(self.controller, self.scenario, flow, memory, signals)[1]
        return Carry(flow=flow, memory=memory, ok=ok & (self.dt > 0), meter=self.meter.start(sample))

    def control(self, carry: Carry, index: Array, h: Array, signals: loop.Signals) -> loop.Memory:
        """The memory in force at this step: that of the law renewed where it is a control instant."""
        memory = carry.memory
        if jax.tree.leaves((memory.controller, memory.sensor, memory.route)):
            memory = self._looked(carry, index, signals)
        if jax.tree.leaves((memory.actuators, memory.plant)):
            memory = loop.advance(self.controller, self.scenario, carry.flow, memory, signals, h)
        return memory

    def _looked(self, carry: Carry, index: Array, signals: loop.Signals) -> loop.Memory:
        def renew() -> loop.Memory:
            h = self.dt * jnp.asarray(self.every).astype(self.dtype)
            return loop.jump(self.controller, self.scenario, carry.flow, carry.memory, signals, h)

        if isinstance(self.every, int) and self.every == 1:
            return renew()
        return jax.lax.cond(index % self.every == 0, renew, lambda: carry.memory)

    def step(self, carry: Carry, row: Row) -> tuple[Carry, loop.Sample]:
        """One step: memory, derivative, integrator, freezing of a diverged run. Also returns the sample at its start.

        From the last instant on nothing moves any more: its sample is the same however often it is looked at.
        """
        index, h, t, table, weights = row
        ended = index >= self.n_steps
        nodes = range(len(self.integrator.nodes))
        signals = [self.signals(t[i], jax.tree.map(lambda x, i=i: x[i], table)) for i in nodes]
        memory = self.control(carry, index, h if self.jumps else self.dt, signals[0])

        def rate(flow: loop.Flow, signal: loop.Signals) -> tuple[loop.Flow, loop.Sample]:
            return loop.derivative(self.controller, self.scenario, flow, memory, signal)

        flow, sample = self.integrator.advance(rate, carry.flow, h if self.jumps else self.dt, signals)
        near = memory.route.position if isinstance(memory.route, Place) else signals[-1].reference.position
        ok = carry.ok & (ended | loop.inside(self.scenario, flow.plant, near))
        moves = ok & ~ended
        flow, memory = jax.tree.map(
            lambda new, old: jnp.where(moves, new, old), (flow, memory), (carry.flow, carry.memory)
        )
        return Carry(flow=flow, memory=memory, ok=ok, meter=self.meter.update(carry.meter, sample, weights)), sample

    def _steps(self, carry: Carry, rows: Row) -> Carry:
        """Several steps, number by number where the state is small."""
        if sum(x.size for x in jax.tree.leaves(carry)) > MOST_SCALARS:
            return jax.lax.scan(lambda c, row: (self.step(c, row)[0], None), carry, rows)[0]
        step, pack = scalarise(lambda c, row: self.step(c, row)[0], carry, _first(rows))
        columns = jax.tree.map(lambda x: [x[(slice(None), *i)] for i in np.ndindex(x.shape[1:])], rows)
        # the row travels in the carry, fetched one step ahead: a row read in the body would be read in every kernel
        now, later = _first(columns), jax.tree.map(lambda x: jnp.roll(x, -1), columns)
        return pack(jax.lax.scan(lambda c, row: ((step(*c), row), None), (split_tree(carry), now), later)[0][0])

    def metered(self) -> Carry:
        """The carry after all steps, with the last sample in the meter."""
        groups, inner, size = _shared_out(self.n_steps + 1)

        def chunk(carry: Carry, first: Array) -> tuple[Carry, None]:
            return self._steps(carry, self.table(first, size)), None

        def group(carry: Carry, first: Array | int) -> tuple[Carry, None]:
            return jax.lax.scan(kept_chunk, carry, first + size * jnp.arange(inner))

        kept_chunk = jax.checkpoint(chunk, prevent_cse=False)  # reverse mode keeps one carry a chunk
        if groups == 1:
            return group(self.begin(), 0)[0]
        kept_group = jax.checkpoint(group, prevent_cse=False)  # and one carry a group, then those of the chunks of one
        return jax.lax.scan(kept_group, self.begin(), size * inner * jnp.arange(groups))[0]

    def sampled(self, save_every: int) -> tuple[Carry, loop.Sample, loop.Sample]:
        """All steps: the last carry, the samples at every `save_every` steps, and the last sample."""

        def save(carry: Carry, rows: Row) -> tuple[Carry, loop.Sample]:
            after, sample = self.step(carry, _first(rows))
            return after if save_every == 1 else self._steps(carry, rows), sample

        def chunk(carry: Carry, first: Array, count: int) -> tuple[Carry, loop.Sample]:
            rows = jax.tree.map(lambda x: x.reshape(-1, save_every, *x.shape[1:]), self.table(first, count))
            return jax.lax.scan(save, carry, rows)

        chunk = jax.checkpoint(chunk, prevent_cse=False, static_argnums=2)
        size = save_every * max(1, CHUNK // save_every)
        carry, parts = self.begin(), []
        whole, rest = divmod(self.n_steps, size)
        if whole:
            carry, samples = jax.lax.scan(lambda c, k: chunk(c, k, size), carry, size * jnp.arange(whole))
            parts.append(jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), samples))
        if rest:
            carry, samples = chunk(carry, jnp.array(whole * size), rest)
            parts.append(samples)
        last = self.step(carry, _first(self.table(jnp.array(self.n_steps), 1)))[1]  # one step more, to look at the end
        return carry, jax.tree.map(lambda *x: jnp.concatenate(x), *parts), last


def _shared_out(looks: int) -> tuple[int, int, int]:
    """Groups, chunks in each and steps in a chunk, for so many looks, the last at the end, and few more.

    One size for all, so that a step is compiled once; what is too much looks at the end again, see `Rollout.row`.
    """
    chunks = max(1, round(looks / CHUNK))
    inner = chunks if chunks < FEW_CHUNKS else round(chunks**0.5)
    groups = -(-chunks // inner)
    return groups, inner, -(-looks // (groups * inner))


def _first(rows: PyTree) -> PyTree:
    return jax.tree.map(lambda x: x[0], rows)
