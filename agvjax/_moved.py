"""Names of earlier releases, and where each is today: they go on working, with a DeprecationWarning."""

from __future__ import annotations

import importlib
import importlib.util
import sys
import warnings
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

HOMES = {  # of an earlier module, what holds its names today; of a package, what the package itself no longer names
    "agvjax": ("agvjax.readings",),
    "agvjax.actuators": ("agvjax.actuators.chain", "agvjax.actuators.elements"),
    "agvjax.angle": ("agvjax.geometry",),
    "agvjax.animate": ("agvjax.draw.animate",),
    "agvjax.bounds": ("tuning.studies.paper.bounds",),
    "agvjax.deadzone": ("agvjax.actuators.deadzone",),
    "agvjax.elementary": ("agvjax.engine.elementary",),
    "agvjax.loop": ("agvjax.engine.loop",),
    "agvjax.lyapunov": ("tuning.studies.paper.proof",),
    "agvjax.path": ("agvjax.paths.shapes", "agvjax.paths.heading"),
    "agvjax.plants": ("agvjax.messages", "agvjax.geometry"),
    "agvjax.plants.protocol": ("agvjax.messages", "agvjax.geometry"),
    "agvjax.plot": ("agvjax.draw.plot",),
    "agvjax.rbf": ("agvjax.controllers.network",),
    "agvjax.scalarise": ("agvjax.engine.scalarise",),
    "agvjax.waypoints": ("agvjax.paths.waypoints",),
    "agvjax.xla": ("agvjax.engine.xla",),
    "tuning.analysis": ("tuning.tune.analysis",),
    "tuning.classes": ("tuning.config.names",),
    "tuning.commands": ("tuning.cli",),
    "tuning.commands.common": ("tuning.cli.prepare", "tuning.cli.console", "tuning.cli.folders"),
    "tuning.compare": ("tuning.studies.laws.study", "tuning.studies.laws.page"),
    "tuning.config": ("tuning.config.load", "tuning.config.write"),
    "tuning.distributed": ("tuning.compute.processes",),
    "tuning.doctor": ("tuning.tune.doctor",),
    "tuning.ensemble": ("tuning.ensemble.draws",),
    "tuning.export.numpy_file": ("tuning.export.numpy",),
    "tuning.first_order": ("tuning.tune.methods.optax",),
    "tuning.free": ("tuning.tune.gains",),
    "tuning.markdown": ("tuning.io.pages",),
    "tuning.objective": ("tuning.tune.methods.objective", "agvjax.metric_table"),
    "tuning.optimise": ("tuning.tune.tuner",),
    "tuning.paper": ("tuning.studies.paper",),
    "tuning.pareto": ("tuning.tune.pareto",),
    "tuning.problem": ("tuning.tune.problem",),
    "tuning.reader": ("tuning.config.read",),
    "tuning.recordings": ("tuning.config.recipes", "tuning.io.csv_file"),
    "tuning.report": ("tuning.tune.page", "tuning.tune.judge", "tuning.tune.figures"),
    "tuning.rounds": ("tuning.tune.rounds",),
    "tuning.rules": ("tuning.config.rules", "tuning.tune.rules", "tuning.sweep.rules"),
    "tuning.runs": ("tuning.tune.checkpoint", "tuning.io.files"),
    "tuning.settings": ("tuning.config.settings",),
    "tuning.sqp": ("tuning.tune.methods.sqp",),
    "tuning.startup": ("tuning.compute.compiled",),
    "tuning.vehicles": ("tuning.studies.vehicles",),
    "tuning.worst": ("tuning.ensemble.worst",),
}
RENAMED = {
    "tuning.Free": "tuning.tune.gains.Gains",
    "tuning.free.Free": "tuning.tune.gains.Gains",
    "tuning.problem.Posed": "tuning.tune.problem.TuningProblem",
    "agvjax.Problem": "agvjax.Fault",
    "agvjax.problems": "agvjax.faults",
    "agvjax.step_problems": "agvjax.step_faults",
    "agvjax.path_problems": "agvjax.path_warnings",
}


def homes(module: str) -> tuple[str, ...]:
    """What holds the names of an earlier module today, empty of what never was one."""
    package, _, name = module.rpartition(".")
    if module in HOMES or package not in ("tuning.paper", "tuning.vehicles", "tuning.commands"):
        return HOMES.get(module, ())
    home = f"{HOMES[package][0]}.{name}"
    return (home,) if importlib.util.find_spec(home) else ()


def find(module: str, name: str) -> object:
    """What a name of an earlier module is today; its home is imported only now.

    Raises:
        AttributeError: there is and was no such name.
    """
    old = f"{module}.{name}"
    if old in HOMES or importlib.util.find_spec(old):  # a module, not imported yet
        return importlib.import_module(old)
    if old in RENAMED:
        places = [RENAMED[old].rpartition(".")[::2]]
    else:
        places = [(home, name) for home in homes(module) if not name.startswith("_")]
    for home, today in places:
        found = vars(importlib.import_module(home))
        if today in found:
            warnings.warn(f"{old} is now {home}.{today}", DeprecationWarning, stacklevel=3)
            return found[today]
    raise AttributeError(f"module {module} has no attribute {name}")


class Finder(MetaPathFinder, Loader):
    """Finds modules of earlier releases, after all others have been asked."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """How to import an earlier module; None of any other."""
        return ModuleSpec(fullname, self, is_package=True) if homes(fullname) else None

    def create_module(self, spec: ModuleSpec) -> None:
        """An ordinary module."""

    def exec_module(self, module: ModuleType) -> None:
        """Each of its names is looked for when it is used."""
        vars(module)["__getattr__"] = lambda name: find(module.__name__, name)


sys.meta_path.append(Finder())
