"""The loop cut open at its actuators and linearised along a run: what margins and Bode plots are made of."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from . import cut
from .actuators.chain import Chain
from .engine import loop
from .engine.rollout import Carry, Meter, Rollout, Row
from .evaluate import Batch
from .geometry import wrap
from .protocols import Law
from .scenario import Scenario
from .timing import Timing

TOGETHER = 16  # vehicles of a batch
SLOWEST = 0.3  # rad/s, from which on a loop is looked at: in more than 20 s the run itself changes it
GROWTH = 0.05  # 1/s: a mode that grows no faster is taken for one that stays, such as the place along a path
FULL = 0.9  # of its usual effect on the state: with less an input is at a limit of the plant, such as an acceleration
AHEAD = 2.0  # s, after which what is left of a motion is what the loop makes of it
NEAR = 0.2  # of a mode's rate, within which a motion is that mode
JUMP = 2.0  # 1/s, of the largest input: where what is asked for changes faster, a corner begins or ends


class Loops(NamedTuple):
    """Linear loops at K instants of a run, open at all m inputs of actuators; n states, Q periods of delay.

    x' = A x + sum_q B_q v_q and u = C x + sum_q D_q v_q, x' a period later, v_q the inputs q periods ago; the loop is
    closed where v_0 = u. Of a batch each array has one more leading axis.
    """

    period: Any  # (), s, of the law; of a law in continuous time a step of the integrator
    t: Any  # (K,), s
    A: Any  # (K, n, n)
    B: Any  # (K, Q + 1, n, m)
    C: Any  # (K, m, n)
    D: Any  # (K, Q + 1, m, m)
    inputs: Any  # (K, m), what the actuators are asked for there
    change: Any  # (K, m), of these from the period before or to the next one, the larger
    changing: Any  # (K,), rad/s, how fast the vehicle turns, or changes its speed, or soon will: so may the loop itself
    effect: Any  # (K, m), of what is delivered on the state: less than elsewhere where the plant itself is at a limit
    limited: Any  # (K,), whether an actuator, or the law's own limit, is at its limit
    ok: Any  # (), whether the run stayed within `scenario.limit`
    slope: Any  # (K, m), of the deadzones, as it is in B and D
    asked: Any  # (N, m), what the actuators are asked for in every step of the run, up to the last period
    step: Any  # (), s, from one of these to the next


def steady(loops: Loops) -> Any:
    """At which instants (K,) a loop says something of the run: nothing is at a limit, jumps, or is not finite."""
    middle = jnp.median(loops.effect, axis=-2, keepdims=True)
    weak = jnp.any(loops.effect < FULL * middle, axis=-1)
    usual = jnp.max(jnp.abs(loops.inputs), axis=-2, keepdims=True)
    jumps = jnp.any(loops.change > JUMP * jnp.expand_dims(loops.period, (-1, -2)) * usual, axis=-1)
    known = [jnp.isfinite(x).all(range(loops.t.ndim, x.ndim)) for x in (loops.A, loops.B, loops.C, loops.D)]
    return functools.reduce(jnp.logical_and, known) & ~loops.limited & ~weak & ~jumps


def instants(controller: Law | Batch, timing: Timing, first: float, count: int) -> tuple[int, int, int]:
    """Steps in a control period, step of the first instant not before `first` [s], and steps from one to the next.

    Raises:
        ValueError: the run has not so many control instants after `first`.
    """
    law: Law = controller.scenario if isinstance(controller, Batch) else controller
    period, dt = law.control_period(), float(timing.dt)
    every = timing.control_every if period is None else max(1, round(float(period) / dt))
    periods, before = timing.n_steps // every, math.ceil(first / dt / every - 1e-9)
    for stride in range((periods - before) // count, 0, -1):  # the first instant is one of the others' kind
        begin = -(-before // stride) * stride
        if begin + count * stride <= periods:
            return every, begin * every, stride * every
    raise ValueError(f"{count} instants after {first:g} s are more than the run of {timing.n_steps * dt:g} s has")


def input_names(controller: Law, scenario: Scenario, timing: Timing) -> list[str]:
    """The m inputs of actuators in the order of `Loops`, `position[0]` of one with several."""
    return [name if i is None else f"{name}[{i}]" for name, i, _ in places(controller, scenario, timing)]


def places(controller: Law, scenario: Scenario, timing: Timing) -> list[tuple[str, int | None, tuple[int, ...]]]:
    """By input in the order of `Loops` its actuator, which number of it (None of one that is sent one), its shape."""
    shapes = _shapes(_rollout(controller, dataclasses.replace(scenario, sensor=None), timing))
    each = [(name, shapes[name]) for name in scenario.plant.actuators]
    return [(n, i if shape else None, shape) for n, shape in each for i in range(math.prod(shape))]


def longest_delay(scenario: Scenario | Batch) -> float:
    """The longest delay [s] of an actuator, with its jitter, of a scenario or of a batch of them."""
    chains = (scenario.scenario if isinstance(scenario, Batch) else scenario).actuators
    return max((float(np.max(np.asarray(cut.late(chain)))) for chain in chains.values()), default=0.0)


def linearised(
    controller: Law | Batch, scenario: Scenario | Batch, *, timing: Timing, first: float = 0.0, count: int = 12
) -> Loops:
    """The loops of a run, or of a batch of runs, at `count` control instants from `first` [s] on.

    A deadzone of the scenario has, about the input of the moment, the slope of its side, also within the threshold:
    that of a motion large beside it. Backlash and quantisation count as 1. A delay is kept whole: of a law with a
    period its inputs are held in between, of a law in continuous time a step of the integrator is the period. Where
    something is at a limit, what it delivers does not depend on its input: `limited`. Noise of a sensor is left out.

    Source: linearisation along a trajectory, e.g. Astrom and Murray, Feedback Systems, sec. 6.4; sampled loops with
    delay, Astrom and Wittenmark, Computer-Controlled Systems, sec. 2.5.

    Raises:
        ValueError: there are not so many instants.
    """  # a batch of laws and one of scenarios are of one size
    every, begin, stride = instants(controller, timing, first, count)
    slots = max(every, math.ceil(longest_delay(scenario) / float(timing.dt) - 1e-9) + 2)
    timing, steps = dataclasses.replace(timing, dt=float(timing.dt)), (every, begin, stride, count, slots)
    batched = isinstance(scenario, Batch) or isinstance(controller, Batch)
    return (_each if batched else _linearised)(controller, scenario, steps, timing)


Steps = tuple[int, int, int, int, int]  # in a period, to the first instant, to the next, instants, of a delay


@functools.partial(jax.jit, static_argnames=("steps", "timing"))
def _each(controller: Any, batch: Any, steps: Steps, timing: Timing) -> Loops:
    size = next(x.size for x in (batch, controller) if isinstance(x, Batch))

    def one(index: Array) -> Loops:
        law, scenario = (x[index] if isinstance(x, Batch) else x for x in (controller, batch))
        return _linearised(law, scenario, steps, timing)

    return jax.lax.map(one, jnp.arange(size), batch_size=min(TOGETHER, size))


@functools.partial(jax.jit, static_argnames=("steps", "timing"))
def _linearised(controller: Law, scenario: Any, steps: Steps, timing: Timing) -> Loops:
    every, begin, stride, count, slots = steps
    rollout = _rollout(controller, dataclasses.replace(scenario, sensor=None), timing)

    def stretch(carry: Carry, first: Array) -> tuple[Carry, tuple[Carry, loop.Sample]]:
        later, samples = jax.lax.scan(rollout.step, carry, rollout.table(first, stride))
        return later, (carry, samples)

    earlier = begin // stride
    last, found = jax.lax.scan(stretch, rollout.begin(), stride * jnp.arange(earlier + count))
    history = found[1].inputs.reshape(-1, found[1].inputs.shape[-1])
    asked = jnp.concatenate([jnp.zeros((slots, history.shape[1]), history.dtype), history])
    carries, samples = jax.tree.map(lambda x: x[earlier:], found)
    numbers = begin + stride * jnp.arange(count)
    shares = _shares(rollout.scenario, rollout.dt, slots, _shapes(rollout))

    def one(carry: Carry, number: Array) -> tuple[Array, ...]:
        before = jax.lax.dynamic_slice_in_dim(asked, number, slots + every)  # from number - slots on
        lines = jnp.stack([before[slots + s - np.arange(slots)] for s in range(every)])  # (every, slots, m)
        delayed = jnp.einsum("sjm,mj->sm", lines, shares)
        return _opened(rollout, timing, carry, rollout.table(number, every), delayed)

    A, B, C, D, effect, slope, moved = jax.lax.map(lambda x: one(*x), (carries, numbers), batch_size=1)
    B, D = (_by_periods(x, shares, every) for x in (B, D))
    now = asked[numbers + slots]
    ahead = jnp.minimum(numbers + every, len(asked) - slots - 1)
    change = jnp.maximum(jnp.abs(now - asked[numbers + slots - every]), jnp.abs(asked[ahead + slots] - now))
    apart = (ahead - numbers).astype(rollout.dtype) * rollout.dt
    changing = _changing(found[1].heading.ravel(), found[1].velocity.reshape(-1, 2), numbers, ahead) / apart
    t, limited = samples.t[:, 0], samples.limited[:, :every].any(1)
    if rollout.route is not None and rollout.controller.follows():
        ago = [asked[jnp.maximum(numbers + slots - every * q, 0)] for q in range(B.shape[1])]
        moved = jnp.concatenate([moved, *(newer - older for newer, older in itertools.pairwise(ago))], axis=1)
        later = functools.partial(_carried_along, period=every * timing.dt)
        changing = jnp.maximum(changing, jax.lax.map(lambda x: later(*x), (A, B, C, D, moved)))
    place = (now, change, changing, effect, limited, last.ok)
    return Loops(every * rollout.dt, t, A, B, C, D, *place, slope, history, rollout.dt)


def _changing(heading: Array, velocity: Array, now: Array, ahead: Array) -> Array:
    """By how much [rad] vehicles turn, or change their speed as a share of it; a crawling one's, of a tenth of the top.

    Where the speed rises along a path, a vehicle that is ahead gets further ahead: no loss of stability.
    """
    speed = jnp.linalg.norm(velocity, axis=1)
    floor = jnp.maximum(0.1 * jnp.max(speed), jnp.finfo(speed.dtype).tiny)
    faster = jnp.abs(speed[ahead] - speed[now]) / jnp.maximum(speed[now], floor)
    return jnp.hypot(wrap(heading[ahead] - heading[now]), faster)


def _carried_along(A: Array, B: Array, C: Array, D: Array, moved: Array, period: float) -> Array:
    """How fast [1/s] a small lead grows that a vehicle has on its run, if the loop there makes a mode of it; else 0.

    Who follows a route by where he is may be on it a little sooner: then x and v_1 ... v_Q differ by what they have
    `moved` by in a period, and the lead grows as the speed of the route rises, before motors with a lag let the vehicle
    gain speed. So fast is the loop about to change. A motion that becomes no mode, or another one with time, says
    nothing: it is a loss of stability, or an oscillation.
    """
    n, m = C.shape[1], C.shape[0]

    def step(z: Array) -> Array:
        x, late = z[:n], z[n:].reshape(-1, m)
        asked = jnp.linalg.solve(jnp.eye(m, dtype=x.dtype) - D[0], C @ x + jnp.einsum("qij,qj->i", D[1:], late))
        v = jnp.concatenate([asked[None], late])
        return jnp.concatenate([A @ x + jnp.einsum("qnm,qm->n", B, v), v[:-1].ravel()])

    def looked(x: Array) -> tuple[Array, Array]:
        later = closed @ x
        size = jnp.sum(x**2)
        share = jnp.sum(x * later) / size
        return jnp.log(share) / period, jnp.sqrt(jnp.sum((later - share * x) ** 2) / size) / period

    closed = jax.vmap(step, out_axes=1)(jnp.eye(moved.size, dtype=moved.dtype))
    half = jnp.linalg.matrix_power(closed, max(1, round(AHEAD / 2 / period)))
    soon = half @ jnp.where(jnp.isfinite(moved), moved, 0)  # what is left of a closed route is infinite
    first, (rate, rest) = looked(soon)[0], looked(half @ soon)
    return jnp.where((jnp.abs(first - rate) <= NEAR * rate) & (rest <= NEAR * rate), rate, 0)


def _rollout(controller: Law, scenario: Scenario, timing: Timing) -> Rollout:
    return Rollout(controller, scenario, timing=timing, dtype=None, meter=Meter())


def _shapes(rollout: Rollout) -> dict[str, tuple[int, ...]]:
    """By actuator the shape of its input."""

    def asked() -> loop.Inputs:
        row = jax.tree.map(lambda x: x[0], rollout.table(jnp.zeros((), int), 1))
        signals = rollout.signals(row.t[0], jax.tree.map(lambda x: x[0], row.signals))
        carry = rollout.begin()
        return loop.respond(rollout.controller, rollout.scenario, carry.flow, carry.memory, signals).inputs

    return {name: x.shape for name, x in jax.eval_shape(asked).items()}


def _shares(scenario: Scenario, dt: Array, slots: int, shapes: dict[str, tuple[int, ...]]) -> Array:
    """Of a step, for how much of it the input of so many steps before acts, (m, slots); straight between steps."""
    found, ages = [], jnp.arange(slots).astype(dt.dtype)
    for name in scenario.plant.actuators:
        late = cut.late(scenario.actuators.get(name, Chain())) + jnp.zeros_like(dt)
        found += [jnp.maximum(1 - jnp.abs(late / dt - ages), 0)] * math.prod(shapes[name])
    return jnp.stack(found)


def _by_periods(x: Array, shares: Array, every: int) -> Array:
    """Effects (K, every, n, m) of what arrives in the steps of a period, by how many periods ago it was asked for."""
    slots = shares.shape[1]
    ago = np.ceil((np.arange(slots)[None] - np.arange(every)[:, None]) / every).astype(int)  # (every, slots)
    of = jnp.asarray(ago[:, :, None] == np.arange(ago.max() + 1), x.dtype)
    return jnp.einsum("ksnm,mj,sjq->kqnm", x, shares, of)


def _opened(rollout: Rollout, timing: Timing, carry: Carry, rows: Row, arrive: Array) -> tuple[Array, ...]:
    """A, the effects of what arrives (every, n, m), C, those on what is asked for, their size, slopes, x's motion."""
    scenario, shapes = rollout.scenario, _shapes(rollout)
    sizes = np.cumsum([math.prod(shapes[name]) for name in scenario.plant.actuators])[:-1].tolist()
    chains = {name: cut.without(scenario.actuators.get(name)) for name in scenario.plant.actuators}
    carry = cut.carried(carry, chains)
    x0, whole = cut.numbers(carry)

    def driven(delivered: Array) -> Scenario:
        parts = zip(scenario.plant.actuators, jnp.split(delivered, sizes), strict=True)
        zones = {n: cut.Cut(value=x.reshape(shapes[n])) for n, x in parts}
        kept = {name: chain for name, chain in chains.items() if chain is not None}
        return dataclasses.replace(scenario, deadzone=zones, actuators=kept)

    def period(x: Array, delivered: Array) -> tuple[tuple[Array, Array], Array]:
        def step(carry: Carry, given: tuple[Row, Array]) -> tuple[Carry, Array]:
            row, now = given
            open_loop = _rollout(rollout.controller, driven(now), timing)
            later, sample = open_loop.step(carry, row)
            return later, sample.inputs

        later, asked = jax.lax.scan(step, whole(x), (rows, delivered))
        after = cut.numbers(later)[0]
        return (after, asked[0]), after

    of = zip(scenario.plant.actuators, jnp.split(arrive, sizes, axis=1), strict=True)
    zones = [cut.tangent(scenario.deadzone[name], u) for name, u in of]
    delivered, slopes = (jnp.concatenate(x, axis=1) for x in zip(*zones, strict=True))
    n, shape = x0.size, delivered.shape
    slopes_of = jax.jacfwd(lambda z: period(z[:n], z[n:].reshape(shape)), has_aux=True)
    both, after = slopes_of(jnp.concatenate([x0, delivered.ravel()]))
    (A, B), (C, D) = ((x[:, :n], x[:, n:].reshape(len(x), *shape)) for x in both)
    effect = jnp.linalg.norm(B.sum(1), axis=0)
    B, D = (jnp.moveaxis(x * slopes[None], 1, 0) for x in (B, D))
    return A, B, C, D, effect, slopes.mean(0), after - x0
