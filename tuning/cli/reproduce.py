"""`agvjax reproduce`: the paper, rebuilt."""

from __future__ import annotations

import argparse

from tqdm import tqdm

from agvjax import InputError

from .. import config as configuration
from ..io import files
from ..studies.paper import reproduce as paper
from ..tune.rules import faults
from .console import RunFailed, say, ticker
from .folders import new_folder
from .prepare import configure


def run(arguments: argparse.Namespace) -> int:
    """Rebuild the paper; write figures, tables, report."""
    config = configure(arguments, faults)
    found = paper.faults(config)
    if found:
        raise InputError(found)
    out = new_folder(arguments)
    files.write(out / "config.toml", configuration.dump(config))
    given = [f"--config {name}" for name in arguments.config] + [f"--set {text}" for text in arguments.set]
    command = " ".join(["agvjax reproduce", *given])
    with tqdm(total=paper.steps(config), disable=arguments.quiet, unit="part") as bar:
        progress = ticker(bar)
        try:
            made = paper.Reproduction(config, progress)
        except RuntimeError as error:
            raise RunFailed(str(error)) from error
        paper.write(made, out, command, arguments.pdf, progress)
    say(
        arguments,
        paper.page.summary(made),
        f"report, tables and figures written to {out}; begin with {out}/report.html",
    )
    return 0
