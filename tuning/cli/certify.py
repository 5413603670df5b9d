"""`agvjax certify`: a bound on the error that holds in every scenario of a box, proved."""

from __future__ import annotations

import argparse
from functools import partial

from agvjax import Fault, InputError

from ..compute import schedule
from ..compute.jobs import WorkFailed
from ..config.codecs import Toml
from ..studies.certify import certify
from ..studies.certify.page import write
from ..studies.certify.rules import faults, moving
from .axes import axis
from .console import RunFailed, failing
from .folders import new_folder
from .prepare import configure, warn


def run(arguments: argparse.Namespace) -> int:
    """Look for violations, then for a proof; write the certificate, the map and a report."""
    if arguments.scheduler is not None:
        schedule.checked(arguments.scheduler)
    config, console = configure(arguments, faults, _more(arguments), moving)
    out = new_folder(arguments.out, arguments.command, config)
    warn(console, config, "sweep", moving=moving(config))
    console.say("looking for violations of the bounds, then for a proof ...")
    with failing((WorkFailed,)):
        found = certify(config, console.note, partial(schedule.opened, arguments.scheduler, console.note))
    told = write(config, found, out)
    console.conclude(told.text, f"written to {out}; begin with {out}/report.html")
    if told.failure:
        raise RunFailed(told.failure)
    return 0


def _more(arguments: argparse.Namespace) -> dict[str, Toml]:
    """Settings of the options that only this command has."""
    options: dict[str, Toml] = {"within": arguments.within, "within_heading": arguments.within_heading}
    for name, value in options.items():
        if isinstance(value, float) and not value > 0:
            raise InputError([Fault(f"--{name.replace('_', '-')}", value, "> 0")])
    if arguments.over:
        options["over"] = [axis(text) for text in arguments.over]
    return {f"certify.{name}": value for name, value in options.items() if value is not None}
