"""What margins need of a configuration."""

from __future__ import annotations

import importlib.util

from agvjax import Fault
from agvjax.linear import instants

from ...config import rules
from ...config.settings import Config

INSTALL = "pip install 'agvjax[margins]'"


def faults(config: Config) -> list[Fault]:
    """What is wrong with a configuration whose margins are looked for."""
    found = rules.faults(config) or rules.timing_faults(config, "tune")
    if found:
        return found
    if importlib.util.find_spec("control") is None:
        return [Fault("margins", "python-control is not installed", f"installed: {INSTALL}")]
    try:
        instants(config.controller, config.timing("tune"), config.criteria.late, config.margins.instants)
    except ValueError as error:
        return [Fault("margins.instants", config.margins.instants, f"fewer, or a longer simulate.horizon: {error}")]
    return []
