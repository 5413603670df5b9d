"""Tuning of agvjax controllers by gradient, over ensembles of scenarios; and the `agvjax` command line.

Names are imported when first used, so that `agvjax --help` starts without JAX.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .ensemble import Between as Between
    from .ensemble import Distribution as Distribution
    from .ensemble import OneOf as OneOf
    from .ensemble import Span as Span
    from .ensemble import Times as Times
    from .ensemble import default_draws as default_draws
    from .ensemble import sample as sample
    from .free import Free as Free
    from .objective import Objective as Objective
    from .objective import Requirement as Requirement
    from .objective import within as within
    from .optimise import Progress as Progress
    from .optimise import Tuner as Tuner
    from .problem import pose as pose
    from .rounds import Outcome as Outcome
    from .rounds import solve as solve
    from .settings import Bound as Bound
    from .settings import Config as Config
    from .settings import Ensemble as Ensemble
    from .settings import Limit as Limit
    from .settings import Search as Search
    from .settings import Simulate as Simulate
    from .settings import Sweep as Sweep
    from .settings import Tune as Tune
    from .settings import Weights as Weights
    from .sweep.results import Results as Results
    from .sweep.results import load as load
    from .sweep.work import run_sweep as run_sweep
    from .worst import Adversary as Adversary

_NAMES = {
    "ensemble": ("Between", "Distribution", "OneOf", "Span", "Times", "default_draws", "sample"),
    "free": ("Free",),
    "objective": ("Objective", "Requirement", "within"),
    "optimise": ("Progress", "Tuner"),
    "problem": ("pose",),
    "settings": ("Bound", "Config", "Ensemble", "Limit", "Search", "Simulate", "Sweep", "Tune", "Weights"),
    "rounds": ("Outcome", "solve"),
    "sweep.results": ("Results", "load"),
    "sweep.work": ("run_sweep",),
    "worst": ("Adversary",),
}
_HOMES = {name: home for home, names in _NAMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__} has no attribute {name}")
    return getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)
