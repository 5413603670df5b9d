"""Everything that can be set, with its default, its unit, its rule and what it means.

What a setting means stands under Attributes of its class, in its unit; `described` reads it there.
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
from .tools import Bound as Bound
from .tools import Identify as Identify
from .tools import Margins as Margins
from .tools import Pareto as Pareto
from .tools import Speed as Speed
from .tools import Sweep as Sweep
from .tools import default_over as default_over

VERSION = 1  # of the file format
SWEPT_METRICS = ("total_rmse", "effort", "peak_position", "peak_heading", "total_chatter", "longest_settling_time")
FOLLOWED_METRICS = ("cross_track", "cross_track_late", "cross_track_peak_late", "pace", "total_chatter", "standstill")
GAINS = ("all", "sensitive")  # every number of the law, or those of them that pay


@dataclasses.dataclass(frozen=True, kw_only=True)
class Simulate:
    """How `agvjax simulate` steps, and how validation does.

    Attributes:
        dt: length of a step; at most what keeps the command filter stable (reading R10).
        horizon: how long a run is (reading R10); a whole number of steps.
        integrator: how a step is made; "euler" is the fastest and the least exact.
        save_every: steps between the samples of trajectory.npz.
        control_every: steps between control instants of laws and sensors with a memory; 1 of a sampled law, which has
            a period of its own.
    """

    dt: float = number(DT, "s", POSITIVE, "reading R10")
    horizon: float = number(DT * N_STEPS, "s", POSITIVE, "reading R10")
    integrator: str = choice("rk4", agvjax.INTEGRATORS)
    save_every: int = number(1, "steps", COUNT)
    control_every: int = number(1, "steps", COUNT)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Criteria:
    """How runs are judged: when an error has settled, and from when on it is a late one; see `agvjax.Criteria`.

    Attributes:
        band: an error that stays within it has settled (reading R10).
        late: from when on an error is a late one, past the transient of the start.
        margin: a run that is outside the band this close to its end has not settled.
    """

    band: float = number(USUAL.band, "m, m, rad", POSITIVE, "reading R10")
    late: float = number(float(USUAL.late), "s", NONNEGATIVE)
    margin: float = number(USUAL.margin, "s", NONNEGATIVE)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Ensemble:
    """The scenarios to tune on and to validate on.

    Attributes:
        size: how many scenarios to tune on, drawn with `seed`.
        validation_size: how many to judge on, drawn with `seed + 1`.
        fresh: whether to tune on scenarios drawn anew every iteration, for the optimisers of optax; gains are judged,
            and ranked, on a fixed set all the same.
        draws: how each leaf of the scenario is drawn, by its name; without it deadzones, disturbance and start about
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
    """The search for the worst scenario, after tuning and between the rounds of it.

    Attributes:
        rounds: of tuning again with what was found; 0: search once and say what was found.
        starts: ascents for each metric.
        iterations: steps of each ascent.
        scouts: samples among whose worst the ascents begin.
        checks: samples besides, which must not beat what the ascents found.
        tolerance: how much worse, as a share, than any scenario tuned on a found one must be to be worth a round.
    """

    rounds: int = number(0, "1", ROUNDS)
    starts: int = number(7, "1", STARTS)
    iterations: int = number(8, "1", MANY)
    scouts: int = number(256, "1", MANY)
    checks: int = number(10_000, "1", SOME)
    tolerance: float = number(5e-3, "1", NONNEGATIVE)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tune:
    """The tuning problem and how to solve it; its step is coarser than that of the validation.

    Attributes:
        gains: the gains to tune: any scalar numbers of the law, "all" of them, or "sensitive", those that pay; without
            it those that the law itself names.
        tied: gains that follow a tuned one, in the ratio that they start with.
        bounds: [low, high] of a gain, narrower than the built-in ones.
        goals: what to minimise: the weighted sum of statistics of metrics, each relative to the starting gains'.
        limits: what statistics of metrics must not exceed; added to the default ones.
        tail: share of the ensemble, its worst, whose mean is the statistic "cvar".
        stability_margin: times what the law's stability conditions ask.
        sample_rate: rate at which the law must be able to run; 0: at the step of tuning.
        penalty: cost of exceeding a limit, for each unit of ratio.
        dt: length of a step of a run while tuning.
        integrator: how a step is made while tuning.
        gradient: "forward" carries the slopes in all gains along, "reverse" goes back through the run; "auto" takes
            the first up to 30 gains.
        optimizer: "sqp", sequential quadratic programming, which needs no settings; "cma", which needs no gradient; or
            an optimiser of optax by its name.
        options: further arguments of the optimiser.
        learning_rate: of an optimiser of optax; it falls to 0 along a cosine.
        iterations: the most iterations of a search.
        patience: a search ends after so many iterations without a better result.
        clip: norm to which a gradient is clipped for optimisers of optax.
        screen: gain sets looked at before the search, which begins at the best of them; 0: none.
        starts: searches, from the best places of the screening that lie apart; the best result is kept.
        spread: the factor, either way, within which gain sets are tried about the configured gains.
        checkpoint_every: iterations between what is kept for --resume.
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
    """Everything a command needs to know.

    Attributes:
        version: of this file format.
        imports: files of Python with classes of one's own, by name, and the SHA-256 of each; a run writes it.
        seed: of every random number.
        precision: bits of a floating-point number.
        controller: the law and its gains, and where it runs in a computer its period.
        scenario: all that the law does not know: vehicle, actuators, path, disturbance, start.
        simulate: steps and length of a run.
        criteria: how runs are judged.
        ensemble: the vehicles to tune on and to validate on.
        tune: what is tuned, for what, and how.
        pareto: of `agvjax pareto`: the front of the goal against one limit.
        speed: of `agvjax speed`: which speeds are tried.
        margins: of `agvjax margins`: where a loop is linearised.
        sweep: of `agvjax sweep`: the scenarios to look at, and what counts as a failure.
        identify: of `agvjax identify`: how a log is read and fitted.
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
