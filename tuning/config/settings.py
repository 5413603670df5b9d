"""Everything that can be set, with its default and its rule."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable
from typing import Any

import numpy as np

import agvjax
from agvjax._pytree import FRACTION, NONNEGATIVE, POSITIVE, Rule, number
from agvjax.metric_table import AXES, METRICS
from agvjax.protocols import Law
from agvjax.timing import DT, N_STEPS

from ..ensemble.draws import Between, Correlation, Draw, Span, Times
from ..io.csv_file import Column

VERSION = 1  # of the file format
OPEN: Any = None  # what the law and the plant say; `complete` fills it in


def _whole(low: int, high: float, most: str) -> Rule:
    return Rule(f"a whole number from {low} to {most}", lambda x: (x >= low) & (x <= high) & (x == np.round(x)))


COUNT = Rule("a whole number >= 1", lambda x: (x >= 1) & (x == np.round(x)))
STARTS, ROUNDS, DRIVES = _whole(1, 1000, "1000"), _whole(0, 100, "100"), _whole(0, 4096, "4096")
SWEPT = _whole(1, 1e9, "10^9")
SCREENED = _whole(0, 1e5, "10^5")
MANY, SOME, WHOLE = _whole(1, 1e6, "10^6"), _whole(0, 1e7, "10^7"), _whole(0, 2**53, "2^53")
RATE = Rule("0, or from 10^-3 to 10^6", lambda x: (x == 0) | ((x >= 1e-3) & (x <= 1e6)))
WEIGHT = Rule(">= 0 and at most 10^6", lambda x: (x >= 0) & (x <= 1e6))
FACTOR = Rule("> 1 and at most 10^3", lambda x: (x > 1) & (x <= 1e3))
LONG = Rule("from 10^-3 to 10^4", lambda x: (x >= 1e-3) & (x <= 1e4))
DURATION = Rule("from 0.1 to 3600", lambda x: (x >= 0.1) & (x <= 3600))
MEMORY = Rule("from 10^-3 to 10", lambda x: (x >= 1e-3) & (x <= 10))
PACE = Rule("from 10^-3 to 10^3", lambda x: (x >= 1e-3) & (x <= 1e3))
LATE = tuple(f"rmse_late_{axis}" for axis in AXES)
SWEPT_METRICS = ("total_rmse", "effort", "peak_position", "peak_heading", "total_chatter", "longest_settling_time")
FOLLOWED_METRICS = ("cross_track", "cross_track_late", "cross_track_peak_late", "pace", "total_chatter", "standstill")
GAINS = ("all", "sensitive")  # every number of the law, or those of them that pay
DESIGNS = ("random", "sobol", "latin", "saltelli", "morris")


def choice(default: Any, options: Iterable[Any]) -> Any:
    """A field that holds one of some words or numbers."""
    return dataclasses.field(default=default, metadata={"choices": tuple(options)})


@dataclasses.dataclass(frozen=True, kw_only=True)
class Simulate:
    """How `agvjax simulate` steps, and how validation does."""

    dt: float = number(DT, "s", POSITIVE, "reading R10")
    horizon: float = number(DT * N_STEPS, "s", POSITIVE, "reading R10")
    integrator: str = choice("rk4", agvjax.INTEGRATORS)
    save_every: int = number(1, "steps", COUNT)
    control_every: int = number(1, "steps", COUNT)


USUAL = agvjax.Criteria()


@dataclasses.dataclass(frozen=True, kw_only=True)
class Criteria:
    """How runs are judged: when an error has settled, and from when on it is a late one; see `agvjax.Criteria`."""

    band: float = number(USUAL.band, "m, m, rad", POSITIVE, "reading R10")
    late: float = number(float(USUAL.late), "s", NONNEGATIVE, "past the transient")
    margin: float = number(
        USUAL.margin, "s", NONNEGATIVE, "a run outside the band this close to its end has not settled"
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Ensemble:
    """The scenarios to tune on and to validate on."""

    size: int = number(64, "1", MANY)
    validation_size: int = number(256, "1", MANY)
    fresh: bool = False  # tune on scenarios drawn anew every iteration; judge, and rank, on a fixed set all the same
    draws: dict[str, Draw] = OPEN  # of the deadzones and the disturbance, see `default_draws`
    correlation: Correlation | None = None  # of some of them


@dataclasses.dataclass(frozen=True, kw_only=True)
class Weights:
    """How much the statistics of a metric, each relative to the starting gains', weigh in the goal."""

    mean: float = number(0.0, "1", WEIGHT)
    worst: float = number(0.0, "1", WEIGHT)
    cvar: float = number(0.0, "1", WEIGHT)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Limit:
    """What a metric's statistics must not exceed, or with `least` fall below: times the starting gains' or absolute."""

    mean: float = np.inf  # infinite: none
    worst: float = np.inf
    cvar: float = np.inf
    absolute: bool = False
    least: bool = False


