"""`agvjax doctor`: can the gradients of this problem be trusted?"""

from __future__ import annotations

import argparse
import dataclasses

from .. import config as configuration
from ..config.settings import Search
from ..io import files
from ..tune import doctor
from ..tune.problem import pose
from ..tune.rules import faults
from .console import RunFailed, say
from .folders import new_folder
from .prepare import configure, unasked, warn


def run(arguments: argparse.Namespace) -> int:
    """Examine the configured problem at its starting gains; 1 if something is not right."""
    config = configure(arguments, faults)
    unasked(config)
    alone = dataclasses.replace(config.tune, search=Search())  # no places for what a search might add
    posed = pose(dataclasses.replace(config, tune=alone))
    out = new_folder(arguments)
    files.write(out / "config.toml", configuration.dump(config))
    warn(arguments, config, "tune")
    say(arguments, f"examining {len(posed.tuner.free.names)} gains on {posed.tuner.batch.size} scenarios ...")
    try:
        found = doctor.diagnose(posed.tuner)
    except RuntimeError as error:
        raise RunFailed(str(error)) from error
    text = doctor.page(found)
    files.write(out / "doctor.md", text + "\n")
    say(arguments, text, f"written to {out}")
    if not found.healthy:
        raise RunFailed(f"something is wrong with this problem: see {out}/doctor.md")
    return 0
