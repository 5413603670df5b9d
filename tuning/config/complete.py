"""What a configuration leaves open, filled in: `None` means what the law and the plant say."""

from __future__ import annotations

import contextlib
import dataclasses

import agvjax
from agvjax.metric_table import metrics_of

from ..ensemble.draws import correlated, default_draws
from .settings import SWEPT_METRICS, Config, default_limits, default_over


def complete(config: Config) -> Config:
    """The configuration with gains, limits, draws and axes of its own law and scenario where it names none.

    What is drawn and swept by default is what of the paper's problem the scenario has. Everything that takes a
    configuration calls this first, so that Python and TOML mean the same.
    """
    plant, law, leaves = config.scenario.plant, config.controller, agvjax.leaves(config.scenario)
    tune, ensemble, sweep, known = config.tune, config.ensemble, config.sweep, metrics_of(plant)
    if tune.gains is None:
        tune = dataclasses.replace(tune, gains=law.gains_to_tune(plant.commands_heading))
    if tune.limits is None:
        tune = dataclasses.replace(tune, limits=default_limits(known))
    if ensemble.draws is None:
        draws = {name: draw for name, draw in default_draws(plant.actuators).items() if name in leaves}
        ensemble = dataclasses.replace(ensemble, draws=draws)
    if ensemble.correlation is not None:
        with contextlib.suppress(ValueError):  # what is wrong with it, the rules say
            draws = correlated(ensemble.draws or {}, ensemble.correlation)
            ensemble = dataclasses.replace(ensemble, draws=draws)
    if sweep.metrics is None:
        sweep = dataclasses.replace(sweep, metrics=tuple(name for name in SWEPT_METRICS if name in known))
    if sweep.over is None:
        axes = ({n: span for n, span in axis.items() if n in leaves} for axis in default_over(plant.actuators[0]))
        sweep = dataclasses.replace(sweep, over=tuple(axis for axis in axes if axis))
    return dataclasses.replace(config, tune=tune, ensemble=ensemble, sweep=sweep)
