"""`agvjax speed`: how fast a vehicle may go on its route."""

from __future__ import annotations

import argparse

from agvjax import Fault, InputError

from ..io.kept import Kept
from ..studies.speed import page
from ..studies.speed.rules import faults
from ..studies.speed.study import Study, long_enough, search
from ..studies.speed.tried import Tried
from ..tune.rules import moving
from .console import RunFailed
from .folders import begin
from .prepare import configure, warn


def run(arguments: argparse.Namespace) -> int:
    """Tune at one speed after another; write the curve, the place that binds, and the fastest configuration."""
    if arguments.within is not None and not arguments.within > 0:
        raise InputError([Fault("--within", arguments.within, "> 0 m; left out: within the route's corridor")])
    within = None if arguments.within is None else {"speed.within": arguments.within}
    given, console = configure(arguments, faults, within, moving)
    config = long_enough(given)
    out = begin(arguments, config)
    kept = Kept(out / "speeds", Tried)
    warn(console, config, "tune", "simulate", moving=moving(config))
    if config.simulate.horizon > given.simulate.horizon:
        text = f"runs are {config.simulate.horizon:g} s long (simulate.horizon = {given.simulate.horizon:g})"
        console.note(f"{text}, so that the slowest speed covers the whole route")
    console.say("tuning at one speed after another; the first start takes minutes to compile")
    study, settings = Study(config), config.speed
    with console.parts("tuning", settings.points + settings.halvings, "speeds", (RuntimeError,)) as tick:
        tried = search(study, kept, lambda factor: tick(f"x {factor:.3g}"))
        told = page.write(study, tried, out)
    console.conclude(told.text, f"written to {out}; begin with {out}/report.html")
    if told.failure:
        raise RunFailed(told.failure)
    return 0
