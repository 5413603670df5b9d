"""Everything that can be set, with its default and its rule."""

from __future__ import annotations

import dataclasses
import difflib
from typing import Any

import numpy as np

import agvjax
from agvjax._pytree import NONNEGATIVE, POSITIVE, Rule, number

from .ensemble import Draw, default_draws
from .objective import METRICS
from .optimise import find_optimizer

VERSION = 1  # of the file format
COUNT = Rule("a whole number >= 1", lambda x: (x >= 1) & (x == np.round(x)))
WHOLE = Rule("a whole number >= 0", lambda x: (x >= 0) & (x == np.round(x)))
CHOICES = {"simulate.integrator": tuple(agvjax.INTEGRATORS), "tune.integrator": tuple(agvjax.INTEGRATORS)}
CHOICES |= {"tune.gradient": ("forward", "reverse"), "tune.goal.metric": tuple(METRICS)}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Simulate:
    """How `agvjax simulate` steps, and how validation does."""

    dt: float = number(1e-3, "s", POSITIVE, "reading R10")
    horizon: float = number(12.0, "s", POSITIVE, "reading R10")
    integrator: str = "rk4"
    save_every: int = number(1, "steps", COUNT)
    control_every: int = number(1, "steps", COUNT)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Ensemble:
    """The scenarios to tune on and to validate on."""

    size: int = number(64, "1", COUNT)
    validation_size: int = number(256, "1", COUNT)
    draws: dict[str, Draw] = dataclasses.field(default_factory=default_draws)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Goal:
    """Minimise the mean and the worst of a metric, each relative to the starting gains'."""

    metric: str = "rmse"
    mean: float = number(1.0, "1", NONNEGATIVE)
    worst: float = number(0.3, "1", NONNEGATIVE)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tune:
    """The tuning problem and how to solve it; its step is coarser than that of the validation."""

    gains: tuple[str, ...] = ("k1", "k2", "k3", "Lam", "Lam_psi", "omega_n", "zeta")
    bounds: dict[str, tuple[float, float]] = dataclasses.field(default_factory=dict)
    goal: Goal = Goal()
    limits: dict[str, float] = dataclasses.field(
        default_factory=lambda: {"effort": 1.0, "peak_position": 1.0, "peak_heading": 1.0}
    )
    penalty: float = number(3.0, "1", NONNEGATIVE)
    dt: float = number(5e-3, "s", POSITIVE)
    integrator: str = "rk4"
    gradient: str = "forward"
    optimizer: str = "adam"
    options: dict[str, Any] = dataclasses.field(default_factory=dict)
    learning_rate: float = number(0.1, "1", POSITIVE)
    iterations: int = number(300, "1", COUNT)
    patience: int = number(100, "iterations", COUNT)
    clip: float = number(10.0, "norm of the gradient", POSITIVE)
    checkpoint_every: int = number(10, "iterations", COUNT)


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


def steps_of(horizon: float, dt: float) -> int:
    """Number of steps."""
    return round(horizon / dt)


def problems(config: Config) -> list[agvjax.Problem]:
    """What can only be said of the whole."""
    found = agvjax.problems(config)
    if config.precision not in (32, 64):
        found.append(agvjax.Problem("precision", config.precision, "32 or 64"))
    known = agvjax.leaves(config.controller)
    for name in (*config.tune.gains, *config.tune.bounds):
        if name not in known:
            found.append(agvjax.Problem("tune.gains", name, f"leaves of the controller: {', '.join(known)}"))
    leaves = agvjax.leaves(config.scenario)
    for name in config.ensemble.draws:
        if name not in leaves:
            near = difflib.get_close_matches(name, leaves, 1, 0.5)
            hint = f"; did you mean {near[0]}?" if near else f": {', '.join(leaves)}"
            found.append(agvjax.Problem("ensemble.draws", name, f"a leaf of the scenario{hint}"))
    try:
        find_optimizer(config.tune.optimizer)(1.0, **config.tune.options)
    except (KeyError, TypeError) as error:
        rule = f"an optimiser of optax that takes a learning rate, and options that it knows ({error})"
        found.append(agvjax.Problem("tune.optimizer", config.tune.optimizer, rule))
    for name, limit in config.tune.limits.items():
        if not (np.isfinite(limit) and limit > 0):
            found.append(agvjax.Problem(f"tune.limits.{name}", limit, "finite and > 0, a ratio to the starting gains"))
    if not found:
        for section, label in ((config.simulate, "simulate"), (config.tune, "tune")):
            method = agvjax.INTEGRATORS[section.integrator]
            steps = agvjax.step_problems(config.controller, section.dt, config.simulate.horizon, method)
            found += [p._replace(key=f"{'simulate' if p.key == 'horizon' else label}.{p.key}") for p in steps]
            count = config.simulate.horizon / section.dt
            if not steps and abs(count - round(count)) > 1e-6 * count:
                rule = f"a whole fraction of the horizon, {config.simulate.horizon:g} s"
                found.append(agvjax.Problem(f"{label}.dt", section.dt, rule))
        if not found and steps_of(config.simulate.horizon, config.simulate.dt) % config.simulate.save_every:
            found.append(
                agvjax.Problem("simulate.save_every", config.simulate.save_every, "a divisor of the number of steps")
            )
    return list(dict.fromkeys(found))
