"""`agvjax doctor`: can the gradients of this problem be trusted?"""

from __future__ import annotations

import argparse
import dataclasses

from ..config.settings import Search
from ..io import files
from ..tune import doctor
from ..tune.problem import pose
from ..tune.rules import faults, moving
from .console import RunFailed, failing
from .folders import new_folder
from .prepare import configure, warn


def run(arguments: argparse.Namespace) -> int:
    """Examine the configured problem at its starting gains; 1 if something is not right."""
    config, console = configure(arguments, faults, moving=moving)
    alone = dataclasses.replace(config.tune, search=Search())  # no places for what a search might add
    tuner = pose(dataclasses.replace(config, tune=alone)).tuner
    out = new_folder(arguments.out, arguments.command, config)
    warn(console, config, "tune", moving=moving(config))
    console.say(f"examining {len(tuner.gains.names)} gains on {tuner.batch.size} scenarios ...")
    with failing():
        diagnosis = doctor.diagnose(tuner)
    text = doctor.page(diagnosis)
    files.write(out / "doctor.md", text + "\n")
    console.conclude(doctor.brief(diagnosis), f"written to {out}; begin with {out}/doctor.md")
    if not diagnosis.healthy:
        raise RunFailed(f"this problem has a fault: see {out}/doctor.md")
    return 0
