"""The metrics of a run, and their table: one row a metric, with one name in Python, TOML, tables and docs.

A field of `Metrics` has a number for each channel, and `NAME_x`, `NAME_y`, `NAME_heading` is one of them; a metric over
all channels is a property. A new metric is a field or a property here, a row in `METRICS`, and what it accumulates in
`agvjax.metrics`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ._pytree import pytree
from .geometry import safe_sqrt
from .scenario import Scenario

AXES = ("x", "y", "heading")  # the channels, in order


class Metric(NamedTuple):
    """A row of the table.

    Attributes:
        name: in Python (`metrics[name]`), TOML, tables and docs.
        unit: of its values, for tables.
        text: what it is, for people.
        heading: whether it exists only if the heading can be commanded.
        delivered: whether it exists only with `Criteria.delivered`.
        route: whether it exists only if the path is a route.
        loop: whether it is a property of the linearised loop, by `agvjax.margins.with_margins`.
        large: whether large is good, so that its worst is the smallest.
        field: the field of `Metrics`, if it has another name.
        channel: which channel of the field; None for a field without channels.
    """

    name: str
    unit: str
    text: str = ""
    heading: bool = False
    delivered: bool = False
    route: bool = False
    loop: bool = False
    large: bool = False
    field: str = ""
    channel: int | None = None


def _by_axis(name: str, position: str, heading: str, text: str, field: str = "") -> list[Metric]:
    units = (position, position, heading)
    return [
        Metric(f"{name}_{a}", units[i], f"{a}: {text}", heading=i == 2, field=field or name, channel=i)
        for i, a in enumerate(AXES)
    ]


METRICS: dict[str, Metric] = {
    row.name: row
    for row in (
        Metric("total_rmse", "m, rad", "root of the sum of the squared RMS errors of all channels"),
        Metric("effort", "mixed units", "RMS of the command of all channels, before the deadzone"),
        Metric("peak_position", "m/s^2", "largest command of x or y, or of speed and yaw rate"),
        Metric("peak_heading", "rad/s", "largest command of the heading", heading=True),
        Metric("total_chatter", "mixed units", "total variation of the command, summed over the channels"),
        Metric("longest_settling_time", "s", "settling time of the channel that settles last"),
        Metric("total_iae", "mixed units", "integral of the absolute error, summed over the channels"),
        Metric("total_ise", "mixed units", "integral of the squared error, summed over the channels"),
        Metric("total_itae", "mixed units", "integral of time times the absolute error, summed over the channels"),
        *_by_axis("rmse", "m", "rad", "RMS error over the run"),
        *_by_axis("rmse_late", "m", "rad", "RMS error after criteria.late"),
        *_by_axis("overshoot", "m", "rad", "largest overshoot past zero, from the side where the error started"),
        *_by_axis("settling_time", "s", "s", "last time outside criteria.band", field="sloped_settling_time"),
        *_by_axis("rms_command", "m/s^2", "rad/s", "RMS of the command"),
        *_by_axis("peak_command", "m/s^2", "rad/s", "largest command")[:2],  # that of the heading is `peak_heading`
        *_by_axis("chatter", "m/s^2", "rad/s", "total variation of the command"),
        Metric("delivered_effort", "actuator units", "RMS of all actuator outputs", delivered=True),
        Metric("delivered_peak", "actuator units", "largest actuator output", delivered=True),
        Metric("delivered_variation", "actuator units", "total variation of all actuator outputs", delivered=True),
        Metric("reversals", "times", "how often actuator outputs change sign", delivered=True),
        Metric("limited", "share of the time", "how long an actuator or the law is at a limit", delivered=True),
        Metric("cross_track", "m", "RMS distance to the nearest point of the route", route=True),
        Metric("cross_track_late", "m", "RMS distance to the route after criteria.late", route=True),
        Metric("cross_track_peak", "m", "largest distance to the route", route=True),
        Metric("cross_track_peak_late", "m", "largest distance to the route after criteria.late", route=True),
        Metric("heading_error", "rad", "RMS angle between the vehicle and the route's tangent", route=True),
        Metric("along_track", "m", "RMS distance ahead of or behind the schedule of the speed profile", route=True),
        Metric("speed_error", "m/s", "RMS deviation from the route's speed profile", route=True),
        Metric("pace", "s/m", "time per metre of the route", route=True),
        Metric("outside_corridor", "share of the time", "how long it is outside the corridor", route=True),
        Metric("corridor_excess", "m", "largest distance outside the corridor", route=True),
        Metric("corridor_excess_late", "m", "largest distance outside the corridor after criteria.late", route=True),
        Metric("lateral_acceleration", "m/s^2", "largest speed times yaw rate", route=True),
        Metric("jerk", "m/s^3", "RMS rate of change of the acceleration along the route", route=True),
        Metric("standstill", "share of the time", "how long it stands still although motion is commanded", route=True),
        Metric("time_to_finish", "s", "when it reaches the end; infinite if never", route=True),
        Metric("gain_margin", "times", "factor on the gain at one actuator until instability", loop=True, large=True),
        Metric("phase_margin", "rad", "added phase lag at one actuator until instability", loop=True, large=True),
        Metric("delay_margin", "s", "added delay at one actuator until instability", loop=True, large=True),
        Metric("sensitivity", "1", "Ms, largest |1 / (1 + L)| of the linearised loop L", loop=True),
    )
}

OLD_NAMES = {  # in files of earlier releases
    "rmse": "total_rmse",
    "chatter": "total_chatter",
    "settling_time": "longest_settling_time",
    "iae": "total_iae",
    "ise": "total_ise",
    "itae": "total_itae",
    **{f"effort_{axis}": f"rms_command_{axis}" for axis in AXES},
    **{f"peak_{axis}": f"peak_command_{axis}" for axis in AXES[:2]},
}


def metrics_of(scenario: Scenario, loop: bool = False) -> tuple[str, ...]:
    """The metrics that a scenario has: those of the heading only if it can be commanded, those of a route only on one.

    Those of the linearised loop only if asked for: a run alone does not have them.
    """
    there = {"heading": scenario.plant.commands_heading, "route": scenario.path.by_arc(), "loop": loop}
    return tuple(n for n, row in METRICS.items() if all(there[k] or not getattr(row, k) for k in there))


@pytree
class Followed:
    """How well a route was followed; a batch adds leading axes."""

    cross_track: Float[Array, ""]  # m, root of the mean squared distance to the nearest point of the route's leg
    cross_track_late: Float[Array, ""]  # the same after `Criteria.late`; NaN where the run is shorter
    cross_track_peak: Float[Array, ""]  # m, the largest
    cross_track_peak_late: Float[Array, ""]  # the largest after `Criteria.late`
    heading_error: Float[Array, ""]  # rad, root of the mean squared angle between vehicle and route
    along_track: Float[Array, ""]  # m, root of the mean squared way by which it is ahead of or behind the clock
    speed_error: Float[Array, ""]  # m/s, root of the mean squared difference to the profile
    pace: Float[Array, ""]  # s/m, time for each metre of the route: the inverse of the mean speed along it
    outside_corridor: Float[Array, ""]  # share of the time; 0 without a corridor
    corridor_excess: Float[Array, ""]  # m, the most beyond it
    corridor_excess_late: Float[Array, ""]  # the most after `Criteria.late`
    lateral_acceleration: Float[Array, ""]  # m/s^2, largest |v w|
    jerk: Float[Array, ""]  # m/s^3, root of the mean square, by differences from step to step
    standstill: Float[Array, ""]  # share of the time in which it stands still although motion is commanded
    time_to_finish: Float[Array, ""]  # s, until it is within `Route.reached` of the end; infinite if never


MOST, LONGEST = 100.0, 1.0  # a gain margin or a sensitivity, and a delay margin [s], that is larger counts as that


@pytree
class LoopMargins:
    """The tightest of the linearised loop along a run, over its actuators; a batch adds leading axes.

    0, and of the sensitivity `MOST`, where a loop is unstable or no instant could be looked at.
    """

    gain_margin: Any  # times, by which the gain of one actuator may grow; at most `MOST`
    phase_margin: Any  # rad, at most pi
    delay_margin: Any  # s, of more delay than there is; at most `LONGEST`
    sensitivity: Any  # Ms, the largest |1 / (1 + L)|; at most `MOST`


@pytree
class Metrics:
    """One number for each of the c channels x, y and, where it can be commanded, heading; a batch adds leading axes.

    A diverged run has infinite metrics.
    """

    rmse: Float[Array, " c"]  # m, m, rad
    rmse_late: Float[Array, " c"]  # the same after `Criteria.late`; NaN where the run is shorter
    iae: Float[Array, " c"]  # integral of |e|
    ise: Float[Array, " c"]  # integral of e^2
    itae: Float[Array, " c"]  # integral of t |e|
    overshoot: Float[Array, " c"]  # furthest beyond zero from where the error started, m, m, rad
    settling_time: Float[Array, " c"]  # s, last time outside the band; infinite where not settled
    settled: Bool[Array, " c"]  # False: outside the band within `Criteria.margin` of the end
    rms_command: Float[Array, " c"]  # m/s^2, m/s^2, rad/s
    peak_command: Float[Array, " c"]  # largest |u|
    chatter: Float[Array, " c"]  # total variation of u
    ok: Bool[Array, ""]  # False: diverged, state frozen
    settling_smooth: Float[Array, " c"] | None = None  # s, lends the settling time its slope; with `Criteria.smooth`
    rms_delivered: Float[Array, " m"] | None = None  # of the plant's m actuators; with `Criteria.delivered`
    peak_delivered: Float[Array, " m"] | None = None
    variation_delivered: Float[Array, " m"] | None = None  # total variation
    reversals_delivered: Float[Array, " m"] | None = None  # how often its sign changed, what is 0 left out
    followed: Followed | None = None  # where the path is a route
    limited: Float[Array, ""] | None = None  # share of the time in which an actuator or the law was at its limit
    loop: LoopMargins | None = None  # by `agvjax.margins.with_margins`

    def __getitem__(self, name: str) -> Float[Array, ""]:
        """The metric of a row of `METRICS`, by its name."""
        row = METRICS[name]
        if row.route:
            if self.followed is None:
                raise ValueError(f"{name} needs a route: make the path one, Route.along(path)")
            return getattr(self.followed, name)
        if row.loop:
            if self.loop is None:
                raise ValueError(f"{name} needs the linearised loop: agvjax.margins.with_margins adds it")
            return getattr(self.loop, name)
        values = getattr(self, row.field or name)
        if values is None:
            raise ValueError(f"{name} needs the output of the actuators: use Criteria(delivered=True)")
        return values if row.channel is None else values[..., row.channel]

    def names(self) -> tuple[str, ...]:
        """The metrics that it has values of."""
        heading, delivered, route = self.rmse.shape[-1] == 3, self.limited is not None, self.followed is not None
        there = {"heading": heading, "delivered": delivered, "route": route, "loop": self.loop is not None}
        return tuple(n for n, row in METRICS.items() if all(there[k] or not getattr(row, k) for k in there))

    @property
    def total_rmse(self) -> Float[Array, ""]:
        """sqrt(mean of e_x^2 + e_y^2 + e_psi^2), the error of the default tuning problem."""
        return self._root_of_sum(self.rmse)

    @property
    def effort(self) -> Float[Array, ""]:
        """sqrt(mean of u_x^2 + u_y^2 + omega_bar^2)."""
        return self._root_of_sum(self.rms_command)

    @property
    def peak_position(self) -> Float[Array, ""]:
        """Largest |u_x| or |u_y| [m/s^2]."""
        return jnp.max(self.peak_command[..., :2], axis=-1)

    @property
    def peak_heading(self) -> Float[Array, ""]:
        """Largest |omega_bar| [rad/s]."""
        return self.peak_command[..., 2]

    @property
    def total_chatter(self) -> Float[Array, ""]:
        """Sum of the total variations of the commands."""
        return jnp.sum(self.chatter, axis=-1)

    @property
    def longest_settling_time(self) -> Float[Array, ""]:
        """Settling time of the channel that settles last [s]."""
        return jnp.max(self.sloped_settling_time, -1)

    @property
    def total_iae(self) -> Float[Array, ""]:
        """Sum of the integrals of |e|."""
        return jnp.sum(self.iae, -1)

    @property
    def total_ise(self) -> Float[Array, ""]:
        """Sum of the integrals of e^2."""
        return jnp.sum(self.ise, -1)

    @property
    def total_itae(self) -> Float[Array, ""]:
        """Sum of the integrals of t |e|."""
        return jnp.sum(self.itae, -1)

    @property
    def sloped_settling_time(self) -> Float[Array, " c"]:
        """The settling time with the slope of `settling_smooth`; where not settled, the smooth time itself.

        Without `Criteria.smooth` it is `settling_time`.
        """
        true, smooth = self.settling_time, self.settling_smooth
        if smooth is None:
            return true
        fine = jnp.isfinite(true) & jnp.isfinite(smooth)
        return smooth + jax.lax.stop_gradient(jnp.where(fine, true, 0.0) - jnp.where(fine, smooth, 0.0))

    @property
    def delivered_effort(self) -> Float[Array, ""]:
        """sqrt(mean of the sum of squares of what the actuators delivered)."""
        return self._root_of_sum(_judged(self.rms_delivered))

    @property
    def delivered_peak(self) -> Float[Array, ""]:
        """Largest size of what an actuator delivered."""
        return jnp.max(_judged(self.peak_delivered), -1)

    @property
    def delivered_variation(self) -> Float[Array, ""]:
        """Sum of the total variations of what the actuators delivered."""
        return jnp.sum(_judged(self.variation_delivered), -1)

    @property
    def reversals(self) -> Float[Array, ""]:
        """How often actuator outputs change sign, summed; a count, without a slope."""
        return jnp.sum(_judged(self.reversals_delivered), -1)

    def _root_of_sum(self, parts: Float[Array, " c"]) -> Float[Array, ""]:
        ok = jnp.asarray(self.ok)
        finite = jnp.where(ok[..., None], parts, 0.0)  # the square of an infinite metric would have a slope of NaN
        return jnp.where(ok, safe_sqrt(jnp.sum(finite**2, axis=-1)), jnp.inf)


def _judged(values: Float[Array, " m"] | None) -> Float[Array, " m"]:
    """What actuators delivered, where that was looked at."""
    if values is None:
        raise ValueError("metrics of the output of actuators need Criteria(delivered=True)")
    return jnp.asarray(values)
