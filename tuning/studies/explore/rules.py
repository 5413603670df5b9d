"""What the page needs of a configuration."""

from __future__ import annotations

import importlib.util

from agvjax import Fault

from ...config.settings import Config
from ...tune import rules

INSTALL = "pip install 'agvjax[explore]'"


def faults(config: Config) -> list[Fault]:
    """What is wrong with a configuration that is explored: it can be tuned, and Bokeh is there to draw it."""
    if importlib.util.find_spec("bokeh") is None:
        return [Fault("explore", "Bokeh is not installed", f"installed: {INSTALL}")]
    return rules.faults(config)
