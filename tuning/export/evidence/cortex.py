"""The exported code built for a Cortex-M4F and run under QEMU, beside what it makes on this machine."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...io.files import Json
from .check import Bench, Check, judged
from .harness import FILES, STRICT, Subject, compiled, ran
from .rows import FIRST, USUAL, unrolled
from .stack import CORTEX

COMPILER, BOARD = "arm-none-eabi-gcc", "mps2-an386"
TOLERANCES = {64: 1e-9, 32: 1e-4}  # of the largest number of a row or 1: the two have other functions in math.h


def check(subject: Subject, bench: Bench, rows: Mapping[int, np.ndarray]) -> Check:
    """In both precisions; the processor's own floating-point unit has single precision alone."""

    def look(bench: Bench) -> tuple[str, Json, list[str]]:
        found: list[str] = []
        figures: Json = {}
        for bits, of_bits in rows.items():
            place = bench.fresh(f"cortex_{bits}")
            for file in ("startup.c", "memory.ld"):
                (place.folder / file).write_text((FILES / f"{file}.txt").read_text())
            host, said = _by(place, subject, of_bits, bits, False)
            if host is None:
                return "it does not run", figures, [said]
            steps = unrolled(subject.layout, of_bits, host)
            target, said = _by(place, subject, steps, bits, True)
            if target is None:
                return "it does not run", figures, [said]
            figures |= {f"{key}_{bits}": x for key, x in _compared(target, host, steps).items()}
            found += _objections(figures, bits)
        same = [f"{figures[f'same_{b}']} of {figures[f'rows_{b}']} rows bit by bit ({b} bits)" for b in rows]
        return f"as on this machine: {', '.join(same)}", figures, found

    tolerance = ", ".join(f"{x:g} in {bits} bits" for bits, x in TOLERANCES.items())
    asks = f"the same status as on this machine on every row, `limited` and numbers of usual size to {tolerance}"
    return judged("cortex_m4f", asks, ["gcc", COMPILER, "qemu-system-arm"], bench, subject.texts, look)


def _by(place: Bench, subject: Subject, rows: np.ndarray, bits: int, target: bool) -> tuple[np.ndarray | None, str]:
    """What the code makes of rows, on the target or on this machine."""
    single = subject.single(bits)
    if not target:
        wrong = compiled(place, subject, ["gcc", *STRICT, "-O2", *single], "host")
        return (None, wrong[0]) if wrong else ran(place, subject, rows, "./host")
    flags = [*STRICT, "-O2", *CORTEX, "--specs=rdimon.specs", "-T", "memory.ld", "startup.c"]
    if wrong := compiled(place, subject, [COMPILER, *flags, *single], "target.elf"):
        return None, wrong[0]
    machine = ["qemu-system-arm", "-M", BOARD, "-nographic", "-monitor", "none", "-serial", "none"]
    return ran(
        place, subject, rows, *machine, "-semihosting-config", "enable=on,target=native", "-kernel", "target.elf"
    )


def _compared(target: np.ndarray, host: np.ndarray, rows: np.ndarray) -> Json:
    got, wanted = target[:, :-2], host[:, :-2]
    finite = np.isfinite(wanted)
    largest = np.where(finite, np.abs(wanted), 1.0).max(axis=1, initial=1.0)
    size = np.abs(np.nan_to_num(rows[:, len(FIRST) :], posinf=0.0, neginf=0.0)).max(axis=1)
    usual = (size < USUAL) & (largest < USUAL)
    with np.errstate(all="ignore"):
        away = np.nan_to_num(np.where(finite, np.abs(got - wanted), 0.0), nan=np.inf).max(axis=1, initial=0.0) / largest
    same = (np.equal(target, host) | (np.isnan(target) & np.isnan(host))).all(axis=1)
    return {
        "rows": len(rows),
        "same": int(same.sum()),
        "worst": float(away[usual].max(initial=0.0)),
        "usual": int(usual.sum()),
        "status_differs": int((target[:, -1] != host[:, -1]).sum()),
        "limited_differs": int((target[usual, -2] != host[usual, -2]).sum()),
    }


def _objections(figures: Json, bits: int) -> list[str]:
    found = []
    for key in ("status_differs", "limited_differs"):
        if figures[f"{key}_{bits}"]:
            found.append(f"{bits} bits: {key.replace('_', ' ')} on {figures[f'{key}_{bits}']} rows")
    if figures[f"worst_{bits}"] > TOLERANCES[bits]:
        found.append(f"{bits} bits: off by {figures[f'worst_{bits}']:.1e}")
    return found
