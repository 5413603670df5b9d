"""What a configuration leaves open, filled in: `None` means what the law and the plant say."""

from __future__ import annotations

import contextlib
import dataclasses
from typing import Any

import numpy as np

import agvjax
from agvjax.metric_table import metrics_of

from ..ensemble.draws import correlated, default_draws
from .settings import SWEPT_METRICS, Config, default_limits, default_over


def complete(config: Config) -> Config:
    """The configuration with gains, limits, draws and axes of its own law and plant where it names none.

    Everything that takes a configuration calls this first, so that Python and TOML mean the same.
    """
    plant, law = config.scenario.plant, config.controller
    tune, ensemble, sweep, known = config.tune, config.ensemble, config.sweep, metrics_of(plant)
    if tune.gains is None:
        tune = dataclasses.replace(tune, gains=tunable(law, getattr(plant, "commands_heading", True)))
    if tune.limits is None:
        limits = {name: limit for name, limit in default_limits().items() if name in known}
        tune = dataclasses.replace(tune, limits=limits)
    if ensemble.draws is None:
        ensemble = dataclasses.replace(ensemble, draws=default_draws(plant.actuators))
    if ensemble.correlation is not None:
        with contextlib.suppress(ValueError):  # what is wrong with it, the rules say
            draws = correlated(ensemble.draws or {}, ensemble.correlation)
            ensemble = dataclasses.replace(ensemble, draws=draws)
    if sweep.metrics is None:
        sweep = dataclasses.replace(sweep, metrics=tuple(name for name in SWEPT_METRICS if name in known))
    if sweep.over is None:
        sweep = dataclasses.replace(sweep, over=default_over(plant.actuators[0]))
    return dataclasses.replace(config, tune=tune, ensemble=ensemble, sweep=sweep)


def tunable(controller: Any, heading: bool = True) -> tuple[str, ...]:
    """The gains to tune by default: those the law names, or every single number of a law that names none.

    Those of the heading only where that can be commanded.
    """
    if hasattr(controller, "tunable"):
        unused = () if heading else getattr(controller, "of_heading", ())
        return tuple(name for name in controller.tunable if name not in unused)
    return tuple(name for name, value in agvjax.leaves(controller).items() if np.ndim(value) == 0)
