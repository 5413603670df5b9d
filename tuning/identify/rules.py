"""What is wrong with a configuration that logs are to be fitted with."""

from __future__ import annotations

import agvjax

from ..config import rules
from ..config.settings import Config
from .log import commands_of
from .parameters import GROUPS, named, prepared, unknown

PERIOD = 0.02  # s, between rows where no log tells it


def faults(config: Config) -> list[agvjax.Fault]:
    """What is wrong with law and scenario, and what of a wish or a plant no log can answer."""
    wrong = rules.faults(config)
    if wrong:
        return wrong
    scenario, fit = prepared(config.scenario, config.identify.fit, PERIOD), config.identify.fit
    rule = f"a group, {', '.join(GROUPS)}, or a number of the scenario's plant, deadzone, actuators or disturbance"
    wrong = [agvjax.Fault("identify.fit", name, rule) for name in unknown(scenario, fit)]
    if config.precision != 64:
        rule = "64: intervals come from matrices too uneven for 32 bits"
        wrong.append(agvjax.Fault("precision", config.precision, rule))
    plant = scenario.plant
    if plant.feedthrough:
        rule = "a vehicle: unicycle, differential_drive, kinematic_single_track, single_track, or one of your own"
        rule += " whose output does not depend on what is delivered at the same instant"
        wrong.append(agvjax.Fault("scenario.plant", type(plant).__name__, rule))
    elif not wrong and not named(scenario, fit):
        rule = f"at least one number: {type(plant).__name__} with inputs {', '.join(commands_of(plant))} has none of it"
        wrong.append(agvjax.Fault("identify.fit", ", ".join(fit), rule))
    return wrong
