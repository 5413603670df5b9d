"""`agvjax sweep`: a robustness sweep by any number of processes, and its report."""

from __future__ import annotations

import argparse
import dataclasses
import importlib.util
import os
import re
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import agvjax
from agvjax import Fault, InputError

from .. import config as configuration
from ..config.load import resolve
from ..config.settings import Config
from ..io import files
from ..io.pages import html
from ..sweep import figures, page, results, shards, verdict, work
from ..sweep.design import LAW, Design, design
from ..sweep.rules import faults
from .console import Console, RunFailed
from .folders import new_folder
from .prepare import configure, rank_and_count, warn

INSTALL = "pip install 'agvjax[sweep]'"
NEEDS = {
    "saltelli": ("SALib",),
    "morris": ("SALib",),
}
PLACES = ("SLURM_ARRAY_TASK_ID", "SLURM_PROCID", "JOB_COMPLETION_INDEX")
GOLDEN = (5**0.5 - 1) / 2
BEGINNING = 50  # tenths of a second that the first process of a sweep is given to write its manifest


def run(arguments: argparse.Namespace) -> int:
    """Take shards until none is missing; whoever finishes last writes the report."""
    config, console = configure(arguments, faults, _more(arguments))
    _installed(config)
    laws = _controllers(config, arguments.imports)
    plan = design(config)
    place = _place(arguments)
    made = work.manifest_of(config, plan, laws)
    said = configuration.dump(config)
    out, made = _folder(arguments, console, made, said)
    warn(console, config, "sweep")
    plural = f" with each of {len(laws)} controllers" if len(laws) > 1 else ""
    console.say(f"{plan.size} scenarios{plural} in {made.count} shards; compiling ...")
    judges = work.judges(config, plan, list(laws.values()), min(made.shard, made.size))
    verdict.bounds_of(config, plan, judges[0], min(made.shard, made.size))  # before all the work
    _fill(console, out, made, plan, judges, int(place * made.count))
    while not _reported(out, said):
        with shards.held(out, "report") as ours:
            if ours and not _reported(out, said):
                (out / "report.html").unlink(missing_ok=True)
                files.write(out / "config.toml", said)
                console.say("looking at what was found ...")
                _conclude(console, config, results.load(out, arguments.imports), laws, judges, out)
                shards.sweep_up(out)
                return 0
        time.sleep(work.WAIT)  # another process writes it; if that is lost, this one will
    console.say(f"complete, with its report: {out}/report.html")
    return 0


def _reported(out: Path, said: str) -> bool:
    """Whether the report is there, for these settings."""
    return (out / "report.html").exists() and (out / "config.toml").read_text(encoding="utf-8") == said


def _more(arguments: argparse.Namespace) -> dict[str, Any]:
    """Settings of the options that only this command has."""
    more: dict[str, Any] = {}
    if arguments.over:
        more["sweep.over"] = [_axis(text) for text in arguments.over]
    elif arguments.ensemble:
        more["sweep.over"] = []
    more |= {"sweep.ensemble": True} if arguments.ensemble else {}
    more |= {"sweep.controllers": arguments.controller} if arguments.controller else {}
    for name in ("samples", "design"):
        given = getattr(arguments, name)
        more |= {f"sweep.{name}": given} if given is not None else {}
    return more


def _axis(text: str) -> dict[str, Any]:
    """`a+b=0:1.5:101` -> an axis on which both move as one; `*=` is times nominal, without a count it is sampled."""
    rule = "LEAF=LOW:HIGH[:POINTS], LEAF*=LOW:HIGH[:POINTS] or LEAF=A,B,C; LEAF+LEAF moves both"
    match = re.fullmatch(r"([^=*]+)(\*?)=(.+)", text)
    if match is None:
        raise InputError([Fault("--over", text, rule)])
    names, times, values = match[1].split("+"), match[2], match[3]
    try:
        if "," in values or ":" not in values:
            if times:
                raise ValueError
            span: Any = {"one_of": [float(x) for x in values.split(",")]}
        else:
            low, high, *points = values.split(":")
            span = {"times" if times else "between": [float(low), float(high)]}
            span |= {"points": int(*points)} if points else {}
    except (ValueError, TypeError) as error:
        raise InputError([Fault("--over", text, rule)]) from error
    return {name.strip(): span for name in names}


def _installed(config: Config) -> None:
    """Refuse what needs a library that is not there."""
    missing = [
        Fault("sweep.design", config.sweep.design, f"one whose libraries are installed ({library} is not: {INSTALL})")
        for library in NEEDS.get(config.sweep.design, ())
        if importlib.util.find_spec(library) is None
    ]
    if missing:
        raise InputError(missing)


