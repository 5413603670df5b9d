"""What a configuration leaves open, filled in: `None` means what the law and the plant say."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Mapping
from typing import TypeVar

import agvjax
from agvjax.leaves import spread
from agvjax.metric_table import metrics_of

from ..ensemble.draws import Usual, correlated, default_draws
from .settings import (
    FOLLOWED_METRICS,
    SWEPT_METRICS,
    WHOLE_ERROR,
    Bound,
    Config,
    Ensemble,
    Sweep,
    Tune,
    default_goals,
    default_limits,
    default_over,
)

Section = TypeVar("Section", Ensemble, Tune, Sweep)


def complete(config: Config) -> Config:
    """The configuration with gains, limits, draws and axes of its own law and scenario where it names none.

    What is drawn and swept by default is what of the paper's problem the scenario has. Everything that takes a
    configuration calls this first, so that Python and TOML mean the same.
    """
    plant, law, leaves = config.scenario.plant, config.controller, agvjax.leaves(config.scenario)
    known, follows = metrics_of(config.scenario), law.follows()
    usual = default_draws(plant.actuators, config.scenario.start, config.scenario.path)
    draws = {name: draw for name, draw in usual.items() if name in leaves}
    axes = ({n: span for n, span in axis.items() if n in leaves} for axis in default_over(plant.actuators[0]))
    ensemble = _filled(config.ensemble, draws=draws)
    if isinstance(ensemble.draws, Mapping):
        draws = {n: usual.get(n, draw) if isinstance(draw, Usual) else draw for n, draw in ensemble.draws.items()}
        ensemble = dataclasses.replace(ensemble, draws=draws)
    if ensemble.correlation is not None:
        with contextlib.suppress(ValueError):  # what is wrong with it, the rules say
            tied = correlated(ensemble.draws, ensemble.correlation)
            ensemble = dataclasses.replace(ensemble, draws=tied)
    goals = default_goals(known, config.simulate.horizon, follows, config.criteria.late)
    limits = default_limits(known, follows)
    tune = _filled(config.tune, gains=law.gains_to_tune(plant.commands_heading), goals=goals, limits=limits)
    if not isinstance(tune.gains, str):
        tune = dataclasses.replace(tune, gains=spread(law, tune.gains or ()))
    wanted = FOLLOWED_METRICS if follows else SWEPT_METRICS
    metrics = tuple(name for name in wanted if name in known)
    fails = {next(iter(goals)): Bound()}  # of a law that follows a route, its distance to it
    sweep = _filled(config.sweep, metrics=metrics, over=tuple(axis for axis in axes if axis), fails=fails)
    return dataclasses.replace(config, tune=tune, ensemble=ensemble, sweep=sweep)


def by_whole_error(config: Config) -> Config:
    """A completed configuration, its goal that of `paper-goal` where it is the default one: studies compare by it."""
    usual = default_goals(metrics_of(config.scenario), config.simulate.horizon, late=config.criteria.late)
    if config.tune.goals != usual:
        return config
    return dataclasses.replace(config, tune=dataclasses.replace(config.tune, goals=dict(WHOLE_ERROR)))


def _filled(section: Section, **defaults: object) -> Section:
    """A section with the default of each field that it leaves open."""
    return dataclasses.replace(section, **{n: x for n, x in defaults.items() if getattr(section, n) is None})
