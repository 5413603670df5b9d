"""`agvjax vehicles`: the controller on realistic vehicle models."""

from __future__ import annotations

import argparse

from agvjax import Fault, InputError

from .. import config as configuration
from ..config.complete import by_whole_error
from ..config.load import VEHICLES
from ..io import files
from ..tune.rules import faults
from .folders import new_folder
from .prepare import configure, overrides

PARTS = 4


def run(arguments: argparse.Namespace) -> int:
    """Tune for the built-in vehicles and judge; write tables, figures, animation and report."""
    if arguments.config:
        rule = f"left out: this command uses only {', '.join(VEHICLES)}; tune any other with `agvjax tune --config`"
        raise InputError([Fault("--config", name, rule) for name in arguments.config])
    console = configure(arguments, faults)[1]
    settings, imports = overrides(arguments), arguments.imports
    configs = {name: by_whole_error(configuration.load([name], settings, faults, imports=imports)) for name in VEHICLES}
    out = new_folder(arguments.out, arguments.command)
    for name, config in configs.items():
        files.write(out / f"config-{name}.toml", configuration.dump(config))
    from ..studies.vehicles import page, study  # late: the libraries that they import are optional

    with console.parts("tuning and evaluating", PARTS) as tick:
        tables = study.study(configs, tick)
    console.conclude(page.write(tables, out), f"written to {out}; begin with {out}/report.html")
    return 0