def _controllers(config: Config, imports: Sequence[str]) -> dict[str, Any]:
    """The configured controller, then the others by their names."""
    laws = {"configured": config.controller}
    gains = {name.removeprefix(LAW) for table in config.sweep.over for name in table if name.startswith(LAW)}
    for name in config.sweep.controllers:
        if Path(name).suffix == ".toml":
            label = str(Path(name).with_suffix(""))
            law = _read(name, lambda name=name: configuration.load([name], imports=imports))
        else:
            label = name
            law = _read(name, lambda name=name: resolve({"controller": name}, imports=imports))
        missing = gains - set(agvjax.leaves(law))
        if missing:
            rule = f"a law that has the swept gains {', '.join(sorted(missing))}"
            raise InputError([Fault("sweep.controllers", name, rule)])
        if label in laws:
            raise InputError([Fault("sweep.controllers", name, "named once")])
        own = {gain: agvjax.leaves(config.controller)[gain] for gain in gains}
        laws[label] = law = agvjax.replace(law, own)  # a swept gain is the same in all
        if found := faults(dataclasses.replace(config, controller=law)):
            raise InputError([p._replace(key=f"{p.key}, with {name}") for p in found])
    return laws


def _read(name: str, load: Callable[[], Config]) -> Any:
    """A controller, what is wrong with it said of the name that was given."""
    try:
        return load().controller
    except InputError as error:
        said = "; ".join(map(str, error.faults))
        raise InputError(
            [Fault("sweep.controllers", name, f"a file of gains or the name of a law ({said})")]
        ) from error


def _place(arguments: argparse.Namespace) -> float:
    """Where among the shards this process begins, from 0 to 1, by its options or what SLURM and Kubernetes say."""
    given = rank_and_count(arguments.process_id, arguments.num_processes)
    if given is None:
        numbers = [os.environ[name] for name in PLACES if os.environ.get(name, "").isdecimal()]
        return int(numbers[0]) * GOLDEN % 1 if numbers else 0.0  # spread evenly, however many there are
    rank, count = given
    if count > 1 and not arguments.out:
        raise InputError([Fault("--out", "none", "the folder that the processes share")])
    return rank / count


def _folder(
    arguments: argparse.Namespace, console: Console, made: shards.Manifest, said: str
) -> tuple[Path, shards.Manifest]:
    """A new folder, or one in which this very sweep has begun, and the manifest in it."""
    out = Path(arguments.out) if arguments.out else None
    if out is None or not (out / shards.MANIFEST).exists():
        if arguments.resume:
            raise InputError(
                [Fault("--resume", arguments.out, "used with --out, the folder of a sweep that has begun")]
            )
        try:
            out = new_folder(arguments.out, arguments.command)
        except InputError:
            if out is None or not out.is_dir() or not _just_begun(out, made):
                raise
        if not (out / shards.MANIFEST).exists():
            files.write(out / "config.toml", said)
            shards.write_manifest(out, made)
            return out, made
    try:
        before = shards.read_manifest(out)
    except ValueError as error:
        raise InputError([Fault("--out", str(out), f"a new folder, or that of this sweep ({error})")]) from error
    try:
        made = shards.taken_up(before, made)
    except ValueError as error:
        rule = f"a new folder, or that of the same sweep; changed: {error}"
        raise InputError([Fault("--out", str(out), rule)]) from error
    if before.versions != made.versions:
        console.note(f"this sweep was begun with {before.versions}, here are {made.versions}")
    return out, made


def _just_begun(out: Path, made: shards.Manifest) -> bool:
    """Whether this sweep is being begun in the folder, or was: came no further, or lost its manifest since."""
    if any(shards.read_shard(out, made, i) is not None for i in range(made.count)):
        return True
    for _ in range(BEGINNING):
        if (out / shards.MANIFEST).exists():
            return True
        if any(path.name != "config.toml" and path.suffix != ".part" for path in out.iterdir()):
            return False
        time.sleep(0.1)
    return True


def _fill(console: Console, out: Path, made: shards.Manifest, plan: Design, judges: Sequence[Any], offset: int) -> None:
    """Shard by shard, with a bar."""
    with console.bar(made.size, " scenarios", scale=True) as bar:
        begun = False

        def tick(scenarios: int) -> None:
            nonlocal begun
            if not begun and scenarios:  # what an earlier start left says nothing of the rate
                bar.initial = bar.n = scenarios
                bar.refresh()
            elif begun:
                bar.update(scenarios)
            begun = True

        try:
            work.run(out, made, plan, judges, offset, tick)
        except OSError as error:
            done = sum(shards.path_of(out, i).exists() for i in range(made.count))
            raise RunFailed(
                f"a shard could not be written to {out} ({error}); {done} of {made.count} are kept: make room and"
                " give the same command again"
            ) from error


def _conclude(
    console: Console, config: Config, found: results.Results, laws: dict[str, Any], judges: Any, out: Path
) -> None:
    """Findings, figures, report."""
    seen = verdict.judge(config, found, laws, judges)
    names = []
    for name, figure in figures.every(found, seen.bounds, seen.which, seen.indices).items():
        files.write_figure(out / f"{name}.png", figure)
        names.append(f"{name}.png")
    text = page.page(found, seen, names, str(out))
    files.write_json(out / "findings.json", page.as_json(found, seen))
    files.write(out / "report.md", text)
    files.write(out / "report.html", html(text, out, "Sweep"))
    console.say(text, f"shards, findings and report written to {out}; begin with {out}/report.html")
