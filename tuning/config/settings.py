"""All settings, with default, unit, rule and meaning.

The meaning of a setting is in the Attributes of its class, in its unit; `described` reads it there.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import agvjax
from agvjax._pytree import FRACTION, NONNEGATIVE, POSITIVE, number
from agvjax.protocols import Law
from agvjax.timing import DT, N_STEPS

from ..ensemble.draws import Correlation, Draw
from .asked import LATE as LATE
from .asked import WHOLE_ERROR as WHOLE_ERROR
from .asked import Limit as Limit
from .asked import Weights as Weights
from .asked import default_goals as default_goals
from .asked import default_limits as default_limits
from .fields import COUNT, FACTOR, MANY, OPEN, RATE, ROUNDS, SCREENED, SOME, STARTS, USUAL, WHOLE, choice
from .tools import Apply as Apply
from .tools import Bound as Bound
from .tools import Certify as Certify
from .tools import Identify as Identify
from .tools import Margins as Margins
from .tools import Pareto as Pareto
from .tools import Speed as Speed
from .tools import Sweep as Sweep
from .tools import Watch as Watch
from .tools import default_over as default_over

VERSION = 1  # of the file format
SWEPT_METRICS = ("total_rmse", "effort", "peak_position", "peak_heading", "total_chatter", "longest_settling_time")
FOLLOWED_METRICS = ("cross_track", "cross_track_late", "cross_track_peak_late", "pace", "total_chatter", "standstill")
GAINS = ("all", "sensitive")  # every parameter of the law, or those predicted to lower the cost


@dataclasses.dataclass(frozen=True, kw_only=True)
class Simulate:
    """Time stepping of `agvjax simulate` and of the validation.

    Attributes:
        dt: length of a step; at most what keeps the command filter stable (reading R10).
        horizon: how long a run is (reading R10); a whole number of steps.
        integrator: integration method; "euler" is the fastest and least accurate.
        save_every: steps between samples in trajectory.npz.
        control_every: steps between control instants of laws and sensors with a memory; 1 for a sampled law, which has
            its own period.
    """

    dt: float = number(DT, "s", POSITIVE, "reading R10")
    horizon: float = number(DT * N_STEPS, "s", POSITIVE, "reading R10")
    integrator: str = choice("rk4", agvjax.INTEGRATORS)
    save_every: int = number(1, "steps", COUNT)
    control_every: int = number(1, "steps", COUNT)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Criteria:
    """How runs are evaluated: when an error has settled, and when it counts as late; see `agvjax.Criteria`.

    Attributes:
        band: an error that stays within it has settled (reading R10).
        late: start of the late error, after the initial transient.
        margin: a run outside the band this close to its end has not settled.
    """

    band: float = number(USUAL.band, "m, m, rad", POSITIVE, "reading R10")
    late: float = number(float(USUAL.late), "s", NONNEGATIVE)
    margin: float = number(USUAL.margin, "s", NONNEGATIVE)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Ensemble:
    """The scenarios to tune on and to validate on.

    Attributes:
        size: how many scenarios to tune on, drawn with `seed`.
        validation_size: how many to validate on, drawn with `seed + 1`.
        fresh: whether to tune on scenarios drawn anew every iteration, for the optimisers of optax; gains are still
            evaluated and ranked on a fixed set.
        draws: how each leaf of the scenario is drawn, by its name; by default deadzones, disturbance and start around
            the configured ones.
        correlation: which leaves are drawn together.
    """

    size: int = number(64, "1", MANY)
    validation_size: int = number(256, "1", MANY)
    fresh: bool = False
    draws: dict[str, Draw] = OPEN
    correlation: Correlation | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Search:
    """The search for the worst scenario, after tuning and between its rounds.

    Attributes:
        rounds: rounds of tuning again with the scenarios found; 0: search once and report them.
        starts: ascents for each metric.
        iterations: steps of each ascent.
        scouts: samples; the ascents begin at the worst of them.
        checks: further samples, to check the result of the ascents.
        tolerance: how much worse, as a share, than any tuning scenario a found one must be to start another round.
    """

    rounds: int = number(0, "1", ROUNDS)
    starts: int = number(7, "1", STARTS)
    iterations: int = number(8, "1", MANY)
    scouts: int = number(256, "1", MANY)
    checks: int = number(10_000, "1", SOME)
    tolerance: float = number(5e-3, "1", NONNEGATIVE)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tune:
    """The tuning problem and how to solve it; its time step is coarser than that of the validation.

    Attributes:
        gains: the gains to tune: any scalar parameters of the law, "all" of them, or "sensitive", those predicted to
            lower the cost; by default those that the law itself names.
        tied: gains that follow a tuned one, in their starting ratio.
        bounds: [low, high] of a gain, narrower than the built-in bounds.
        goals: the cost: a weighted sum of statistics of metrics, each relative to its value with the starting gains.
        limits: upper limits on statistics of metrics; added to the default ones.
        tail: the share of the ensemble, the worst, whose mean is the statistic "cvar".
        stability_margin: factor on the bounds of the law's stability conditions.
        sample_rate: rate at which the law must be able to run; 0: that of the tuning step.
        penalty: cost of exceeding a limit, for each unit of ratio.
        dt: length of a step of a run while tuning.
        integrator: integration method while tuning.
        gradient: "forward" or "reverse" mode differentiation; "auto" uses forward mode up to 30 gains.
        optimizer: "sqp", sequential quadratic programming, which needs no settings; "cma", which needs no gradient; or
            an optimiser of optax by its name.
        options: further arguments of the optimiser.
        learning_rate: learning rate of an optimiser of optax; it decays to 0 along a cosine.
        iterations: largest number of iterations of a search.
        patience: a search ends after this many iterations without improvement.
        clip: norm to which a gradient is clipped for optimisers of optax.
        screen: gain sets evaluated before the search, which begins at the best of them; 0: none.
        starts: searches, from the best points of the screening that lie apart; the best result is kept.
        spread: the factor, either way, within which gain sets around the configured gains are tried.
        checkpoint_every: iterations between checkpoints for --resume.
        search: the search for the worst scenario.
    """

    gains: tuple[str, ...] | str = OPEN  # or one of `GAINS`
    tied: dict[str, str] = dataclasses.field(default_factory=dict)
    bounds: dict[str, tuple[float, float]] = dataclasses.field(default_factory=dict)
    goals: dict[str, Weights] = OPEN  # those of `default_goals` that the plant has
    limits: dict[str, Limit] = OPEN  # those of `default_limits` that the plant has
    tail: float = number(0.1, "1", FRACTION)
    stability_margin: float = number(1.0, "1", POSITIVE)
    sample_rate: float = number(0.0, "Hz", RATE)
    penalty: float = number(3.0, "1", NONNEGATIVE)
    dt: float = number(5e-3, "s", POSITIVE)
    integrator: str = choice("rk4", agvjax.INTEGRATORS)
    gradient: str = choice("auto", ("auto", "forward", "reverse"))
    optimizer: str = "sqp"
    options: dict[str, Any] = dataclasses.field(default_factory=dict)
    learning_rate: float = number(0.1, "1", POSITIVE)
    iterations: int = number(300, "1", COUNT)
    patience: int = number(100, "1", COUNT)
    clip: float = number(1.0, "1", POSITIVE)
    screen: int = number(512, "1", SCREENED)
    starts: int = number(1, "1", STARTS)
    spread: float = number(3.0, "1", FACTOR)
    checkpoint_every: int = number(10, "1", COUNT)
    search: Search = Search()


@dataclasses.dataclass(frozen=True, kw_only=True)
class Config:
    """The complete configuration of a command.

    Attributes:
        version: of this file format.
        imports: Python files with your own classes, by name, with the SHA-256 of each; written by a run.
        seed: of every random number.
        precision: bits of a floating-point number.
        controller: the law and its gains; for a law in a computer also its period.
        scenario: everything that the law does not know: vehicle, actuators, path, disturbance, start.
        simulate: steps and length of a run.
        criteria: how runs are evaluated.
        ensemble: the vehicles for tuning and for validation.
        tune: the gains, goals, limits and search of the tuning.
        pareto: of `agvjax pareto`: the front of the goal against one limit.
        speed: of `agvjax speed`: which speeds are tried.
        margins: of `agvjax margins`: where a loop is linearised.
        sweep: of `agvjax sweep`: the scenarios, and what counts as a failure.
        certify: of `agvjax certify`: the bounds, and the box of scenarios that they are to hold in.
        identify: of `agvjax identify`: how a log is read and fitted.
        apply: of `agvjax apply`: when new gains may replace others.
        watch: of `agvjax watch`: when a log says that gains are no longer tuned.
    """

    version: int = choice(VERSION, (VERSION,))
    imports: dict[str, str] = dataclasses.field(default_factory=dict)
    seed: int = number(0, "1", WHOLE)
    precision: int = choice(64, (32, 64))
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
    certify: Certify = Certify()
    identify: Identify = dataclasses.field(default_factory=Identify)
    apply: Apply = Apply()
    watch: Watch = Watch()

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
