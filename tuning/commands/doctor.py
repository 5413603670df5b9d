"""`agvjax doctor`: can the gradients of this problem be trusted?"""

from __future__ import annotations

import argparse
import dataclasses

from .. import config as configuration
from .. import doctor, runs
from ..problem import pose
from ..settings import Search
from .common import RunFailed, configure, new_folder, say, unasked, warn


def run(arguments: argparse.Namespace) -> int:
    """Examine the configured problem at its starting gains; 1 if something is not right."""
    config = configure(arguments)
    unasked(config)
    alone = dataclasses.replace(config.tune, search=Search())  # no places for what a search might add
    posed = pose(dataclasses.replace(config, tune=alone))
    out = new_folder(arguments)
    runs.write(out / "config.toml", configuration.dump(config))
    warn(arguments, config, "tune")
    say(arguments, f"examining {len(posed.tuner.free.names)} gains on {posed.tuner.batch.size} scenarios ...")
    try:
        found = doctor.diagnose(posed.tuner)
    except RuntimeError as error:
        raise RunFailed(str(error)) from error
    text = doctor.page(found)
    runs.write(out / "doctor.md", text + "\n")
    say(arguments, text, f"written to {out}")
    if not found.healthy:
        raise RunFailed(f"something is wrong with this problem: see {out}/doctor.md")
    return 0
