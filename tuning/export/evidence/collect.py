"""All checks of an export in C, and the folder that keeps them."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from ...io import files
from .. import program
from ..artefact import Artefact
from . import beside_jax, compilers, cortex, count, coverage, misra, page, rows, sanitizers, stack, trace
from .check import FAILED, NOT_RUN, PASSED, Bench, Check
from .harness import Subject, write
from .rows import Layout, Wanted
from .search import Found, search

BITS = {64: np.float64, 32: np.float32}


def gather(
    artefact: Artefact, name: str, texts: Mapping[str, str], out: Path, note: Callable[[str], None]
) -> list[Check]:
    """Run every check whose tools are here; write `evidence.json`, `vectors.csv` and the page into a folder.

    Args:
        artefact: what was exported.
        name: of the library in C.
        texts: its files by name.
        out: the folder, which is there.
        note: is told how far it is.

    Returns:
        The checks, also those that failed or were not run.
    """
    subject = subject_of(artefact, name, texts)
    note("evidence: rows for each branch are searched")
    by_bits = vectors(subject)
    wanted = rows.by_jax(artefact, subject.layout, by_bits[64])
    checks = run(subject, by_bits, wanted, note)
    table = _table(subject.layout, by_bits)
    files.write(out / "vectors.csv", table)
    traced = trace.traces(subject, checks)
    told = {"vectors": {"file": "vectors.csv", "sha256": hashlib.sha256(table.encode()).hexdigest()}}
    told |= {"rows": {str(bits): len(found) for bits, found in by_bits.items()}}
    files.write(out / "evidence.json", files.as_json(_told(subject, checks, traced) | told))
    page.write(out, subject, checks, traced)
    return checks


def subject_of(artefact: Artefact, name: str, texts: Mapping[str, str]) -> Subject:
    """What the evidence is about: the files that a robot runs, not the export's own self-test."""
    step = program.step(artefact.controller)
    kept = {file: texts[file] for file in (f"{name}.h", f"{name}.c", f"{name}_route.c") if file in texts}
    return Subject(artefact, step, Layout.of(step), name, kept)


def vectors(subject: Subject) -> dict[int, np.ndarray]:
    """By precision the rows: a drive, the export's own, numbers broken or changed one by one, far places, searched."""
    artefact, step, layout = subject.artefact, subject.program, subject.layout
    usual = rows.usual(artefact, step, layout)
    broken, start = rows.broken(layout, usual), program.start(artefact.controller)
    seeds, laid, found = np.concatenate([usual, broken]), rows.routes(artefact), {}
    for bits, dtype in BITS.items():
        parts: list[Found] = [search(one, layout, seeds, laid, dtype, one is start) for one in (step, start)]
        more = [part.rows for part in parts]
        kept = [rows.drive(usual), usual, broken, rows.singly(layout, usual), rows.far(layout, usual)]
        found[bits] = np.concatenate([*kept, *more])
    return found


def run(
    subject: Subject, by_bits: Mapping[int, np.ndarray], wanted: Wanted, note: Callable[[str], None]
) -> list[Check]:
    """The checks, one after the other."""
    with tempfile.TemporaryDirectory(prefix="evidence") as folder:
        bench = Bench(Path(folder), [])
        write(bench, subject)
        done = []
        for look in looks(subject, by_bits, wanted):
            done.append(look(bench))
            note(f"evidence: {done[-1].name}: {done[-1].verdict}: {done[-1].says}")
    return done


def looks(subject: Subject, by_bits: Mapping[int, np.ndarray], wanted: Wanted) -> Sequence[Callable[[Bench], Check]]:
    """Each check, to be run in a folder; the quick ones first."""
    return [
        lambda bench: beside_jax.check(subject, bench, by_bits[64], wanted),
        lambda bench: coverage.check(subject, bench, by_bits),
        lambda bench: sanitizers.check(subject, bench, by_bits),
        lambda bench: compilers.check(subject, bench, "gcc"),
        lambda bench: compilers.check(subject, bench, "clang"),
        lambda bench: stack.check(subject, bench, "stack", ["gcc"]),
        lambda bench: stack.check(subject, bench, "stack_cortex_m4f", [cortex.COMPILER, *stack.CORTEX]),
        lambda bench: cortex.check(subject, bench, by_bits),
        lambda bench: count.check(subject, bench, by_bits[64]),
        lambda bench: misra.check(subject, bench),
    ]


def _told(subject: Subject, checks: Sequence[Check], traced: Sequence[trace.Trace]) -> files.Json:
    names = {kind: [check.name for check in checks if check.verdict == kind] for kind in (PASSED, FAILED, NOT_RUN)}
    facts = subject.artefact.provenance
    return {
        "name": subject.name,
        "generator": facts["generator"],
        "configuration_sha256": facts["configuration_sha256"],
        "summary": page.verdict(checks),
        **{kind.replace(" ", "_"): found for kind, found in names.items()},
        "checks": [check.plain() for check in checks],
        "trace": [one._asdict() for one in traced],
        "deviations": misra.DEVIATIONS,
    }


def _table(layout: Layout, by_bits: Mapping[int, np.ndarray]) -> str:
    """All rows as CSV, the first column the bits of the precision that they are for."""
    lines = [",".join(["bits", *layout.names])]
    for bits, found in by_bits.items():
        lines += [",".join([str(bits), *map(repr, row)]) for row in found.tolist()]
    return "\n".join(lines) + "\n"
