"""`agvjax compare`: every law, tuned to one command budget."""

from __future__ import annotations

import argparse
from pathlib import Path

from agvjax import InputError

from ..config import Config
from ..config.complete import by_whole_error
from ..io.kept import Kept
from ..studies.laws import followers, followers_page, page, study
from ..studies.paper import cases
from ..studies.remedies import page as remedies_page
from ..studies.remedies import rules as remedies_rules
from ..studies.remedies import study as remedies_study
from ..tune.rules import faults, moving
from .console import Console, failing
from .folders import begin
from .prepare import configure


def run(arguments: argparse.Namespace) -> int:
    """Tune every law to one command budget; write table, figure and report.

    Of a configuration whose law follows a route these are the laws that drive a base, of any other those of the paper;
    with `--deadzone` the configured law with each remedy against a deadzone.
    """
    config, console = configure(arguments, faults, moving=moving)
    routed = config.controller.follows()
    config = config if routed else by_whole_error(config)
    if arguments.deadzone:
        return _remedies(arguments, console, config)
    if bad := followers.faults(config) if routed else cases.faults(config.controller, config.scenario):
        raise InputError(bad)
    out = begin(arguments, config)
    text = _followers(console, config, out) if routed else _papers(console, config, out)
    console.conclude(text, f"written to {out}; begin with {out}/report.html")
    return 0


def _papers(console: Console, config: Config, out: Path) -> str:
    kept = Kept(out / "laws", study.Searched)
    with console.parts("tuning", len(study.laws(config.controller)) + 1, "laws", (RuntimeError, ValueError)) as tick:
        comparison, tuned = study.compare(config, kept, tick)
    return page.write(comparison, tuned, out)


def _followers(console: Console, config: Config, out: Path) -> str:
    kept = Kept(out / "laws", followers.Searched)
    with console.parts("tuning", len(followers.laws(config)) + 1, "laws", (RuntimeError, ValueError)) as tick:
        comparison, tuned = followers.compare(config, kept, tick)
    return followers_page.write(comparison, tuned, out)


def _remedies(arguments: argparse.Namespace, console: Console, config: Config) -> int:
    if bad := remedies_rules.faults(config):
        raise InputError(bad)
    with failing((RuntimeError, ValueError)):
        asked = remedies_study.Study(config)
        count = len(asked.remedies.found)
    out = begin(arguments, config)
    kept = Kept(out / "remedies", followers.Searched)
    with console.parts("tuning", count + 2, "remedies", (RuntimeError, ValueError)) as tick:
        tuned, wrong = remedies_study.compare(asked, kept, tick)
    text = remedies_page.write(asked, tuned, wrong, out)
    console.conclude(text, f"written to {out}; begin with {out}/report.html")
    return 0
