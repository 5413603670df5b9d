"""What stands between a command and what is delivered, besides the deadzone; any of it in any order, as a `Chain`.

An element is a callable `u -> delivered` or, with state or memory, has `init(u) -> flow`,
`deliver(flow, held, u) -> (delivered, flow derivative)`, `hold(u)` and `jump(flow, held, u, h)`, which is called at the
start of every step of the integrator, `h` [s] long. One that has a limit also says when it is at it: `limited(u)`.

Slopes are those of what is computed. Where that has none (rounding) a stand-in is used and stated. Backlash, rate limit
and saturation have the slope 0 where they hold still; kinks have the slope of one side.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._pytree import ANY, NONNEGATIVE, POSITIVE, number, pytree, structure
from ..hashed import uniform


@pytree
class Saturation:
    """Delivers no more than `upper` and no less than `lower`."""

    upper: float = number(1.0, "unit of the command", ANY)
    lower: float = number(-1.0, "unit of the command", ANY)

    def __call__(self, u: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """The command, clipped."""
        return jnp.clip(u, self.lower, self.upper)

    def limited(self, u: Float[Array, "*n"]) -> Any:
        """Whether any of it is clipped."""
        return jnp.any((u > self.upper) | (u < self.lower))


@pytree
class Quantisation:
    """Rounds to multiples of `step`. Its slope is taken as 1: rounding itself has none (straight-through)."""

    step: float = number(0.01, "unit of the command", POSITIVE)

    def __call__(self, u: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """The nearest multiple; at most step / 2 away."""
        return u + jax.lax.stop_gradient(self.step * jnp.round(u / self.step) - u)


@pytree
class Lag:
    """A first-order lag, at rest at the start."""

    time_constant: float = number(0.05, "s", POSITIVE)

    def init(self, u: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """At rest."""
        return jnp.zeros_like(u)

    def deliver(self, flow: Array, held: Any, u: Array) -> tuple[Array, Array]:
        """What it has reached, and x' = (u - x) / T."""
        return flow, (u - flow) / self.time_constant

    def poles(self) -> list[float]:
        """Its pole [1/s]; the integrator's step must suit it."""
        return [-1.0 / float(self.time_constant)]


@pytree
class Backlash:
    """Play in a gear: the output stands still until the input has crossed the gap, `gap` wide in all.

    Exact where the input is monotonous within a step.
    """

    gap: float = number(0.1, "unit of the command", NONNEGATIVE)

    def init(self, u: Array) -> tuple[()]:
        """Nothing flows."""
        return ()

    def hold(self, u: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """The output begins as near to 0 as the gap lets it."""
        return self._follow(jnp.zeros_like(u), u)

    def deliver(self, flow: Any, held: Array, u: Array) -> tuple[Array, tuple[()]]:
        """The output that the input leaves or pushes."""
        return self._follow(held, u), ()

    def jump(self, flow: Any, held: Array, u: Array, h: Any) -> Array:
        """Where it stands now."""
        return self._follow(held, u)

    def _follow(self, output: Array, u: Array) -> Array:
        return jnp.clip(output, u - self.gap / 2, u + self.gap / 2)


@pytree
class RateLimitMemory:
    """Where a limiter will be at the end of the step, and its mean over the step, which is what it delivers."""

    end: Any
    mean: Any


@pytree
class RateLimit:
    """Follows the command no faster than `rate`, from 0 at the start. Over a step it delivers the mean of its ramp."""

    rate: float = number(1.0, "unit of the command per s", POSITIVE)

    def init(self, u: Array) -> tuple[()]:
        """Nothing flows."""
        return ()

    def hold(self, u: Float[Array, "*n"]) -> RateLimitMemory:
        """At 0."""
        return RateLimitMemory(end=jnp.zeros_like(u), mean=jnp.zeros_like(u))

    def deliver(self, flow: Any, held: RateLimitMemory, u: Array) -> tuple[Array, tuple[()]]:
        """The mean over this step."""
        return held.mean, ()

    def jump(self, flow: Any, held: RateLimitMemory, u: Array, h: Any) -> RateLimitMemory:
        """The step that begins."""
        reach = self.rate * h
        away = jnp.clip(u - held.end, -reach, reach)
        share = jnp.abs(away) / reach  # of the step that the ramp takes
        return RateLimitMemory(end=held.end + away, mean=held.end + away * (1 - share / 2))


@pytree
class DelayMemory:
    """The latest commands, youngest first, how long ago each came, and what is delivered over this step."""

    values: Any  # (slots, *n)
    ages: Any  # (slots,) s
    late: Any  # (slots,) s, on top of the delay
    mean: Any
    count: Any


@pytree
class Delay:
    """Delivers every command `time` later, 0 before the first arrives; `jitter` adds to each a random part of that.

    It remembers the last `slots` changes of its input: for an input that changes every P seconds that must be at least
    1 + (time + jitter) / P, rounded up. Within a step in which a command arrives its mean is delivered, which also
    gives the delay a slope.
    """

    time: float = number(0.02, "s", NONNEGATIVE)
    jitter: float = number(0.0, "s", NONNEGATIVE)
    seed: float = number(0.0, "1", NONNEGATIVE)
    slots: int = structure(3)

    def init(self, u: Array) -> tuple[()]:
        """Nothing flows."""
        return ()

    def hold(self, u: Float[Array, "*n"]) -> DelayMemory:
        """Zeros that came long ago."""
        nothing, never = jnp.zeros((self.slots, *u.shape), u.dtype), jnp.full(self.slots, 1e3, u.dtype)
        zero = jnp.zeros(self.slots, u.dtype)
        return DelayMemory(values=nothing, ages=never, late=zero, mean=nothing[0], count=zero[0])

    def deliver(self, flow: Any, held: DelayMemory, u: Array) -> tuple[Array, tuple[()]]:
        """What arrives within this step, on average."""
        return held.mean, ()

    def jump(self, flow: Any, held: DelayMemory, u: Array, h: Any) -> DelayMemory:
        """The step that begins: a command that has changed joins the line."""
        new = jnp.any(u != held.values[0])
        late = self.jitter * uniform(self.seed, held.count)

        def joined(line: Array, first: Array) -> Array:
            return jnp.where(new, jnp.concatenate([first[None], line[:-1]]), line)

        values, ages, lates = joined(held.values, u), joined(held.ages, jnp.zeros_like(h)), joined(held.late, late)
        share = jnp.clip((h - (self.time + lates - ages)) / h, 0, 1)  # of the step, for which each has arrived
        mean = values[-1]
        for i in range(self.slots - 2, -1, -1):
            mean = mean + share[i] * (values[i] - mean)
        return DelayMemory(
            values=values, ages=ages + h, late=lates, mean=mean, count=held.count + new.astype(held.count.dtype)
        )
