"""What stands between a command and what is delivered, besides the deadzone; any of it in any order, as a `Chain`.

Slopes are those of what is computed. Where that has none (rounding) a stand-in is used and stated. Backlash, rate limit
and saturation have the slope 0 where they hold still; kinks have the slope of one side.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._pytree import ANY, NONNEGATIVE, POSITIVE, Real, number, pytree, structure
from ..errors import Fault
from ..hashed import uniform
from ..protocols import Element, Reach


@pytree
class Saturation(Element):
    """Delivers no more than `upper` and no less than `lower`.

    Attributes:
        upper: largest output.
        lower: smallest output.
    """

    upper: Real = number(1.0, "unit of the command", ANY, above="lower")
    lower: Real = number(-1.0, "unit of the command", ANY)

    def __call__(self, u: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """The command, clipped."""
        return jnp.clip(u, self.lower, self.upper)

    def limited(self, flow: tuple[()], memory: tuple[()], u: Float[Array, "*n"]) -> Bool[Array, ""]:
        """Whether any of it is clipped."""
        return jnp.any((u > self.upper) | (u < self.lower))

    def reach(self, asked: Reach) -> Reach:
        """No more than its limits."""
        low, high = np.clip([asked.low, asked.high], float(self.lower), float(self.upper)).tolist()
        return Reach(low, high, asked.rate)


@pytree
class Quantisation(Element):
    """Rounds to multiples of `step`. Its derivative is taken as 1, since rounding has none (straight-through).

    Attributes:
        step: the output is a multiple of it.
    """

    step: Real = number(0.01, "unit of the command", POSITIVE)

    def __call__(self, u: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """The nearest multiple; at most step / 2 away."""
        return u + jax.lax.stop_gradient(self.step * jnp.round(u / self.step) - u)

    def reach(self, asked: Reach) -> Reach:
        """Rounded bounds; the rate on average, as it moves in jumps."""
        return asked.through(self, asked.rate)


@pytree
class Lag(Element):
    """A first-order lag, at rest at the start.

    Attributes:
        time_constant: of the lag.
    """

    time_constant: Real = number(0.05, "s", POSITIVE)

    def init(self, u: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """At rest."""
        return jnp.zeros_like(u)

    def deliver(self, flow: Array, memory: tuple[()], u: Array) -> tuple[Array, Array]:
        """What it has reached, and x' = (u - x) / T."""
        return flow, (u - flow) / self.time_constant

    def poles(self) -> list[float]:
        """Its pole [1/s]; the integrator's step must suit it."""
        return [-1.0 / float(self.time_constant)]

    def reach(self, asked: Reach) -> Reach:
        """It never leaves what it is asked for, nor outruns it."""
        return asked.from_rest(asked.rate)


