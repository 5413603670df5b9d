"""What a comparison of remedies needs of a configuration."""

from __future__ import annotations

import numpy as np

import agvjax
from agvjax import Fault
from agvjax.leaves import spread

from ...config.settings import Config
from ...tune.rules import margin_faults
from .limits import AT_ACTUATORS
from .remedies import core, deadzones, period_of

WHOLE = 1e-6  # of a step, by which a period may be no multiple of it


def faults(config: Config) -> list[Fault]:
    """Nothing to be remedied, remedies in place already, or settings that are not the same for all."""
    law, given, found = core(config), config.controller, []
    if not deadzones(config):
        rule = "a deadzone (slopes and thresholds) of at least one actuator: there is nothing to compensate"
        found.append(Fault("scenario.deadzone", ", ".join(config.scenario.deadzone) or "none", rule))
    if isinstance(given, agvjax.Sampled) and not isinstance(given.compensation, agvjax.NoCompensation):
        rule = "none: each remedy sets its own"
        found.append(Fault("controller.compensation", type(given.compensation).__name__, rule))
    elif isinstance(given, agvjax.Wrapping) and not isinstance(given, agvjax.Sampled):
        rule = "a law by itself, or in a computer (sampled): remedies are put around it"
        found.append(Fault("controller", type(given).__name__, rule))
    if isinstance(law, agvjax.Backstepping) and isinstance(law.Pi_hat, agvjax.readings.KnownSlopes):
        rule = "a number: known slopes are one of the remedies"
        found.append(Fault("controller.Pi_hat", "known slopes", rule))
    return found or _settings(config)


def _settings(config: Config) -> list[Fault]:
    tune, found = config.tune, margin_faults(config.tune)
    own = spread(config.controller, config.controller.gains_to_tune(config.scenario.plant.commands_heading))
    if isinstance(tune.gains, str) or set(tune.gains) != set(own):
        value = tune.gains if isinstance(tune.gains, str) else ", ".join(tune.gains)
        found.append(Fault("tune.gains", value, "left out: each remedy names its own"))
    for key, held in (("tied", tune.tied), ("bounds", tune.bounds)):
        if held:
            found.append(Fault(f"tune.{key}", ", ".join(held), "left out: the gains of remedies differ"))
    if tune.search.rounds:
        found.append(Fault("tune.search.rounds", tune.search.rounds, "0: here no worst scenario is searched for"))
    for name, limit in tune.limits.items():
        if limit.absolute and name in AT_ACTUATORS:
            rule = f"a multiple, not absolute: it is measured at the actuators, as {AT_ACTUATORS[name]}"
            found.append(Fault(f"tune.limits.{name}", "absolute", rule))
    if not isinstance(config.controller, agvjax.Sampled):
        steps = period_of(config) / config.simulate.dt
        if abs(steps - np.round(steps)) > WHOLE:
            rule = f"a whole part of {period_of(config):g} s, the period of the computer of the adaptive inverse"
            found.append(Fault("simulate.dt", config.simulate.dt, rule))
    return found
