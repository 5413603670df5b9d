"""What is wrong with a configuration that logs are to be fitted with."""

from __future__ import annotations

import agvjax

from ..config import rules
from ..config.settings import Config, Identify
from .log import commands_of
from .parameters import GROUPS, MOUNTING, named, parts_of, prepared, unknown

PERIOD = 0.02  # s, between rows where no log tells it
ROWS = 4  # of a stretch at least


def faults(config: Config) -> list[agvjax.Fault]:
    """What is wrong with law and scenario, and what of a wish or a plant no log can answer."""
    wrong = rules.faults(config)
    if wrong:
        return wrong
    settings, fit = config.identify, config.identify.fit
    scenario = prepared(config.scenario, fit, PERIOD, settings.memory)
    rule = f"a group, {', '.join(GROUPS)}, or a number of the scenario's plant, deadzone, actuators or disturbance, or"
    rule += f" one of {', '.join(MOUNTING)}"
    wrong = [agvjax.Fault("identify.fit", name, rule) for name in unknown(scenario, fit)]
    wrong += _too_short(settings, scenario)
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


def _too_short(settings: Identify, scenario: agvjax.Scenario) -> list[agvjax.Fault]:
    """A memory that a delay does not fit in, and a drive to be suggested that has no stretch."""
    wrong = []
    for name, chain in scenario.actuators.items():
        late = [part for part in parts_of(chain).values() if isinstance(part, agvjax.Delay)]
        if (longest := max((float(part.time) + float(part.jitter) for part in late), default=0.0)) > settings.memory:
            rule = f"at least the delay that is assumed of scenario.actuators.{name}, {longest:g} s"
            wrong.append(agvjax.Fault("identify.memory", settings.memory, rule))
    if settings.drives and settings.duration < (least := settings.memory + settings.segment):
        rule = f"at least identify.memory and identify.segment together, {least:g} s, unless identify.drives is 0"
        wrong.append(agvjax.Fault("identify.duration", settings.duration, rule))
    if settings.drives and settings.segment < ROWS * PERIOD:
        rule = f"at least {ROWS * PERIOD:g} s, {ROWS} rows of a suggested drive, unless identify.drives is 0"
        wrong.append(agvjax.Fault("identify.segment", settings.segment, rule))
    return wrong
