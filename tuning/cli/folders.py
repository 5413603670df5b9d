"""Run folders: new ones, and those of a run to go on with."""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

from agvjax import Fault, InputError

from ..config import Config, dump
from ..config.old import difference
from ..io import files


def new_folder(name: str | None, command: str, config: Config | None = None) -> Path:
    """Make the folder to write to, which must be new or empty, and try to write there.

    Args:
        name: of the folder; None for one under `runs` named by command and time.
        command: that writes there.
        config: written as `config.toml`; without it the folder stays empty.
    """
    out = Path(name or f"runs/{command}-{time.strftime('%Y%m%d-%H%M%S')}")
    try:
        out.mkdir(parents=True, exist_ok=True)
        taken = any(out.iterdir())
        if not taken:
            tempfile.TemporaryFile(dir=out, suffix=".part").close()
    except (OSError, ValueError) as error:
        raise InputError([Fault("--out", str(out), f"a folder that can be written ({error})")]) from error
    if taken:
        rule = "a new or empty folder: this one is not empty; choose another"
        rule += ", or add --resume to go on with the run in it" if command == "tune" else ""
        raise InputError([Fault("--out", str(out), rule)])
    if config is not None:
        files.write(out / "config.toml", dump(config))
    return out


def same_folder(name: str | None, config: Config) -> Path:
    """The folder of a run to go on with; its settings must be those of `config`."""
    out = Path(name or os.devnull)
    try:
        before = (out / "config.toml").read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        rule = "used with --out, the folder of a run: there is no config.toml in it"
        raise InputError([Fault("--resume", name, rule)]) from error
    if before and (changed := difference(before, dump(config))):
        raise InputError([Fault("--resume", name, f"the run that these settings began; changed: {changed}")])
    return out
