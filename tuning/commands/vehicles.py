"""`agvjax vehicles`: what is left of the controller on vehicles one can meet."""

from __future__ import annotations

import argparse

from tqdm import tqdm

from agvjax import InputError, Problem

from .. import config as configuration
from .. import runs
from ..config import BUILT_IN
from .common import RunFailed, configure, new_folder, overrides, say, ticker

PARTS = 4


def run(arguments: argparse.Namespace) -> int:
    """Tune for the built-in vehicles and judge; write tables, figures, animation and report."""
    if arguments.config:
        rule = f"left out: this command looks at {', '.join(BUILT_IN)}; tune any other with `agvjax tune --config`"
        raise InputError([Problem("--config", name, rule) for name in arguments.config])
    configure(arguments)
    configs = {name: configuration.load([name], overrides(arguments)) for name in BUILT_IN}
    out = new_folder(arguments)
    for name, config in configs.items():
        runs.write(out / f"config-{name}.toml", configuration.dump(config))
    (out / "config.toml").unlink()
    from ..vehicles import page, study  # late: what they import is not there for everyone

    with tqdm(total=PARTS, disable=arguments.quiet, unit="part") as bar:
        try:
            found = study.study(configs, ticker(bar))
        except RuntimeError as error:
            raise RunFailed(str(error)) from error
    say(arguments, page.write(found, out), f"written to {out}; begin with {out}/report.html")
    return 0
