"""All rows run under the sanitizers of addresses and of undefined behaviour."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...io.files import Json
from .check import Bench, Check, judged
from .harness import STRICT, Subject, compiled, ran

FLAGS = ("-g", "-O1", "-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all")


def check(subject: Subject, bench: Bench, rows: Mapping[int, np.ndarray]) -> Check:
    """Both precisions, each on its rows."""

    def look(bench: Bench) -> tuple[str, Json, list[str]]:
        found: list[str] = []
        for bits, of_bits in rows.items():
            wrong = compiled(bench, subject, ["gcc", *STRICT, *FLAGS, *subject.single(bits)], "sanitized")
            if not wrong:
                made, said = ran(bench, subject, of_bits, "./sanitized")
                wrong = [f"{bits} bits: {said[:300]}"] if made is None else []
            found += wrong
        counts = {f"rows_{bits}": len(of_bits) for bits, of_bits in rows.items()}
        return f"{sum(counts.values())} steps and starts, {len(found)} reports", counts, found

    asks = "no report of AddressSanitizer or UndefinedBehaviorSanitizer on any row"
    return judged("sanitizers", asks, ["gcc"], bench, subject.texts, look)
