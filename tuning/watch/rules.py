"""What is wrong with a configuration that a log is to be held against."""

from __future__ import annotations

import numpy as np

from agvjax import Fault
from agvjax.leaves import leaves

from ..config.settings import Config
from ..identify import rules
from ..identify.parameters import named, prepared, sinusoidal

WATCHED = ("deadzone.", "actuators.", "plant.")


def faults(config: Config) -> list[Fault]:
    """What is wrong for `identify`, vehicles that are all alike in what is watched, and too few logs."""
    if wrong := rules.faults(config):
        return wrong
    asked = config.watch
    wrong = []
    if not watched(config):
        rule = "a scenario with deadzones, actuators or a vehicle that a log can tell something of"
        wrong.append(Fault("identify.fit", ", ".join(config.identify.fit), rule))
    if (least := int(np.ceil(1 / asked.false_alarms - 1e-9)) - 1) > asked.logs:
        rule = f"at least {least}: fewer cannot raise an alarm that is false for {asked.false_alarms:g} of the logs"
        wrong.append(Fault("watch.logs", asked.logs, rule))
    return wrong


def watched(config: Config) -> tuple[str, ...]:
    """The numbers that may have moved: of those that `identify.fit` asks for the ones that the gains were tuned for.

    And whatever else of the vehicle the ensemble draws. Pushes are not among them: they are the day's.
    """
    settings, there = config.identify, leaves(config.scenario)
    asked = named(prepared(config.scenario, settings.fit, 0.02, settings.memory), settings.fit)
    names = dict.fromkeys([*asked, *config.ensemble.draws])
    numbers = [name for name in names if name in there and not np.ndim(there[name])]
    return tuple(name for name in numbers if name.startswith(WATCHED) and not sinusoidal(name))
