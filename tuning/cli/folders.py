"""Run folders: new ones, and those of a run to go on with."""

from __future__ import annotations

import argparse
import contextlib
import os
import time
import tomllib
from pathlib import Path

import agvjax
from agvjax import InputError

from .. import config as configuration
from ..config.read import flat
from ..config.settings import Config
from ..io import files


def new_folder(arguments: argparse.Namespace) -> Path:
    """The folder to write to, which must be new or empty."""
    name = arguments.out or f"runs/{arguments.command}-{time.strftime('%Y%m%d-%H%M%S')}"
    out = Path(name)
    try:
        out.mkdir(parents=True, exist_ok=True)
        taken = any(out.iterdir())
        if not taken:
            files.write(out / "config.toml", "")
    except (OSError, ValueError) as error:
        raise InputError([agvjax.Fault("--out", name, f"a folder that can be written ({error})")]) from error
    if taken:
        rule = "a new or empty folder: this one is not empty; choose another"
        rule += ", or add --resume to go on with the run in it" if arguments.command == "tune" else ""
        raise InputError([agvjax.Fault("--out", name, rule)])
    return out


def leave_folder(out: Path) -> None:
    """Nothing stays of a run whose input turned out to be wrong after its folder was made."""
    (out / "config.toml").unlink(missing_ok=True)
    with contextlib.suppress(OSError):  # something else was put there
        out.rmdir()


def same_folder(arguments: argparse.Namespace, config: Config) -> Path:
    """The folder of the run to go on with; its settings must be these."""
    out = Path(arguments.out or os.devnull)
    try:
        before = (out / "config.toml").read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        rule = "used with --out, the folder of a run: there is no config.toml in it"
        raise InputError([agvjax.Fault("--resume", arguments.out, rule)]) from error
    changed = difference(before, configuration.dump(config))
    if before and changed:
        rule = f"the run that these settings began; changed: {changed}"
        raise InputError([agvjax.Fault("--resume", str(out), rule)])
    return out


def difference(old: str, new: str) -> str:
    """What differs between two configurations in TOML, in words."""
    before, now = (dict(flat(tomllib.loads(text), ())) for text in (old, new))
    keys = [key for key in dict.fromkeys((*before, *now)) if before.get(key) != now.get(key)]
    told = [("was", before, key) for key in keys] + [("is", now, key) for key in keys]
    return "; ".join(f"{verb} `{key} = {table[key]}`" for verb, table, key in told if key in table)
