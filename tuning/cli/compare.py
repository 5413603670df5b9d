"""`agvjax compare`: every law, tuned to one command budget."""

from __future__ import annotations

import argparse

from tqdm import tqdm

from agvjax import InputError

from .. import config as configuration
from ..io import files
from ..studies.laws import page
from ..studies.laws import study as comparing
from ..studies.paper import cases
from ..tune.rules import faults
from .console import RunFailed, say, ticker
from .folders import new_folder
from .prepare import configure


def run(arguments: argparse.Namespace) -> int:
    """Tune every law to one command budget; write table, figure and report."""
    config = configure(arguments, faults)
    found = cases.faults(config.controller, config.scenario)
    if found:
        raise InputError(found)
    out = new_folder(arguments)
    files.write(out / "config.toml", configuration.dump(config))
    with tqdm(total=len(comparing.laws(config.controller)) + 1, disable=arguments.quiet, unit="law") as bar:
        try:
            comparison, tuned = comparing.compare(config, ticker(bar))
        except (RuntimeError, ValueError) as error:
            raise RunFailed(str(error)) from error
    say(arguments, page.write(comparison, tuned, out), f"written to {out}; begin with {out}/report.html")
    return 0
