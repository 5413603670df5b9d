"""What a run is judged by, accumulated sample by sample, so that it needs no trajectory and no memory.

e = (x_n - x_d, y_n - y_d, wrap(psi - psi_d)); u = (u_x, u_y, omega_bar), before the actuators. Where a plant's heading
follows from its motion and cannot be commanded, both have the first two channels only. Integrals are by the trapezoid
over all samples.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from . import followed
from ._pytree import NONNEGATIVE, POSITIVE, Real, number, pytree, structure
from .engine import loop
from .engine.rollout import Meter
from .geometry import safe_sqrt, wrap
from .metric_table import METRICS
from .metric_table import Metrics as Metrics

MOMENT, EDGE = 8, 0.2  # of the smooth settling time: its power of time, and how soft the band is, as a share of it


class Weights(NamedTuple):
    """What a sample counts in sums."""

    whole: Array  # s, of the trapezoid over the run
    late: Array  # s, of that after `late`
    onward: Array  # 1, but 0 for the first sample: a command leaves nothing behind that was not asked for in the run


@pytree
class Tally:
    """Running sums and extremes of one run."""

    first_error: Float[Array, " c"]
    last_command: Float[Array, " c"]
    squared: Float[Array, " c"]
    squared_late: Float[Array, " c"]
    absolute: Float[Array, " c"]
    absolute_timed: Float[Array, " c"]
    beyond: Float[Array, " c"]
    last_outside: Float[Array, " c"]
    outside_moment: Float[Array, " c"] | None
    command_squared: Float[Array, " c"]
    peak: Float[Array, " c"]
    chatter: Float[Array, " c"]
    delivered: Delivered | None
    ridden: followed.Ridden | None


@pytree
class Delivered:
    """The same of what the actuators delivered."""

    last: Float[Array, " m"]
    squared: Float[Array, " m"]
    peak: Float[Array, " m"]
    variation: Float[Array, " m"]
    limited: Float[Array, ""]
    way: Float[Array, " m"]  # the sign of what was delivered last that is not 0
    reversals: Float[Array, " m"]


@pytree
class Criteria(Meter):
    """How runs are evaluated: the settling band, and when the late error begins."""

    band: float = number(0.05, "m, m, rad; or a fraction of the first error where relative", POSITIVE, "reading R10")
    relative: bool = structure(False)
    late: Real = number(4.0, "s", NONNEGATIVE, "past the transient of every law")
    margin: float = number(1.0, "s", NONNEGATIVE, "a run outside the band this close to its end has not settled")
    smooth: bool = structure(False)  # also a settling time that has a slope
    delivered: bool = structure(False)  # also what the actuators delivered
    loop: bool = structure(False)  # also margins of the linearised loop, by `agvjax.margins.with_margins`
    instants: int = structure(12)  # at which that is linearised

    @classmethod
    def of(cls, names: Iterable[str], sloped: bool = False, like: Criteria | None = None) -> Criteria:
        """The criteria that these metrics need, on request with derivatives of all of them; the rest as in `like`."""
        names = tuple(names)
        smooth = sloped and any("settling_time" in name for name in names)
        asked = {kind: any(getattr(METRICS[name], kind) for name in names) for kind in ("delivered", "loop")}
        return dataclasses.replace(cls() if like is None else like, smooth=smooth, **asked)

    def weights(self, t: Array, left: Array, right: Array, end: Array) -> Weights:
        """Of the sample at `t`; `left` and `right` [s] to the next."""
        whole, late = _trapezoid(t, left, right, 0.0, end), _trapezoid(t, left, right, self.late, end)
        return Weights(whole, late, (t > 0).astype(t.dtype))

    def start(self, sample: loop.Sample) -> Tally:
        """The tally before the first sample."""
        error, zero = tracking_error(sample), jnp.zeros_like(sample.command)
        return Tally(
            first_error=error,
            last_command=sample.command,
            squared=zero,
            squared_late=zero,
            absolute=zero,
            absolute_timed=zero,
            beyond=zero,
            last_outside=zero,
            outside_moment=zero if self.smooth else None,
            command_squared=zero,
            peak=zero,
            chatter=zero,
            delivered=_nothing_delivered(sample) if self.delivered else None,
            ridden=followed.start(sample),
        )

    def update(self, tally: Tally, sample: loop.Sample, weights: Weights) -> Tally:
        """The tally with one more sample and its `weights`."""
        whole, late, onward = weights
        e, u = tracking_error(sample), sample.command
        band = self.band * jnp.abs(tally.first_error) if self.relative else self.band
        size, e2 = jnp.abs(e), e * e
        return Tally(
            first_error=tally.first_error,
            last_command=u,
            squared=tally.squared + whole * e2,
            squared_late=tally.squared_late + late * e2,
            absolute=tally.absolute + whole * size,
            absolute_timed=tally.absolute_timed + whole * sample.t * size,
            beyond=jnp.maximum(tally.beyond, -jnp.sign(tally.first_error) * e),
            last_outside=jnp.where(size > band, sample.t, tally.last_outside),
            outside_moment=self._moment(tally.outside_moment, whole, sample.t, size / band),
            command_squared=tally.command_squared + whole * u * u,
            peak=jnp.maximum(tally.peak, jnp.abs(u)),
            chatter=tally.chatter + onward * jnp.abs(u - tally.last_command),
            delivered=None if tally.delivered is None else _delivered(tally.delivered, sample, weights),
            ridden=None if tally.ridden is None else followed.update(tally.ridden, sample, (whole, late), self.late),
        )

    def _moment(self, moment: Array | None, weight: Array, t: Array, share: Array) -> Array | None:
        """Integral of t^(MOMENT - 1) over the time outside the band, whose edge is soft."""
        if moment is None:
            return None
        x = jnp.clip((share - 1 + EDGE) / (2 * EDGE), 0, 1)  # well inside it nothing counts, however late
        return moment + weight * t ** (MOMENT - 1) * x * x * (3 - 2 * x)

    def finish(self, tally: Tally, ok: Bool[Array, ""], horizon: Float[Array, ""]) -> Metrics:
        """The metrics of a run of `horizon` seconds."""

        def judged(value: Array) -> Array:
            return jnp.where(ok, value, jnp.inf)

        def mean_root(integral: Array, time: Array) -> Array:
            return judged(safe_sqrt(integral / time))

        late_time = horizon - self.late
        late = mean_root(tally.squared_late, jnp.where(late_time > 0, late_time, 1.0))
        settled = ok & (tally.last_outside < horizon - self.margin)
        smooth = None if tally.outside_moment is None else _smooth_settling(tally.outside_moment, settled, horizon)
        d = tally.delivered
        delivered: dict[str, Any] = {} if d is None else {"rms_delivered": mean_root(d.squared, horizon)}
        if d is not None:
            delivered |= {"peak_delivered": judged(d.peak), "variation_delivered": judged(d.variation)}
            delivered |= {"limited": judged(d.limited / horizon), "reversals_delivered": judged(d.reversals)}
        return Metrics(
            rmse=mean_root(tally.squared, horizon),
            rmse_late=jnp.where(late_time > 0, late, jnp.nan),
            iae=judged(tally.absolute),
            ise=judged(tally.squared),
            itae=judged(tally.absolute_timed),
            overshoot=judged(tally.beyond),
            settling_time=jnp.where(settled, tally.last_outside, jnp.inf),
            settled=settled,
            settling_smooth=None if smooth is None else judged(smooth),
            rms_command=mean_root(tally.command_squared, horizon),
            peak_command=judged(tally.peak),
            chatter=judged(tally.chatter),
            ok=ok,
            followed=None if tally.ridden is None else followed.finish(tally.ridden, ok, horizon, self.late),
            **delivered,
        )


def _nothing_delivered(sample: loop.Sample) -> Delivered:
    zero = jnp.zeros_like(sample.delivered)
    nothing = jnp.zeros_like(sample.t)
    return Delivered(
        last=sample.delivered, squared=zero, peak=zero, variation=zero, limited=nothing, way=zero, reversals=zero
    )


def _delivered(tally: Delivered, sample: loop.Sample, weights: Weights) -> Delivered:
    v, weight = sample.delivered, weights.whole
    way = jnp.where(v == 0, tally.way, jnp.sign(v))
    return Delivered(
        last=v,
        squared=tally.squared + weight * v * v,
        peak=jnp.maximum(tally.peak, jnp.abs(v)),
        variation=tally.variation + weights.onward * jnp.abs(v - tally.last),
        limited=tally.limited + weight * sample.limited.astype(weight.dtype),
        way=way,
        reversals=tally.reversals + (way * tally.way < 0).astype(v.dtype),
    )


def _smooth_settling(moment: Array, settled: Array, horizon: Array) -> Array:
    """The moment as a time [s]; of a run that has not settled at least its horizon, with the same slope.

    An error that leaves the band for good at T gives (integral of p t^(p-1) over [0, T])^(1/p) = T; one that comes back
    for a while adds that while, weighted by how late it is. So it changes smoothly where the last crossing jumps.
    """
    inside = moment > 0
    time = jnp.where(inside, (MOMENT * jnp.where(inside, moment, 1.0)) ** (1 / MOMENT), 0.0)
    return time + jax.lax.stop_gradient(jnp.where(settled, 0.0, jnp.maximum(horizon - time, 0.0)))


def _trapezoid(t: Array, left: Array, right: Array, begin: Real, end: Array) -> Array:
    """Weight of the sample at `t` in an integral from `begin` to `end`: half the way to either neighbour."""
    return jnp.maximum(jnp.minimum(left / 2, t - begin) + jnp.minimum(right / 2, end - t), 0)


def tracking_error(sample: Any) -> Float[Array, " c"]:
    """e_x [m], e_y [m], e_psi [rad, wrapped] of a sample or, with leading axes, of a trajectory.

    Without the last if the heading is not commanded: it is not a reference then.
    """
    position = sample.position - sample.reference_position
    if sample.command.shape[-1] == 2:
        return position
    heading = wrap(sample.heading - sample.reference_heading)
    return jnp.concatenate([position, heading[..., None]], axis=-1)


def measure(trajectory: loop.Trajectory, criteria: Criteria | None = None) -> Metrics:
    """Metrics of one trajectory, from its samples.

    Raises:
        ValueError: the trajectory has a batch axis; use `jax.vmap(measure)`.
    """
    if trajectory.t.ndim != 1:
        raise ValueError(
            f"measure takes one trajectory, t of shape (N+1,); got {trajectory.t.shape}: use jax.vmap(measure)"
        )
    criteria = Criteria() if criteria is None else criteria
    between, end = jnp.diff(trajectory.t), trajectory.t[-1]
    steps = jnp.concatenate([between[:1], between, between[-1:]])  # beyond either end nothing has weight
    weights = criteria.weights(trajectory.t, steps[:-1], steps[1:], end)
    samples = trajectory.samples()
    tally = criteria.start(jax.tree.map(lambda x: x[0], samples))
    tally, _ = jax.lax.scan(lambda m, row: (criteria.update(m, *row), None), tally, (samples, weights))
    return criteria.finish(tally, trajectory.ok, end)
