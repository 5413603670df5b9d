"""Tuning of agvjax controllers by gradient, over ensembles of scenarios; and the `agvjax` command line.

Names are imported when first used, so that `agvjax --help` starts without JAX.
"""

import importlib
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .config.settings import Bound as Bound
    from .config.settings import Config as Config
    from .config.settings import Ensemble as Ensemble
    from .config.settings import Limit as Limit
    from .config.settings import Search as Search
    from .config.settings import Simulate as Simulate
    from .config.settings import Sweep as Sweep
    from .config.settings import Tune as Tune
    from .config.settings import Weights as Weights
    from .ensemble.draws import Between as Between
    from .ensemble.draws import Distribution as Distribution
    from .ensemble.draws import OneOf as OneOf
    from .ensemble.draws import Plus as Plus
    from .ensemble.draws import Span as Span
    from .ensemble.draws import Times as Times
    from .ensemble.draws import default_draws as default_draws
    from .ensemble.draws import sample as sample
    from .ensemble.worst import Adversary as Adversary
    from .sweep.results import Results as Results
    from .sweep.results import load as load
    from .sweep.run import run_sweep as run_sweep
    from .tune.gains import Gains as Gains
    from .tune.methods.objective import Objective as Objective
    from .tune.methods.objective import Requirement as Requirement
    from .tune.methods.objective import within as within
    from .tune.problem import pose as pose
    from .tune.rounds import Outcome as Outcome
    from .tune.rounds import solve as solve
    from .tune.tuner import Progress as Progress
    from .tune.tuner import Tuner as Tuner

_NAMES = {
    "ensemble.draws": ("Between", "Distribution", "OneOf", "Plus", "Span", "Times", "default_draws", "sample"),
    "tune.gains": ("Gains",),
    "tune.methods.objective": ("Objective", "Requirement", "within"),
    "tune.tuner": ("Progress", "Tuner"),
    "tune.problem": ("pose",),
    "config.settings": ("Bound", "Config", "Ensemble", "Limit", "Search", "Simulate", "Sweep", "Tune", "Weights"),
    "tune.rounds": ("Outcome", "solve"),
    "sweep.results": ("Results", "load"),
    "sweep.run": ("run_sweep",),
    "ensemble.worst": ("Adversary",),
}
_HOMES = {name: home for home, names in _NAMES.items() for name in names}


class _Earlier:
    """Finds modules of earlier releases where `agvjax`, which knows them, is not imported yet."""

    def find_spec(self, module: str, path: Any = None, target: Any = None) -> Any:
        """How to import an earlier module; None of any other."""
        if not module.startswith(f"{__name__}."):
            return None
        from agvjax import _moved  # late: it needs JAX

        return _moved.Finder().find_spec(module)


sys.meta_path.append(_Earlier())


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)
    from agvjax import _moved  # late, as above

    return _moved.find(__name__, name)
