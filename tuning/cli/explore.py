"""`agvjax explore`: gains and vehicle moved by hand on a local page."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from ..studies.explore.rules import faults
from ..tune.rules import moving
from .folders import new_folder
from .prepare import configure, warn

if TYPE_CHECKING:
    from bokeh.document import Document


def run(arguments: argparse.Namespace) -> int:
    """Serve the page of the configured problem until interrupted."""
    environment = dict(os.environ)  # before JAX's options join it: a tuning chooses its own
    config, console = configure(arguments, faults, moving=moving)
    from ..studies.explore.background import Desk  # late: Bokeh is an extra
    from ..studies.explore.page import Page
    from ..studies.explore.rollout import Rollouts
    from ..studies.explore.server import serve
    from ..studies.explore.sliders import movable

    given = None if arguments.out is None else new_folder(arguments.out, arguments.command)

    def folder() -> Path:
        return new_folder(None, arguments.command) if given is None else given

    imports = [option for file in arguments.imports for option in ("--import", file)]
    desk = Desk(folder, [sys.executable, "-P", "-m", f"{__package__}", "tune", *imports], environment)
    warn(console, config, "simulate", "tune", moving=moving(config))
    console.say("compiling; the first start takes up to a minute ...")
    rollouts = Rollouts(config, movable(config))
    rollouts.ready()

    def page(document: Document) -> None:
        Page(rollouts, desk, document)

    try:
        serve(page, lambda address: console.say(f"open {address} in a browser; Ctrl-C ends"))
    finally:
        desk.close()
    return 0
