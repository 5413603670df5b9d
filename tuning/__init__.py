"""Tuning of agvjax controllers by gradient, over ensembles of scenarios; and the `agvjax` command line.

Names are imported when first used, so that `agvjax --help` starts without JAX.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .ensemble import Between as Between
    from .ensemble import Times as Times
    from .ensemble import default_draws as default_draws
    from .ensemble import sample as sample
    from .free import Free as Free
    from .objective import Objective as Objective
    from .optimise import Progress as Progress
    from .optimise import Tuner as Tuner

_HOMES = {"Between": "ensemble", "Times": "ensemble", "default_draws": "ensemble", "sample": "ensemble"}
_HOMES |= {"Free": "free", "Objective": "objective", "Progress": "optimise", "Tuner": "optimise"}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__} has no attribute {name}")
    return getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)
