"""Everything that can be set, with its default and its rule."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Sequence
from typing import Any

import numpy as np

import agvjax
from agvjax._pytree import FRACTION, NONNEGATIVE, POSITIVE, Rule, number
from agvjax.simulate import DT, N_STEPS

from .ensemble import Draw, box, default_draws
from .first_order import find_optimizer
from .objective import METRICS, STATISTICS, Objective, Requirement
from .optimise import SEQUENTIAL, Tuner
from .worst import Adversary

VERSION = 1  # of the file format


def _whole(low: int, high: float, most: str) -> Rule:
    return Rule(f"a whole number from {low} to {most}", lambda x: (x >= low) & (x <= high) & (x == np.round(x)))


COUNT = Rule("a whole number >= 1", lambda x: (x >= 1) & (x == np.round(x)))
STARTS, ROUNDS = _whole(1, 1000, "1000"), _whole(0, 100, "100")
MANY, SOME, WHOLE = _whole(1, 1e6, "10^6"), _whole(0, 1e7, "10^7"), _whole(0, 2**53, "2^53")
RATE = Rule("0, or from 10^-3 to 10^6", lambda x: (x == 0) | ((x >= 1e-3) & (x <= 1e6)))
WEIGHT = Rule(">= 0 and at most 10^6", lambda x: (x >= 0) & (x <= 1e6))
FACTOR = Rule("> 1 and at most 10^3", lambda x: (x > 1) & (x <= 1e3))
MOST_STEPS = 1e8
LEAST_LIMIT = 1e-9
_GOAL = Objective()  # the defaults of the tuning problem live there, those of its solution in Tuner and Adversary
CHOICES = {"simulate.integrator": tuple(agvjax.INTEGRATORS), "tune.integrator": tuple(agvjax.INTEGRATORS)}
CHOICES |= {"tune.gradient": ("auto", "forward", "reverse"), "pareto.metric": tuple(METRICS)}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Simulate:
    """How `agvjax simulate` steps, and how validation does."""

    dt: float = number(DT, "s", POSITIVE, "reading R10")
    horizon: float = number(DT * N_STEPS, "s", POSITIVE, "reading R10")
    integrator: str = "rk4"
    save_every: int = number(1, "steps", COUNT)
    control_every: int = number(1, "steps", COUNT)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Ensemble:
    """The scenarios to tune on and to validate on."""

    size: int = number(64, "1", MANY)
    validation_size: int = number(256, "1", MANY)
    fresh: bool = False  # tune on scenarios drawn anew every iteration; judge, and rank, on a fixed set all the same
    draws: dict[str, Draw] = dataclasses.field(default_factory=default_draws)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Weights:
    """How much the statistics of a metric, each relative to the starting gains', weigh in the goal."""

    mean: float = number(0.0, "1", WEIGHT)
    worst: float = number(0.0, "1", WEIGHT)
    cvar: float = number(0.0, "1", WEIGHT)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Limit:
    """What the statistics of a metric must not exceed, in multiples of the starting gains' or absolute."""

    mean: float = np.inf
    worst: float = np.inf
    cvar: float = np.inf
    absolute: bool = False


def default_goals() -> dict[str, Weights]:
    """The default problem's."""
    return {name: Weights(**asked) for name, asked in _by_metric(_GOAL.goals).items()}


def default_limits() -> dict[str, Limit]:
    """The default problem's."""
    return {name: Limit(**asked) for name, asked in _by_metric(_GOAL.limits).items()}


def _by_metric(requirements: Sequence[Requirement]) -> dict[str, dict[str, Any]]:
    asked: dict[str, dict[str, Any]] = {}
    for r in requirements:
        asked.setdefault(r.metric, {})[r.statistic] = r.value
    return asked


@dataclasses.dataclass(frozen=True, kw_only=True)
class Search:
    """The search for the worst scenario, after tuning and between the rounds of it."""

    rounds: int = number(0, "1", ROUNDS)  # of tuning again with what was found; 0: search once and say what was found
    starts: int = number(Adversary.starts, "per metric", STARTS)
    iterations: int = number(Adversary.iterations, "1", MANY)
    scouts: int = number(Adversary.scouts, "samples to start from", MANY)
    checks: int = number(Adversary.checks, "samples besides", SOME)
    tolerance: float = number(5e-3, "1", NONNEGATIVE)  # a scenario this much worse than any tuned on is worth a round


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tune:
    """The tuning problem and how to solve it; its step is coarser than that of the validation."""

    gains: tuple[str, ...] = ()  # none: those that the law itself names
    tied: dict[str, str] = dataclasses.field(default_factory=dict)
    bounds: dict[str, tuple[float, float]] = dataclasses.field(default_factory=dict)
    choices: dict[str, list[Any]] = dataclasses.field(default_factory=dict)
    goals: dict[str, Weights] = dataclasses.field(default_factory=default_goals)
    limits: dict[str, Limit] = dataclasses.field(default_factory=default_limits)
    tail: float = number(_GOAL.tail, "share of the ensemble", FRACTION)
    stability_margin: float = number(1.0, "times what the stability conditions ask", POSITIVE)
    sample_rate: float = number(0.0, "Hz, 0 for 1 / dt", RATE)
    penalty: float = number(_GOAL.penalty, "1", NONNEGATIVE)
    dt: float = number(Tuner.dt, "s", POSITIVE)
    integrator: str = "rk4"
    gradient: str = Tuner.gradient
    optimizer: str = Tuner.optimizer
    options: dict[str, Any] = dataclasses.field(default_factory=dict)
    learning_rate: float = number(Tuner.learning_rate, "1", POSITIVE)
    iterations: int = number(Tuner.iterations, "1", COUNT)
    patience: int = number(Tuner.patience, "iterations", COUNT)
    clip: float = number(Tuner.clip, "norm of the gradient", POSITIVE)
    starts: int = number(1, "1", STARTS)
    spread: float = number(3.0, "times, either way", FACTOR)  # of the gains of further starts about the configured
    checkpoint_every: int = number(10, "iterations", COUNT)
    search: Search = Search()


