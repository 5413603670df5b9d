"""`agvjax export`: the step of a tuned controller as C, NumPy, ROS 2, StableHLO or FMU, and the vehicle as an FMU."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path

import jax

from agvjax import Fault, InputError

from ..compute import compiled
from ..export import FORMATS, PLANTS, artefact, names
from ..io import files
from .console import Console
from .folders import new_folder
from .prepare import overrides


def run(arguments: argparse.Namespace) -> int:
    """Write the artefact into a new folder."""
    if arguments.precision == 32:
        rule = "64, or left out: the C source is compiled for single precision by a macro, the others are in double"
        raise InputError([Fault("--precision", 32, rule)])
    name = arguments.name
    if name is not None and (wrong := names.faults(name)):
        raise InputError(wrong)
    forms, what = (PLANTS, "plant") if arguments.what == "plant" else (FORMATS, "controller")
    if arguments.format not in forms:
        raise InputError([Fault("--what", what, f"of --format {' or '.join(forms)}")])
    if arguments.evidence and arguments.format != "c":
        raise InputError([Fault("--evidence", arguments.format, "left out, or with --format c")])
    jax.config.update("jax_enable_x64", True)
    console = Console(arguments.quiet)
    compiled.keep_compiled()
    compiled.listen(console.note)
    found = artefact.read(arguments.gains, arguments.config, overrides(arguments), arguments.imports, console.note)
    module = importlib.import_module(forms[arguments.format])  # late: each has its own needs
    try:
        made = module.files(found, name or module.NAME)
    except InputError:
        raise
    except ValueError as error:
        rule = f"{'a law' if what == 'controller' else 'a vehicle'} that can be exported ({error})"
        key, kind = ("controller", found.provenance["law"][-1]) if what == "controller" else ("scenario", what)
        raise InputError([Fault(key, kind, rule)]) from error
    out = new_folder(arguments.out, arguments.command)
    contents = {"provenance.json": files.as_json(found.provenance)} | made  # a form may have more to say there
    for file, content in contents.items():
        (out / file).parent.mkdir(parents=True, exist_ok=True)
        files.write(out / file, content)
    if isinstance(found.provenance["uncertainty"], str):
        console.note(f"uncertainty {found.provenance['uncertainty']}")
    verdict = found.provenance["verdict"]
    if verdict not in (artefact.MET, artefact.UNJUDGED):
        console.note(f"verdict on these gains: {verdict}")
    console.say(f"{len(contents)} files written to {out}: {', '.join(sorted(contents))}")
    return _evidence(found, name or module.NAME, made, out / "evidence", console) if arguments.evidence else 0


def _evidence(found: artefact.Artefact, name: str, made: dict[str, str], out: Path, console: Console) -> int:
    """Check the files; 1 where a check failed. What was not run is said, and is no failure."""
    from ..export import evidence  # late: it is asked for rarely

    out.mkdir()
    checks = evidence.gather(found, name, made, out, console.note)
    console.conclude(evidence.verdict(checks), str(out / "report.html"))
    return int(any(check.verdict == "failed" for check in checks))
