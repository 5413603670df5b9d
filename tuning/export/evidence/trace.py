"""What was required, and where it can be found again: goal or limit, gains, file, check."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...config.complete import complete
from ...config.settings import Limit, Weights
from ..artefact import plain
from .check import Check
from .harness import Subject

FIXED = ("vehicle.", "period")


class Trace(NamedTuple):
    """One requirement."""

    requirement: str
    asked: str  # goal or limit, or what the export promises
    gains: dict[str, str]  # name and value
    file: str
    sha256: str
    checks: tuple[str, ...]
    result: str  # of each of them


def traces(subject: Subject, checks: Sequence[Check]) -> list[Trace]:
    """Those of the tuning, where its configuration is known, then those of the exported code itself."""
    facts, file = subject.artefact.provenance, f"{subject.name}.c"
    named = {
        name: plain(f"{fact['value']} {fact['unit']}".strip()) if np.size(fact["value"]) <= 3 else "several numbers"
        for name, fact in facts["gains"].items()
    }
    tuned = {name: value for name, value in named.items() if not name.startswith(FIXED)}
    limits = {name: value for name, value in named.items() if "limit" in name or "speed" in name or "period" in name}
    rows: list[tuple[str, str, dict[str, str], tuple[str, ...]]] = []
    for requirement, asked in _tuned(subject):
        rows.append((requirement, asked, tuned, ("beside_jax", "cortex_m4f")))
    period = {name: value for name, value in named.items() if name == "period"}
    rows += [
        ("the law that was tuned is the one that runs", "the JAX step, to a tolerance", tuned, ("beside_jax",)),
        ("one step a period", f"{facts['period']['value']:g} s", period, ("beside_jax", "instructions")),
        ("nothing is asked beyond what actuators can do", "output.limited", limits, ("beside_jax", "coverage")),
        ("a number that is not finite never enters the state", "output.status", {}, ("beside_jax", "coverage")),
        ("no code that never runs", "every branch taken", {}, ("coverage",)),
        ("no undefined behaviour", "no report", {}, ("sanitizers", "misra")),
        ("clean C", "no warning", {}, ("warnings_gcc", "warnings_clang", "misra")),
        ("stack that is known", "bytes of each function", {}, ("stack", "stack_cortex_m4f")),
        ("the same on the target", "Cortex-M4F", {}, ("cortex_m4f",)),
    ]
    by_name = {check.name: check for check in checks}
    sha = hashlib.sha256(subject.texts[file].encode()).hexdigest()
    return [
        Trace(requirement, asked, gains, file, sha, tuple(dict.fromkeys(names)), _results(by_name, names))
        for requirement, asked, gains, names in rows
    ]


def _results(checks: dict[str, Check], names: Sequence[str]) -> str:
    found = [f"{name}: {checks[name].verdict}" for name in dict.fromkeys(names) if name in checks]
    return ", ".join(found)


def _tuned(subject: Subject) -> list[tuple[str, str]]:
    """Goals and limits of the tuning; one line that says so where no configuration is known."""
    config, verdict = subject.artefact.config, plain(str(subject.artefact.provenance["verdict"]))
    if config is None:
        return [("what the gains were tuned for", "not stated: no config.toml beside the gains")]
    tune = complete(config).tune
    rows = [(f"small {name}", f"goal: {_parts(weights)}; {verdict}") for name, weights in tune.goals.items()]
    for name, limit in tune.limits.items():
        kind = "at least" if limit.least else "at most"
        unit = "" if limit.absolute else " times the starting gains'"
        rows.append((f"{name} within its limit", f"limit: {kind} {_parts(limit)}{unit}; {verdict}"))
    return [(plain(requirement), plain(asked)) for requirement, asked in rows]


def _parts(statistics: Weights | Limit) -> str:
    """Of weights or of a limit those that are set."""
    values = dataclasses.asdict(statistics).items()
    return ", ".join(f"{name} {x:g}" for name, x in values if isinstance(x, float) and np.isfinite(x) and x != 0.0)