@pytree
class Backlash(Element):
    """Play in a gear: the output stands still until the input has crossed the gap of width `gap`.

    Exact where the input is monotonous within a step.

    Attributes:
        gap: total width of the play.
    """

    gap: Real = number(0.1, "unit of the command", NONNEGATIVE)

    def hold(self, u: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """The output begins as near to 0 as the gap lets it."""
        return self._follow(jnp.zeros_like(u), u)

    def deliver(self, flow: tuple[()], memory: Array, u: Array) -> tuple[Array, tuple[()]]:
        """The output that the input leaves or pushes."""
        return self._follow(memory, u), ()

    def jump(self, flow: tuple[()], memory: Array, u: Array, h: Array) -> Array:
        """Where it stands now."""
        return self._follow(memory, u)

    def reach(self, asked: Reach) -> Reach:
        """Half the gap less at either end."""
        half = float(self.gap) / 2
        return Reach(asked.low + half, asked.high - half).from_rest(asked.rate)

    def _follow(self, output: Array, u: Array) -> Array:
        return jnp.clip(output, u - self.gap / 2, u + self.gap / 2)


@pytree
class RateLimitMemory:
    """Where a limiter will be at the end of the step, and its mean over the step, which is what it delivers."""

    end: Float[Array, "*n"]
    mean: Float[Array, "*n"]


@pytree
class RateLimit(Element):
    """Follows the command no faster than `rate`, from 0 at the start. Over a step it delivers the mean of its ramp.

    Attributes:
        rate: largest rate.
    """

    rate: Real = number(1.0, "unit of the command per s", POSITIVE)

    def hold(self, u: Float[Array, "*n"]) -> RateLimitMemory:
        """It begins at 0."""
        return RateLimitMemory(end=jnp.zeros_like(u), mean=jnp.zeros_like(u))

    def deliver(self, flow: tuple[()], memory: RateLimitMemory, u: Array) -> tuple[Array, tuple[()]]:
        """The mean over this step."""
        return memory.mean, ()

    def jump(self, flow: tuple[()], memory: RateLimitMemory, u: Array, h: Array) -> RateLimitMemory:
        """The step that begins."""
        reach = self.rate * h
        away = jnp.clip(u - memory.end, -reach, reach)
        share = jnp.abs(away) / reach  # of the step that the ramp takes
        return RateLimitMemory(end=memory.end + away, mean=memory.end + away * (1 - share / 2))

    def reach(self, asked: Reach) -> Reach:
        """No faster than its rate."""
        return asked.from_rest(min(asked.rate, float(self.rate)))


@pytree
class DelayMemory:
    """The latest commands, youngest first, how long ago each came, and what is delivered over this step."""

    values: Array  # (slots, *n)
    ages: Float[Array, " slots"]  # s
    late: Float[Array, " slots"]  # s, on top of the delay
    mean: Float[Array, "*n"]
    count: Float[Array, ""]  # of the commands that have come


@pytree
class Delay(Element):
    """Delivers every command `time` later, 0 before the first arrives; `jitter` adds to each a random part of that.

    It stores the last `slots` changes of its input: at least 1 + (time + jitter) / P, rounded up, for an input that
    changes every P seconds. Within a step in which a command arrives its mean is delivered, which makes the output
    differentiable in the delay.

    Attributes:
        time: delay of each command.
        jitter: largest additional delay of a command.
        seed: seed of the jitter.
        slots: how many changes of its input it stores.
    """

    time: Real = number(0.02, "s", NONNEGATIVE)
    jitter: Real = number(0.0, "s", NONNEGATIVE)
    seed: Real = number(0.0, "1", NONNEGATIVE)
    slots: int = structure(3)

    def hold(self, u: Float[Array, "*n"]) -> DelayMemory:
        """Zeros that came long ago."""
        nothing, never = jnp.zeros((self.slots, *u.shape), u.dtype), jnp.full(self.slots, 1e3, u.dtype)
        zero = jnp.zeros(self.slots, u.dtype)
        return DelayMemory(values=nothing, ages=never, late=zero, mean=nothing[0], count=zero[0])

    def faults(self, interval: float) -> list[Fault]:
        """It must remember every change of its input, one each `interval` [s]."""
        slots = 1 + np.ceil((float(self.time) + float(self.jitter)) / interval - 1e-9)  # infinite of an absurd interval
        rule = f"at least {slots:.15g}, to remember every change of its input, one each {interval:g} s"
        return [Fault("slots", self.slots, rule)] if self.slots < slots else []

    def deliver(self, flow: tuple[()], memory: DelayMemory, u: Array) -> tuple[Array, tuple[()]]:
        """What arrives within this step, on average."""
        return memory.mean, ()

    def jump(self, flow: tuple[()], memory: DelayMemory, u: Array, h: Array) -> DelayMemory:
        """The step that begins: a command that has changed joins the line."""
        new = jnp.any(u != memory.values[0])
        late = self.lateness(memory.count)

        def joined(line: Array, first: Array) -> Array:
            return jnp.where(new, jnp.concatenate([first[None], line[:-1]]), line)

        values, ages, lates = (
            joined(memory.values, u),
            joined(memory.ages, jnp.zeros_like(h)),
            joined(memory.late, late),
        )
        share = jnp.clip((h - (self.time + lates - ages)) / h, 0, 1)  # of the step, for which each has arrived
        mean = values[-1]
        for i in range(self.slots - 2, -1, -1):  # `mean` stands there once: XLA may compute it wherever it stands
            mean = (1 - share[i]) * mean + share[i] * values[i]
        return DelayMemory(
            values=values, ages=ages + h, late=lates, mean=mean, count=memory.count + new.astype(memory.count.dtype)
        )

    def lateness(self, count: Float[Array, ""]) -> Float[Array, ""]:
        """By how much [s] the command of this number comes later than `time`."""
        return self.jitter * uniform(self.seed, count)

    def reach(self, asked: Reach) -> Reach:
        """What it is asked for; late, it may jump."""
        return asked.from_rest(np.inf)
