"""Describing functions: what a sinusoid becomes, on its way from the law to what an actuator delivers."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from agvjax import (
    Backlash,
    Chain,
    Delay,
    EventTriggered,
    Inverse,
    Lag,
    NoCompensation,
    NoPrediction,
    Quantisation,
    Sampled,
    Saturation,
    Scenario,
    Wrapping,
)
from agvjax.controllers.wrapping import Allocating
from agvjax.decorator import pytree
from agvjax.leaves import cast, leaves
from agvjax.protocols import Element, Law

POINTS = 128  # of a period
TINY = 1e-3  # of the largest size: a mean that small is none
HALVINGS = {4: 28, 8: 44}  # by bytes of a number, until a bisection has found it as well as numbers resolve


@pytree
class Inverted(Element):
    """What is sent for what is wanted, of one actuator."""

    inverse: Inverse

    def __call__(self, u: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """The inverse of the one assumed deadzone."""
        (name,) = self.inverse.believed
        return self.inverse.inverted({name: u})[name]


class Way(NamedTuple):
    """What is not linear, or has a slope of its own, between the law and one number that an actuator delivers.

    No delay and no lag is in it. Its elements depend on the course of their input, never on how fast it is run through.
    """

    before: Chain  # in the computer: the inverse of a deadzone, the limits of an anti-windup
    after: Chain  # the deadzone, then saturation, backlash and rounding
    shape: tuple[int, ...]  # of the actuator's input
    number: int  # which number of it

    @property
    def whole(self) -> Chain:
        """All of it."""
        return Chain(**dict(self.before), **dict(self.after))


def way(controller: Law, scenario: Scenario, name: str, index: int, shape: tuple[int, ...]) -> Way | str:
    """What is between the law and number `index` of an actuator with inputs of this shape, or what is not covered.

    Not covered is what remembers how fast its input was (a rate limit), what stands behind a lag of the actuator, and
    in the computer an inverse that learns, a prediction, events.
    """
    before = _computed(controller, list(scenario.plant.actuators).index(name), name)
    if isinstance(before, str):
        return before
    zone = scenario.deadzone[name]
    if not _memoryless(zone):
        return f"{type(zone).__name__} has a memory"
    found, lagging = {"deadzone": zone}, False
    rest = scenario.actuators.get(name, Chain())
    for _, part in rest.elements("rest"):
        if isinstance(part, Backlash | Quantisation | Saturation):
            if lagging:
                return f"{type(part).__name__} behind a lag"
            found[f"part_{len(found)}"] = part  # elements of chains in chains have dots in their names
        elif isinstance(part, Lag):
            lagging = True
        elif not isinstance(part, Delay):
            return type(part).__name__
    return Way(Chain(**before), Chain(**found), shape, index)


def _computed(law: Law, place: int, name: str) -> dict[str, Element] | str:
    """What is not linear in the computer behind the law, or what there is that is not covered."""
    found: dict[str, Element] = {}
    while isinstance(law, Wrapping):
        if isinstance(law, EventTriggered):
            return "events"
        if isinstance(law, Sampled):
            if not isinstance(law.prediction, NoPrediction):
                return "a prediction"
            if law.anti_windup.limits is not None:
                most = jnp.asarray(law.anti_windup.limits)[place]
                found["limits"] = Saturation(upper=most, lower=-most)
        if isinstance(law, Allocating) and not isinstance(law.compensation, NoCompensation):
            if type(law.compensation) is not Inverse:
                return type(law.compensation).__name__
            if name in law.compensation.believed:
                one = {name: law.compensation.believed[name]}
                parts = {n: x for n, x in vars(law.compensation).items() if n != "believed"}
                found = {"inverse": Inverted(inverse=Inverse(believed=one, **parts)), **found}
        law = law.inner
    return found


def _memoryless(element: Element) -> bool:
    u = jnp.zeros(())
    return not jax.tree.leaves((element.init(u), element.hold(u)))


def amplitudes(parts: Chain, about: float, count: int = 120) -> np.ndarray:
    """Where a describing function is looked at, (count,), by the sizes in a chain, about an input of such a size."""
    sizes = [abs(float(x)) for name, x in leaves_of(parts).items() if "slope" not in name.rsplit(".", 1)[-1]]
    sizes = [x for x in (*sizes, abs(about)) if 0 < x < math.inf] or [1.0]
    sizes = [x for x in sizes if x > TINY * max(sizes)]
    return np.geomspace(0.05 * min(sizes), 30 * max(sizes), count)


def leaves_of(parts: Chain) -> dict[str, PyTree]:
    """By dotted name the numbers of a chain that have the unit of its input; of an inverse those it believes in."""
    found = {}
    for key, part in parts.elements("way"):
        if isinstance(part, Inverted):
            found |= {f"{key}.{n}": x for n, x in leaves(part.inverse.believed).items()}
            inner = part.inverse
            (zone,) = inner.believed.values()
            steps = (zone.threshold_right, zone.threshold_left)
            found |= {f"{key}.{i}": jnp.asarray(inner.width) * s for i, s in enumerate(steps)}
        else:
            found |= {f"{key}.{n}": x for n, x in leaves(part).items()}
    return found


def delivered(way: Way, u: np.ndarray) -> np.ndarray:
    """What is delivered of a course of inputs (N,), from the start of a run."""
    return np.asarray(_course(cast(way.after, u.dtype), way.shape, way.number, jnp.asarray(u)))


def wanted(way: Way, sent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What the law wanted where this was sent, (N,), and the slope of what is sent there; beyond a limit, the limit."""
    if not len(way.before):
        return sent, np.ones_like(sent)
    found = _undone(cast(way.before, sent.dtype), way.shape, way.number, jnp.asarray(sent))
    return np.asarray(found[0]), np.asarray(found[1])