WHOLE_ERROR = {"total_rmse": Weights(mean=1.0, worst=0.3)}  # the goal of the preset paper-goal


def default_goals(
    known: Collection[str] = METRICS, horizon: object = np.inf, follows: bool = False, late: float = float(USUAL.late)
) -> dict[str, Weights]:
    """The error of the whole run, which is that of its start, and of each channel what is left after the start.

    A late error weighs a fortieth: little enough that the whole error hardly suffers, enough that no late error of the
    paper's law rises (docs/tuning.md has what other weights do). Runs shorter than twice the start, which is over at
    `late` [s], have none.

    A law that `follows` a route is to lie on it: its goal is the distance to it once the start is over.
    """
    long = isinstance(horizon, (int, float)) and horizon >= 2 * late
    if follows:
        return {"cross_track_late" if long else "cross_track": Weights(mean=1.0, worst=0.3)}
    goals = dict(WHOLE_ERROR)
    if long:
        goals |= {name: Weights(mean=0.025) for name in LATE if name in known}
    return goals


def default_limits(known: Collection[str] = METRICS, follows: bool = False) -> dict[str, Limit]:
    """No more command than the starting gains ask for, on average and at worst; of the metrics that are `known`.

    A law that `follows` a route is to be no slower, and its command to vary by no more than half as much again.
    """
    if follows:
        return {"pace": Limit(mean=1.0), "total_chatter": Limit(mean=1.5, worst=1.5)}
    limited = [name for name in ("effort", "peak_position", "peak_heading") if name in known]
    return dict.fromkeys(limited, Limit(mean=1.0, worst=1.0))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Search:
    """The search for the worst scenario, after tuning and between the rounds of it."""

    rounds: int = number(0, "1", ROUNDS)  # of tuning again with what was found; 0: search once and say what was found
    starts: int = number(7, "per metric", STARTS)
    iterations: int = number(8, "1", MANY)
    scouts: int = number(256, "samples to start from", MANY)
    checks: int = number(10_000, "samples besides", SOME)
    tolerance: float = number(5e-3, "1", NONNEGATIVE)  # a scenario this much worse than any tuned on is worth a round


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tune:
    """The tuning problem and how to solve it; its step is coarser than that of the validation."""

    gains: tuple[str, ...] | str = OPEN  # those that the law itself names; or one of `GAINS`
    tied: dict[str, str] = dataclasses.field(default_factory=dict)
    bounds: dict[str, tuple[float, float]] = dataclasses.field(default_factory=dict)
    goals: dict[str, Weights] = OPEN  # those of `default_goals` that the plant has
    limits: dict[str, Limit] = OPEN  # those of `default_limits` that the plant has
    tail: float = number(0.1, "share of the ensemble", FRACTION)
    stability_margin: float = number(1.0, "times what the stability conditions ask", POSITIVE)
    sample_rate: float = number(0.0, "Hz, 0 for 1 / dt", RATE)
    penalty: float = number(3.0, "1", NONNEGATIVE)
    dt: float = number(5e-3, "s", POSITIVE)
    integrator: str = choice("rk4", agvjax.INTEGRATORS)
    gradient: str = choice("auto", ("auto", "forward", "reverse"))
    optimizer: str = "sqp"
    options: dict[str, Any] = dataclasses.field(default_factory=dict)
    learning_rate: float = number(0.1, "1", POSITIVE)
    iterations: int = number(300, "1", COUNT)
    patience: int = number(100, "iterations", COUNT)
    clip: float = number(1.0, "norm of the gradient", POSITIVE)
    screen: int = number(512, "gain sets looked at before the search", SCREENED)  # 0: none
    starts: int = number(1, "1", STARTS)  # searches, from the best places of the screening that lie apart
    spread: float = number(3.0, "times, either way", FACTOR)  # of the gains about the configured ones that are tried
    checkpoint_every: int = number(10, "iterations", COUNT)
    search: Search = Search()


@dataclasses.dataclass(frozen=True, kw_only=True)
class Pareto:
    """The front of the goal against one limit, in multiples of the starting gains'."""

    metric: str = choice("effort", [name for name, row in METRICS.items() if not row.loop])
    low: float = number(0.8, "times", POSITIVE)
    high: float = number(1.5, "times", POSITIVE)
    points: int = number(8, "1", STARTS)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Speed:
    """How far a vehicle may lie off its route, and the speeds that are tried, in multiples of the route's own."""

    within: float = number(0.0, "m, 0: the route's corridor", NONNEGATIVE)
    after: float = number(8.0, "s at the route's own speed, as much way at any other: then the start is over", POSITIVE)
    low: float = number(0.5, "times", POSITIVE)
    high: float = number(2.0, "times", POSITIVE)
    points: int = number(7, "speeds from low to high", STARTS)
    halvings: int = number(3, "of the gap between a speed that holds and the next that does not", ROUNDS)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Margins:
    """Where a loop is linearised: at instants from `criteria.late` on, of vehicles that were not tuned on."""

    instants: int = number(USUAL.instants, "along a run", STARTS)
    vehicles: int = number(64, "beside the configured one", DRIVES)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Bound:
    """Beyond what a run has failed: in multiples of the nominal run with the configured gains, or absolute."""

    value: float = number(1.5, "times, or the metric's unit", POSITIVE)
    absolute: bool = False


