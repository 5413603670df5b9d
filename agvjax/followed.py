"""How a route was followed, accumulated sample by sample beside `agvjax.metrics`; rows in `agvjax.metric_table`.

All counts over the whole run but what says `late`. Integrals are by the trapezoid over all samples, of the integrator's
every step; the nearest point is looked for at control instants and continued between, see `agvjax.engine.beside`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ._pytree import Real, pytree
from .geometry import into_body, safe_sqrt
from .metric_table import Followed

if TYPE_CHECKING:
    from .engine.loop import Sample

CREEP = 1e-3  # m/s and rad/s, below which a vehicle stands


@pytree
class Ridden:
    """Running sums and extremes of one run along a route."""

    across: Float[Array, ""]  # m^2 s
    across_late: Float[Array, ""]
    furthest: Float[Array, ""]  # m
    furthest_late: Float[Array, ""]
    heading_error: Float[Array, ""]  # rad^2 s
    along: Float[Array, ""]  # m^2 s
    slow: Float[Array, ""]  # m^2/s
    way: Float[Array, ""]  # m
    beyond: Float[Array, ""]  # s
    excess: Float[Array, ""]  # m
    excess_late: Float[Array, ""]
    lateral: Float[Array, ""]  # m/s^2
    jerk: Float[Array, ""]  # m^2/s^5
    stuck: Float[Array, ""]  # s
    finished: Float[Array, ""]  # s
    last: Float[Array, "3"]  # t, speed along the heading, acceleration of the sample before


def start(sample: Sample) -> Ridden | None:
    """The tally before the first sample; None where the path is no route."""
    if sample.route is None:
        return None
    zero = jnp.zeros_like(sample.t)
    names = [f for f in Ridden.__dataclass_fields__ if f not in ("last", "finished")]
    last = jnp.stack([sample.t, into_body(sample.velocity, sample.heading)[0], zero])
    return Ridden(**dict.fromkeys(names, zero), finished=jnp.full_like(zero, jnp.inf), last=last)


def update(tally: Ridden, sample: Sample, weights: tuple[Array, Array], late: Real) -> Ridden:
    """The tally with one more sample; `late` [s] is from when on it is."""
    ride, (whole, after) = sample.route, weights
    assert ride is not None
    e2, size = ride.cross_track**2, jnp.abs(ride.cross_track)
    zero, t = jnp.zeros_like(size), sample.t
    own, _ = into_body(sample.velocity, sample.heading)  # of the vehicle: that along the route jumps as its curvature
    acceleration, jerk = _jolt(tally.last, t, own)
    done = tally.finished < jnp.inf
    stands = (jnp.sum(sample.velocity**2) < CREEP**2) & (jnp.abs(ride.yaw_rate) < CREEP)
    stuck = stands & jnp.any(sample.inputs != 0) & ~done
    over = zero
    if ride.room is not None:
        left, right = ride.room
        over = jnp.maximum(jnp.maximum(ride.cross_track - left, -ride.cross_track - right), 0)
    return Ridden(
        across=tally.across + whole * e2,
        across_late=tally.across_late + after * e2,
        furthest=jnp.maximum(tally.furthest, size),
        furthest_late=jnp.maximum(tally.furthest_late, jnp.where(t >= late, size, 0)),
        heading_error=tally.heading_error + whole * ride.heading_error**2,
        along=tally.along + whole * ride.ahead**2,
        slow=tally.slow + whole * (ride.speed - ride.wanted) ** 2,
        way=tally.way + whole * ride.speed,
        beyond=tally.beyond + whole * (over > 0).astype(whole.dtype),
        excess=jnp.maximum(tally.excess, over),
        excess_late=jnp.maximum(tally.excess_late, jnp.where(t >= late, over, 0)),
        lateral=jnp.maximum(tally.lateral, jnp.abs(own * ride.yaw_rate)),
        jerk=tally.jerk + whole * jerk**2,
        stuck=tally.stuck + whole * stuck.astype(whole.dtype),
        finished=jnp.minimum(tally.finished, jnp.where(ride.arrived, t, jnp.inf)),
        last=jnp.stack([t, own, acceleration]),
    )


def _jolt(last: Array, t: Array, speed: Array) -> tuple[Array, Array]:
    """Acceleration [m/s^2] and jerk [m/s^3] by differences of two samples."""
    h = t - last[0]
    fresh = h > 0
    safe = jnp.where(fresh, h, 1.0)
    acceleration = jnp.where(fresh, (speed - last[1]) / safe, last[2])
    return acceleration, jnp.where(fresh, (acceleration - last[2]) / safe, 0.0)


def finish(tally: Ridden, ok: Bool[Array, ""], horizon: Array, late: Real) -> Followed:
    """The metrics of a run of `horizon` seconds."""

    def judged(value: Array) -> Array:
        return jnp.where(ok, value, jnp.inf)

    def root(integral: Array, time: Array = horizon) -> Array:
        return judged(safe_sqrt(integral / time))

    rest = horizon - late
    late_root = root(tally.across_late, jnp.where(rest > 0, rest, 1.0))
    moved = tally.way > 0
    return Followed(
        cross_track=root(tally.across),
        cross_track_late=jnp.where(rest > 0, late_root, jnp.nan),
        cross_track_peak=judged(tally.furthest),
        cross_track_peak_late=jnp.where(rest > 0, judged(tally.furthest_late), jnp.nan),
        heading_error=root(tally.heading_error),
        along_track=root(tally.along),
        speed_error=root(tally.slow),
        pace=judged(jnp.where(moved, horizon / jnp.where(moved, tally.way, 1.0), jnp.inf)),
        outside_corridor=judged(tally.beyond / horizon),
        corridor_excess=judged(tally.excess),
        corridor_excess_late=jnp.where(rest > 0, judged(tally.excess_late), jnp.nan),
        lateral_acceleration=judged(tally.lateral),
        jerk=root(tally.jerk),
        standstill=judged(tally.stuck / horizon),
        time_to_finish=judged(tally.finished),
    )
