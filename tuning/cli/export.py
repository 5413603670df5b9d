"""`agvjax export`: the step of a tuned controller as C, NumPy, ROS 2 or StableHLO."""

from __future__ import annotations

import argparse
import importlib
import keyword
import re
import sys

import jax

from agvjax import Fault, InputError

from ..compute import compiled
from ..export import FORMATS, artefact
from ..io import files
from .console import Console
from .folders import new_folder
from .prepare import overrides

TAKEN = sys.stdlib_module_names | {"numpy", "rclpy"}


def run(arguments: argparse.Namespace) -> int:
    """Write the artefact into a new folder."""
    if arguments.precision == 32:
        rule = "64, or left out: the C source is compiled for single precision by a macro, the others are in double"
        raise InputError([Fault("--precision", 32, rule)])
    name = arguments.name
    if name is not None and (not re.fullmatch(r"[a-z][a-z0-9_]*", name) or keyword.iskeyword(name) or name in TAKEN):
        rule = "lower-case letters, digits and underscores, a letter first; no word and no known module of Python"
        raise InputError([Fault("--name", name, rule)])
    jax.config.update("jax_enable_x64", True)
    console = Console(arguments.quiet)
    compiled.keep_compiled()
    compiled.listen(console.note)
    found = artefact.read(arguments.gains, arguments.config, overrides(arguments), arguments.imports)
    module = importlib.import_module(FORMATS[arguments.format])  # late: each has its own needs
    try:
        made = module.files(found, name or module.NAME)
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            [Fault("controller", found.provenance["law"][-1], f"a law that can be exported ({error})")]
        ) from error
    out = new_folder(arguments.out, arguments.command)
    for name, content in made.items():
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        files.write(out / name, content)
    files.write_json(out / "provenance.json", found.provenance)
    if isinstance(found.provenance["uncertainty"], str):
        console.note(f"uncertainty {found.provenance['uncertainty']}")
    console.say(f"{len(made) + 1} files written to {out}: {', '.join(sorted(made))}")
    return 0