@dataclasses.dataclass(frozen=True, kw_only=True)
class Pareto:
    """The front of the goal against one limit, in multiples of the starting gains'."""

    metric: str = "effort"
    low: float = number(0.8, "times", POSITIVE)
    high: float = number(1.5, "times", POSITIVE)
    points: int = number(8, "1", STARTS)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Config:
    """Everything a command needs to know."""

    version: int = VERSION
    seed: int = number(0, "1", WHOLE)
    precision: int = 64
    controller: Any = agvjax.NeuroBackstepping()
    scenario: Any = dataclasses.field(default_factory=agvjax.Scenario)
    simulate: Simulate = Simulate()
    ensemble: Ensemble = dataclasses.field(default_factory=Ensemble)
    tune: Tune = dataclasses.field(default_factory=Tune)
    pareto: Pareto = Pareto()


def steps_of(horizon: float, dt: float) -> int:
    """Number of steps."""
    return round(horizon / dt)


def problems(config: Config, command: str) -> list[agvjax.Problem]:
    """What can only be said of the whole; what only ensembles and tuning need is not asked for "simulate"."""
    found = agvjax.problems(config)
    if config.precision not in (32, 64):
        found.append(agvjax.Problem("precision", config.precision, "32 or 64"))
    if isinstance(config.scenario.heading, agvjax.Bearing) and not hasattr(config.scenario.path, "bearing"):
        rule = "tangent or a raw bearing: this path has no smooth bearing"
        found.append(agvjax.Problem("scenario.heading", "bearing", rule, "reading R8"))
    if not found:
        found += _timing(config, "simulate", config.simulate)
    if command != "simulate":
        found += _names(config)
        if not found:
            found += _timing(config, "tune", config.tune) + _boxes(config)
    return list({str(problem): problem for problem in found}.values())


def _timing(config: Config, label: str, section: Any) -> list[agvjax.Problem]:
    horizon, dt = config.simulate.horizon, section.dt
    found = agvjax.step_problems(config.controller, dt, horizon, agvjax.INTEGRATORS[section.integrator])
    if found:
        return [p._replace(key="simulate.horizon" if p.key == "horizon" else f"{label}.dt") for p in found]
    count = horizon / dt
    if count > MOST_STEPS:
        return [
            agvjax.Problem(f"{label}.dt", dt, f"at least {horizon / MOST_STEPS:.3g} s: at most {MOST_STEPS:.0g} steps")
        ]
    if abs(count - round(count)) > 1e-6 * count:
        return [agvjax.Problem(f"{label}.dt", dt, f"a whole fraction of the horizon, {horizon:g} s")]
    if label == "simulate" and round(count) % config.simulate.save_every:
        rule = f"a divisor of the number of steps, {round(count)}"
        return [agvjax.Problem("simulate.save_every", config.simulate.save_every, rule)]
    return []