def describing(way: Way, level: float, share: float, amplitude: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The describing function N (A,), complex, at amplitudes (A,), and the mean input b (A,) at each.

    N = 2j / (A T) int y(t) exp(-j w t) dt over a settled period, y what is delivered of b + A sin(w t). What is slow in
    the loop fixes b: (1 - share) b + share mean(y) = level, where share = L_0 / (1 + L_0) of the loop's gain L_0 at
    rest for what is delivered. A loop that integrates has share 1: what it delivers on average stays. N is NaN where
    no b does that.

    Source: Gelb and Vander Velde, Multiple-Input Describing Functions, 1968, sec. 2.2 and 6.2 (bias and sinusoid).
    """
    dtype = np.asarray(amplitude).dtype
    b, real, imaginary = _describing(
        cast(way.whole, dtype), way.shape, way.number, *(jnp.asarray(x, dtype) for x in (level, share, amplitude))
    )
    return np.asarray(real) + 1j * np.asarray(imaginary), np.asarray(b)


def settled(way: Way, u: np.ndarray) -> np.ndarray:
    """What is delivered of one period of inputs (N,), again and again."""
    dtype = u.dtype
    return np.asarray(_settled(cast(way.whole, dtype), way.shape, way.number, jnp.asarray(u)))


Place = tuple[int, ...]


@functools.partial(jax.jit, static_argnums=(1, 2))
def _course(parts: Chain, shape: Place, index: int, u: Float[Array, " N"]) -> Float[Array, " N"]:
    """What is delivered, step by step; a chain without memory at once."""

    def step(memory: PyTree, u: Array) -> tuple[PyTree, Array]:
        full = jnp.full(shape, u)
        flow = parts.init(full)
        memory = parts.jump(flow, memory, full, jnp.ones_like(u))
        return memory, parts.deliver(flow, memory, full)[0].ravel()[index]

    begun = parts.hold(jnp.full(shape, u[0]))
    if jax.tree.leaves(begun):
        return jax.lax.scan(step, begun, u)[1]
    return jax.vmap(lambda u: step(begun, u)[1])(u)


@functools.partial(jax.jit, static_argnums=(1, 2))
def _undone(parts: Chain, shape: Place, index: int, sent: Array) -> tuple[Array, Array]:
    """Read backwards: none of it falls where its input rises, nor makes it smaller than its slope says."""

    def of(d: Array) -> Array:
        return parts.deliver(parts.init(d), parts.hold(d), jnp.full(shape, d))[0].ravel()[index]

    def one(sent: Array) -> tuple[Array, Array]:
        most = 4 * jnp.abs(sent) + jnp.asarray(1e-6, sent.dtype)
        d = _root(lambda d: of(d) - sent, -most, most)
        return d, jax.jvp(of, (d,), (jnp.ones_like(d),))[1]

    return jax.vmap(one)(sent)


def _root(f, low: Array, high: Array) -> Array:  # noqa: ANN001
    """Where a function that rises crosses 0, by bisection."""

    def halve(_: int, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        middle = (low + high) / 2
        above = f(middle) > 0
        return jnp.where(above, low, middle), jnp.where(above, middle, high)

    low, high = jax.lax.fori_loop(0, HALVINGS[low.dtype.itemsize], halve, (low, high))
    return (low + high) / 2


@functools.partial(jax.jit, static_argnums=(1, 2))
def _settled(parts: Chain, shape: Place, index: int, once: Float[Array, " N"]) -> Float[Array, " N"]:
    moving = bool(jax.tree.leaves(parts.hold(jnp.zeros(shape, once.dtype))))
    return _course(parts, shape, index, jnp.concatenate([once, once]) if moving else once)[-len(once) :]


@functools.partial(jax.jit, static_argnums=(1, 2))
def _describing(
    parts: Chain, shape: Place, index: int, level: Array, share: Array, amplitude: Float[Array, " A"]
) -> tuple[Array, Array, Array]:
    turn = jnp.asarray(2 * np.pi * np.arange(POINTS) / POINTS, amplitude.dtype)

    def period(b: Array, a: Array) -> Array:
        return _settled(parts, shape, index, b + a * jnp.sin(turn))

    def one(a: Array) -> tuple[Array, Array, Array]:
        def missing(b: Array) -> Array:
            return (1 - share) * b + share * jnp.mean(period(b, a)) - level

        far = 8 * (jnp.abs(level) + amplitude[-1])
        b = _root(missing, -far, far)
        y = period(b, a)
        scale = jnp.where(jnp.abs(missing(b)) < 1e-2 * (a + jnp.abs(level)), 2 / a, jnp.nan)
        return b, scale * jnp.mean(y * jnp.sin(turn)), scale * jnp.mean(y * jnp.cos(turn))

    return jax.lax.map(one, amplitude, batch_size=len(amplitude))
