"""Settings of the tools beside the tuner: fronts, speeds, margins, sweeps, logs."""

from __future__ import annotations

import dataclasses

import agvjax
from agvjax._pytree import ANY, NONNEGATIVE, POSITIVE, number
from agvjax.metric_table import METRICS

from ..ensemble.draws import Between, Span, Times
from ..io.csv_file import Column
from .fields import (
    DRIVES,
    DURATION,
    FACTOR,
    LONG,
    MANY,
    MEMORY,
    OPEN,
    PACE,
    PROVING,
    ROLLED,
    ROUNDS,
    SHARE,
    STARTS,
    SWEPT,
    USUAL,
    choice,
)

DESIGNS = ("random", "sobol", "latin", "saltelli", "morris")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Pareto:
    """The front of the goal against one limit, in multiples of the starting gains'.

    Attributes:
        metric: the metric whose limit is varied.
        low: the tightest limit, times the starting gains'.
        high: the loosest limit, times the starting gains'.
        points: number of limits from low to high, each tuned for.
    """

    metric: str = choice("effort", [name for name, row in METRICS.items() if not row.loop])
    low: float = number(0.8, "1", POSITIVE)
    high: float = number(1.5, "1", POSITIVE)
    points: int = number(8, "1", STARTS)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Speed:
    """The largest distance of a vehicle to its route, and the speeds to try, in multiples of the route's own.

    Attributes:
        within: largest distance of a vehicle to its route; 0: the route's corridor.
        after: end of the start-up phase at the route's own speed; the same distance travelled at any other.
        low: the lowest speed tried, times the route's own.
        high: the highest speed tried, times the route's own.
        points: number of speeds from low to high.
        halvings: bisections of the gap between a speed that holds and the next that does not.
    """

    within: float = number(0.0, "m", NONNEGATIVE)
    after: float = number(8.0, "s", POSITIVE)
    low: float = number(0.5, "1", POSITIVE)
    high: float = number(2.0, "1", POSITIVE)
    points: int = number(7, "1", STARTS)
    halvings: int = number(3, "1", ROUNDS)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Margins:
    """Where a loop is linearised: at instants from `criteria.late` on, for vehicles not used for tuning.

    Attributes:
        instants: number of instants along a run.
        vehicles: number of vehicles besides the configured one, not used for tuning.
    """

    instants: int = number(USUAL.instants, "1", STARTS)
    vehicles: int = number(64, "1", DRIVES)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Bound:
    """When a run has failed: in multiples of the nominal run with the configured gains, or absolute.

    Attributes:
        value: a run fails above this, times the nominal run's value or in the metric's own unit.
        absolute: whether the value is in the metric's own unit.
    """

    value: float = number(1.5, "1", POSITIVE)
    absolute: bool = False


