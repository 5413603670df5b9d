"""Which branches of the exported code the rows take, as gcov counts them."""

from __future__ import annotations

import gzip
import json
from collections.abc import Mapping

import numpy as np

from ...io.files import Json
from .check import Bench, Check, judged
from .harness import STRICT, Subject, compiled, ran


def check(subject: Subject, bench: Bench, rows: Mapping[int, np.ndarray]) -> Check:
    """Both precisions, each on its rows; what is never taken is named by file and line."""

    def look(bench: Bench) -> tuple[str, Json, list[str]]:
        found: list[str] = []
        figures: Json = {}
        for bits, of_bits in rows.items():
            taken, branches, lines, missed = _counted(bench, subject, of_bits, bits)
            figures |= {f"branches_{bits}": branches, f"taken_{bits}": taken, f"lines_{bits}": lines}
            figures |= {f"rows_{bits}": len(of_bits)}
            found += missed
        shares = [f"{figures[f'taken_{b}']} of {figures[f'branches_{b}']} ({b} bits)" for b in rows]
        return f"branches taken: {', '.join(shares)}", figures, found

    asks = "every branch of the exported code is taken, both ways of each condition, by rows found by search"
    return judged("coverage", asks, ["gcc", "gcov"], bench, subject.texts, look)


def _counted(bench: Bench, subject: Subject, rows: np.ndarray, bits: int) -> tuple[int, int, int, list[str]]:
    """Branches taken, of how many; lines; and each that was not taken."""
    place = bench.fresh(f"coverage_{bits}")
    flags = ["gcc", *STRICT, "-O0", "--coverage", *subject.single(bits)]
    if wrong := compiled(place, subject, flags, "covered"):
        return 0, 0, 0, wrong
    made, said = ran(place, subject, rows, "./covered")
    if made is None:
        return 0, 0, 0, [f"{bits} bits: {said[:300]}"]
    taken, branches, lines, missed = 0, 0, 0, []
    for source in subject.sources:
        place.call("gcov", "--json-format", "--branch-probabilities", f"covered-{source[:-2]}.gcda")
        report = place.folder / f"covered-{source[:-2]}.gcov.json.gz"
        if not report.is_file():
            continue  # data alone
        for file in json.loads(gzip.decompress(report.read_bytes()))["files"]:
            text = subject.texts.get(file["file"], "").splitlines()
            for line in file["lines"]:
                lines += 1
                where = f"{file['file']}:{line['line_number']} ({bits} bits)"
                shown = text[line["line_number"] - 1].strip() if text else ""
                missed += [f"{where}: never run: {shown}"] * (line["count"] == 0)
                ways = [branch["count"] > 0 for branch in line["branches"]]
                branches, taken = branches + len(ways), taken + sum(ways)
                missed += [f"{where}: way {i} never taken: {shown}" for i, way in enumerate(ways) if not way]
    return taken, branches, lines, missed if lines else [f"{bits} bits: gcov counted nothing"]