def _names(config: Config) -> list[agvjax.Problem]:
    """Names in the tuning problem that name nothing, and limits that limit nothing."""
    tune, found = config.tune, []
    gains, leaves = agvjax.leaves(config.controller), agvjax.leaves(config.scenario)
    for name in tune.gains:
        if name not in gains:
            found.append(agvjax.Problem("tune.gains", name, f"leaves of the controller: {', '.join(gains)}"))
    if not tune.gains:
        rule = "names of gains: this law names none to tune by gradient; tune the law inside it"
        found.append(agvjax.Problem("tune.gains", [], rule))
    if len(set(tune.gains)) < len(tune.gains):
        found.append(agvjax.Problem("tune.gains", list(tune.gains), "names that differ"))
    for name, pair in tune.bounds.items():
        if name not in tune.gains:
            found.append(agvjax.Problem(f"tune.bounds.{name}", list(pair), "of a tuned gain, one of tune.gains"))
    found += _tied(tune, gains) + _requirements(tune)
    for name in config.ensemble.draws:
        if name not in leaves:
            near = difflib.get_close_matches(name, leaves, 1, 0.5)
            hint = f"; did you mean {near[0]}?" if near else f": {', '.join(leaves)}"
            found.append(agvjax.Problem("ensemble.draws", name, f"a leaf of the scenario{hint}"))
    if not config.ensemble.draws:
        found.append(agvjax.Problem("ensemble.draws", "{}", "at least one leaf of the scenario"))
    if tune.search.scouts < tune.search.starts:
        rule = f"at least tune.search.starts, {tune.search.starts}"
        found.append(agvjax.Problem("tune.search.scouts", tune.search.scouts, rule))
    if config.pareto.low > config.pareto.high:
        found.append(agvjax.Problem("pareto.low", config.pareto.low, f"at most pareto.high, {config.pareto.high:g}"))
    if config.ensemble.fresh and tune.search.rounds:
        found.append(agvjax.Problem("tune.search.rounds", tune.search.rounds, "0 where ensemble.fresh is true"))
    for name in tune.choices:
        if not name.startswith("controller"):
            found.append(agvjax.Problem(f"tune.choices.{name}", tune.choices[name], "of a key of the controller"))
    if tune.choices and tune.search.rounds:
        found.append(agvjax.Problem("tune.search.rounds", tune.search.rounds, "0 where tune.choices are given"))
    if tune.optimizer == SEQUENTIAL:
        if tune.gradient == "reverse":
            found.append(
                agvjax.Problem("tune.gradient", tune.gradient, f"forward: {SEQUENTIAL} needs the whole Jacobian")
            )
        if tune.options:
            found.append(agvjax.Problem("tune.options", dict(tune.options), f"empty: {SEQUENTIAL} has none"))
        if config.ensemble.fresh:
            rule = f"false: {SEQUENTIAL} needs the same scenarios every iteration; an optimiser of optax does not"
            found.append(agvjax.Problem("ensemble.fresh", "true", rule))
        return found
    try:
        find_optimizer(tune.optimizer)(1.0, **tune.options)
    except Exception as error:  # optax and its optimisers raise whatever they meet
        rule = f"{SEQUENTIAL}, or an optimiser of optax that takes a learning rate, and options it knows ({error})"
        found.append(agvjax.Problem("tune.optimizer", tune.optimizer, rule))
    return found


def _tied(tune: Tune, gains: Any) -> list[agvjax.Problem]:
    """Gains tied to what is not tuned, or tuned themselves."""
    found = []
    for name, which in tune.tied.items():
        if name not in gains or name in tune.gains or np.ndim(gains.get(name, 0.0)):
            found.append(agvjax.Problem(f"tune.tied.{name}", which, "under a single gain of the law that is not tuned"))
        elif which not in tune.gains or not float(gains[which]) > 0 or not float(gains[name]) > 0:
            rule = "the name of a tuned gain, both > 0: the ratio they start with is kept"
            found.append(agvjax.Problem(f"tune.tied.{name}", which, rule))
    return found


def _requirements(tune: Tune) -> list[agvjax.Problem]:
    """Goals that ask nothing, and limits that nothing can keep."""
    found = []
    if not any(weight != 0 for weights in tune.goals.values() for weight in vars(weights).values()):
        found.append(agvjax.Problem("tune.goals", "{}", "at least one statistic of a metric with a weight > 0"))
    asked = [*tune.goals.values(), *(limit for limit in tune.limits.values() if np.isfinite(limit.worst))]
    if tune.search.rounds and not any(part.worst for part in asked):
        rule = "0 where no goal and no limit is on a worst: what a round adds counts there"
        found.append(agvjax.Problem("tune.search.rounds", tune.search.rounds, rule))
    for name, limit in tune.limits.items():
        bad = {s: getattr(limit, s) for s in STATISTICS if not getattr(limit, s) >= LEAST_LIMIT}
        for statistic, value in bad.items():
            key = f"tune.limits.{name}" + ("" if len(bad) > 1 and len(set(bad.values())) == 1 else f".{statistic}")
            rule = f">= {LEAST_LIMIT:g}, a ratio to the starting gains or with absolute = true the value; inf for none"
            found.append(agvjax.Problem(key, value, rule))
    return found


def _boxes(config: Config) -> list[agvjax.Problem]:
    """Draws that can draw what their leaf may not hold, and gains that are no single number."""
    found, scenario = [], config.scenario
    for name, draw in config.ensemble.draws.items():
        for end in box(draw, np.asarray(agvjax.leaves(scenario)[name], float)):
            bad = agvjax.problems(agvjax.replace(scenario, {name: end}))
            found += [p._replace(key=f"ensemble.draws.{p.key}") for p in bad if p.key == name]
    for name in config.tune.gains:
        if np.ndim(agvjax.leaves(config.controller)[name]):
            found.append(agvjax.Problem("tune.gains", name, "a single number"))
    return found
