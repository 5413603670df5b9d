"""`agvjax compare`: every law, tuned to one command budget."""

from __future__ import annotations

import argparse

from tqdm import tqdm

from agvjax import InputError

from .. import compare as comparing
from .. import config as configuration
from .. import runs
from .common import RunFailed, configure, new_folder, say, ticker


def run(arguments: argparse.Namespace) -> int:
    """Tune every law to one command budget; write table, figure and report."""
    config = configure(arguments)
    found = comparing.problems(config.controller, config.scenario)
    if found:
        raise InputError(found)
    out = new_folder(arguments)
    runs.write(out / "config.toml", configuration.dump(config))
    with tqdm(total=len(comparing.laws(config.controller)) + 1, disable=arguments.quiet, unit="law") as bar:
        try:
            comparison, tuned = comparing.compare(config, ticker(bar))
        except (RuntimeError, ValueError) as error:
            raise RunFailed(str(error)) from error
    say(arguments, comparing.write(comparison, tuned, out), f"written to {out}; begin with {out}/report.html")
    return 0
