"""The options `--mcap` and `--rerun`: files that are asked for, and what writes them."""

from __future__ import annotations

import argparse
import importlib.util
import os
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import agvjax
from agvjax import Fault, InputError
from agvjax.protocols import Plant

from ..curves import Track
from ..files import write_by
from . import mcap_file, rerun_file
from .told import of_run

INSTALL = "pip install 'agvjax[viewer]'"
KINDS = {"mcap": mcap_file, "rerun": rerun_file}  # by option what writes it
ENDS = {"mcap": ".mcap", "rerun": ".rrd"}


class Asked(NamedTuple):
    """Files that are asked for."""

    mcap: str | None = None
    rerun: str | None = None


def asked(arguments: argparse.Namespace) -> Asked:
    """Those of a command line.

    Raises:
        agvjax.InputError: one is there already, or what writes it is not installed.
    """
    files = Asked(arguments.mcap, arguments.rerun)
    check(files)
    return files


def check(files: Asked) -> None:
    """Refuse a file that cannot be written, before anything is computed for it.

    Raises:
        agvjax.InputError: it is there already, or what writes it is not installed.
    """
    wrong = []
    for kind, file in _given(files):
        path, needs = Path(file), KINDS[kind].NEEDS
        if not all(map(importlib.util.find_spec, needs)):
            rule = f"left out where {' and '.join(needs)} is not installed: {INSTALL}"
            wrong.append(Fault(f"--{kind}", file, rule))
            continue
        rule = f"a new file that ends in {ENDS[kind]}, in a folder that there is and that you may write in"
        try:
            if path.suffix != ENDS[kind] or os.path.exists(path):
                raise OSError
            write_by(path, lambda stream: None)  # as it will be written: its name may be too long, its folder closed
            path.unlink()
        except (OSError, ValueError):
            wrong.append(Fault(f"--{kind}", file, rule))
    if wrong:
        raise InputError(wrong)


def write_runs(files: Asked, runs: Mapping[str, agvjax.Trajectory], plant: Plant) -> None:
    """Write runs of one plant and one timing, by name, to files that `check` accepted; that of a single may be empty.

    Poses and velocities are those of the middle of the axle, of a plant without one those of its reference point; yaw
    rates are slopes of the heading. A number that is not finite is written as it is.
    """
    for kind, file in _given(files):
        told = {name: of_run(run, plant) for name, run in runs.items()}
        write_by(Path(file), lambda stream, kind=kind, told=told: KINDS[kind].write_runs(stream, told))


def write_tracks(files: Asked, tracks: Mapping[str, Track]) -> None:
    """Write tracks by name to files that `check` accepted."""
    for kind, file in _given(files):
        write_by(Path(file), lambda stream, kind=kind: KINDS[kind].write_tracks(stream, tracks))


def _given(files: Asked) -> list[tuple[str, str]]:
    return [(kind, file) for kind, file in files._asdict().items() if file is not None]