def default_over(actuator: str = "position") -> tuple[dict[str, Span], ...]:
    """How far may an actuator's deadzone deviate, under how large a disturbance? Its slopes down to a twentieth."""
    slopes = {f"deadzone.{actuator}.slope_{side}": Span(Times(0.05, 1.5), 41) for side in ("right", "left")}
    return slopes, {"disturbance.amplitude": Span(Between(0.0, 2.0), 41)}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Sweep:
    """The scenarios of a sweep, and what counts as a failure.

    Attributes:
        over: the axes, crossed; one table per axis, whose leaves move together. By default the deadzone's slopes and
            the disturbance.
        ensemble: whether to also draw the other leaves of the tuning ensemble.
        design: how samples are spread; "saltelli" and "morris" are for sensitivities.
        samples: number of samples at every node of the grid, if anything is sampled.
        controllers: besides the configured one: files of gains, or names of laws.
        metrics: which metrics of every run are stored.
        fails: bounds above which a run has failed, by metric.
        radius: whether to search for the largest box around the nominal point in which nothing fails.
        rollouts: with --rare, vehicles simulated in all; a gradient counts 1 + its tangents.
        shard: scenarios per file.
        dt: length of a step of a run of a sweep.
        integrator: integration method in a sweep.
    """

    over: tuple[dict[str, Span], ...] = OPEN  # see `default_over`
    ensemble: bool = False
    design: str = choice("random", DESIGNS)
    samples: int = number(1024, "1", SWEPT)
    controllers: tuple[str, ...] = ()
    metrics: tuple[str, ...] = OPEN  # those of `SWEPT_METRICS` that the plant has
    fails: dict[str, Bound] = OPEN  # more than `Bound()` of the first of `default_goals`
    radius: bool = True
    rollouts: int = number(100_000, "1", ROLLED)
    shard: int = number(8192, "1", MANY)
    dt: float = number(1e-2, "s", POSITIVE)
    integrator: str = choice("rk4", agvjax.INTEGRATORS)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Certify:
    """What is to be proved of every scenario of a box: how small the errors are after the transient.

    Attributes:
        within: bound on the errors in x and y from `criteria.late` on.
        within_heading: bound on the error of the heading from then on.
        over: the sides of the box, as the axes of a sweep; none: the leaves of [ensemble.draws].
        step: time step of the proof; a smaller one proves a little more.
        boxes: most parts into which a box is split for a proof.
        halvings: bisections between the largest box that is proved and the smallest that is not.
    """

    within: float = number(0.02, "m", POSITIVE)
    within_heading: float = number(0.2, "rad", POSITIVE)
    over: tuple[dict[str, Span], ...] = ()
    step: float = number(1e-2, "s", POSITIVE)
    boxes: int = number(16, "1", STARTS)
    halvings: int = number(4, "1", ROUNDS)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Identify:
    """How a log is read and fitted, and what a drive that is suggested may do.

    Attributes:
        fit: what is fitted: groups (deadzone, delay, lag, disturbance, vehicle, sensor) or leaves of the scenario.
        columns: where a quantity stands in the log, where the log has another name, unit or sign for it.
        topics: of a recording, by role (pose, command, speed, yaw_rate, steering) the topic that serves as it.
        stamps: of a recording, whose times are used: the sender's or those of arrival.
        ahead: how far ahead of the measured point, along its heading, the vehicle's reference point is.
        segment: length of a stretch that begins in a state of its own.
        memory: how long actuators remember commands, at most.
        gap: a longer step between rows than so many usual ones is a gap.
        outlier: a measurement off by more than so many standard deviations is left out.
        starts: of the fit, which must end at the same place.
        bootstrap: logs that are drawn of the stretches, for intervals.
        horizon: for how long ahead another log (--unseen) is predicted.
        drives: candidates among which a drive worth recording is chosen; 0: none is suggested.
        speed: of a suggested drive at most.
        yaw_rate: of a suggested drive at most.
        extent: size of the room that a suggested drive takes.
        duration: of a suggested drive.
    """

    fit: tuple[str, ...] = ("deadzone", "delay", "disturbance", "vehicle")
    columns: dict[str, Column] = dataclasses.field(default_factory=dict)
    topics: dict[str, str] = dataclasses.field(default_factory=dict)
    stamps: str = choice("auto", ("auto", "header", "arrival"))
    ahead: float = number(0.0, "m", ANY)
    segment: float = number(2.0, "s", LONG)
    memory: float = number(0.5, "s", MEMORY)
    gap: float = number(5.0, "1", FACTOR)
    outlier: float = number(6.0, "1", FACTOR)
    starts: int = number(4, "1", STARTS)
    bootstrap: int = number(1000, "1", MANY)
    horizon: float = number(5.0, "s", LONG)
    drives: int = number(32, "1", DRIVES)
    speed: float = number(0.6, "m/s", PACE)
    yaw_rate: float = number(1.2, "rad/s", PACE)
    extent: float = number(5.0, "m", LONG)
    duration: float = number(60.0, "s", DURATION)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Apply:
    """When new gains may replace those on a robot.

    Attributes:
        vehicles: vehicles drawn as the log leaves them possible, on which both sets of gains are simulated.
        starts: runs of each vehicle, whose goals are averaged: what differs from run to run (starts, phases) is drawn.
        share: of all such vehicles that must not be worse with the new gains.
        confidence: with which that must follow from those that were drawn.
        margin: share by which the error of a vehicle may rise and still count as not worse.
        slack: share by which a limit may be exceeded on the vehicles that were drawn.
        samples: further vehicles among which the searches for the worst one begin.
    """

    vehicles: int = number(256, "1", PROVING)
    starts: int = number(4, "1", STARTS)
    share: float = number(0.95, "1", SHARE)
    confidence: float = number(0.95, "1", SHARE)
    margin: float = number(0.0, "1", NONNEGATIVE)
    slack: float = number(0.02, "1", NONNEGATIVE)
    samples: int = number(128, "1", STARTS)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Watch:
    """When a log says that gains are no longer tuned for the robot that it is of.

    Attributes:
        false_alarms: share of the logs of an unchanged robot that raise an alarm.
        logs: logs that are simulated, of vehicles that the gains were tuned for, to be compared with.
        allowed: change of a number, as a share of it, with which gains still count as tuned.
        seen: change of a number, as a share of it, that a log must be able to show to say anything of it.
    """

    false_alarms: float = number(0.01, "1", SHARE)
    logs: int = number(199, "1", PROVING)
    allowed: float = number(0.02, "1", NONNEGATIVE)
    seen: float = number(0.3, "1", POSITIVE)