def default_over(actuator: str = "position") -> tuple[dict[str, Span], ...]:
    """How far may an actuator's deadzone drift, under how strong a disturbance? Its slopes down to a twentieth."""
    slopes = {f"deadzone.{actuator}.slope_{side}": Span(Times(0.05, 1.5), 41) for side in ("right", "left")}
    return slopes, {"disturbance.amplitude": Span(Between(0.0, 2.0), 41)}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Sweep:
    """The scenarios to look at, in what detail, and what counts as a failure."""

    over: tuple[dict[str, Span], ...] = OPEN  # crossed; a table's leaves move as one; see `default_over`
    ensemble: bool = False  # draw the other leaves of the tuning ensemble too
    design: str = choice("random", DESIGNS)  # of what is sampled
    samples: int = number(1024, "at every node of the grid", SWEPT)
    controllers: tuple[str, ...] = ()  # beside the configured one: files of gains, or names of laws
    metrics: tuple[str, ...] = OPEN  # those of `SWEPT_METRICS` that the plant has
    fails: dict[str, Bound] = dataclasses.field(default_factory=lambda: {"total_rmse": Bound()})
    radius: bool = True  # look for the largest box around nominal in which nothing fails
    shard: int = number(8192, "scenarios", MANY)
    dt: float = number(1e-2, "s", POSITIVE)
    integrator: str = choice("rk4", agvjax.INTEGRATORS)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Identify:
    """How a log is read and fitted, and what a drive that is suggested may do."""

    fit: tuple[str, ...] = ("deadzone", "delay", "disturbance", "vehicle")
    columns: dict[str, Column] = dataclasses.field(default_factory=dict)  # of the log, where they have other names
    segment: float = number(2.0, "s, of a stretch that begins in a state of its own", LONG)
    memory: float = number(0.5, "s, for which actuators remember commands", MEMORY)
    gap: float = number(5.0, "usual steps between rows", FACTOR)
    outlier: float = number(6.0, "standard deviations", FACTOR)
    starts: int = number(4, "1", STARTS)
    bootstrap: int = number(1000, "resampled logs", MANY)
    horizon: float = number(5.0, "s, for which another log is predicted", LONG)
    drives: int = number(32, "candidates, 0 for no suggestion", DRIVES)
    speed: float = number(0.6, "m/s, of a suggested drive at most", PACE)
    yaw_rate: float = number(1.2, "rad/s, of a suggested drive at most", PACE)
    extent: float = number(5.0, "m, of the room that a suggested drive takes", LONG)
    duration: float = number(60.0, "s, of a suggested drive", DURATION)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Config:
    """Everything a command needs to know."""

    version: int = choice(VERSION, (VERSION,))
    imports: dict[str, str] = dataclasses.field(default_factory=dict)  # files of one's own classes: name, SHA-256
    seed: int = number(0, "1", WHOLE)
    precision: int = choice(64, (32, 64))  # bits of a floating-point number
    controller: Law = agvjax.NeuroBackstepping()
    scenario: agvjax.Scenario = dataclasses.field(default_factory=agvjax.Scenario)
    simulate: Simulate = Simulate()
    criteria: Criteria = Criteria()
    ensemble: Ensemble = dataclasses.field(default_factory=Ensemble)
    tune: Tune = dataclasses.field(default_factory=Tune)
    pareto: Pareto = Pareto()
    speed: Speed = Speed()
    margins: Margins = Margins()
    sweep: Sweep = Sweep()
    identify: Identify = dataclasses.field(default_factory=Identify)

    def judged(self, **more: bool) -> agvjax.Criteria:
        """How runs are judged; `more` as in `agvjax.Criteria`."""
        return agvjax.Criteria(**vars(self.criteria), instants=self.margins.instants, **more)

    def timing(self, command: str = "simulate") -> agvjax.Timing:
        """How the runs of a command are stepped: "simulate", "tune" or "sweep".

        Control instants are `simulate.control_every` steps of `simulate.dt` apart, whatever the step of the command; 1
        means every step.
        """
        section, every = getattr(self, command), self.simulate.control_every
        if every > 1:
            every = max(1, round(every * self.simulate.dt / section.dt))
        method = agvjax.INTEGRATORS[section.integrator]
        steps = round(self.simulate.horizon / section.dt)
        return agvjax.Timing(dt=section.dt, n_steps=steps, control_every=every, integrator=method)
