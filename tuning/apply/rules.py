"""What is wrong with a configuration that gains are to be compared by."""

from __future__ import annotations

from agvjax import Fault

from ..config.settings import Apply, Config
from ..tune import rules
from .decision import provable


def faults(config: Config) -> list[Fault]:
    """What is wrong with law, scenario, goals and limits, and too few vehicles to show anything."""
    return rules.faults(config) or _few(config.apply)


def _few(asked: Apply) -> list[Fault]:
    if asked.vehicles >= (least := provable(asked.share, asked.confidence)):
        return []
    rule = f"at least {least}: fewer cannot show apply.share = {asked.share:g} with {asked.confidence:g} confidence"
    return [Fault("apply.vehicles", asked.vehicles, rule)]
