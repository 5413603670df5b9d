"""The exported step beside the JAX step that it was written from, on all rows and along a drive of the exported one."""

from __future__ import annotations

import jax
import numpy as np

from ...io.files import Json
from .check import Bench, Check, judged
from .harness import STRICT, Subject, compiled, ran
from .rows import FIRST, HUGE, ON, STEP, USUAL, Wanted, by_jax, strange, unrolled

TOLERANCE = 1e-10  # of the largest number of a row or 1, of rows of numbers that a robot can have


def check(subject: Subject, bench: Bench, rows: np.ndarray, wanted: Wanted) -> Check:
    """In double precision."""

    def look(bench: Bench) -> tuple[str, Json, list[str]]:
        if wrong := compiled(bench, subject, ["gcc", *STRICT, "-O2"], "usual"):
            return "it does not compile", {}, wrong
        made, said = ran(bench, subject, rows, "./usual")
        if made is None:
            return "it does not run", {}, [said[:300]]
        steps = unrolled(subject.layout, rows, made)
        theirs = step_by_step(subject, made, driven(subject, steps, wanted, rows), steps)
        return compared(made, theirs, rows, strange(subject.layout, rows))

    asks = f"status and `limited` are those of JAX on every row, and numbers to {TOLERANCE:g} on rows of usual size"
    return judged("beside_jax", asks, ["gcc"], bench, subject.texts, look)


def driven(subject: Subject, steps: np.ndarray, wanted: Wanted, rows: np.ndarray) -> Wanted:
    """The same, of a drive's steps from the states that the exported code had."""
    numbers, flags, of_drive = wanted.numbers.copy(), wanted.flags.copy(), rows[:, 0] == ON
    if of_drive.any():
        numbers[of_drive], flags[of_drive] = by_jax(subject.artefact, subject.layout, steps[of_drive])
    return Wanted(numbers, flags)


def step_by_step(subject: Subject, made: np.ndarray, wanted: Wanted, rows: np.ndarray) -> Wanted:
    """The same, of steps from huge numbers that differ in kind by JAX's operations one after the other.

    Compiled, XLA multiplies and divides in another order, and so overflows in another place.
    """
    numbers, flags = (x.copy() for x in wanted)
    count = numbers.shape[1]
    differs = (np.isfinite(made[:, :count]) != np.isfinite(numbers)).any(axis=1) | (made[:, count:] != flags).any(
        axis=1
    )
    huge = (np.abs(np.nan_to_num(rows[:, len(FIRST) :], posinf=0.0, neginf=0.0)) >= HUGE).any(axis=1)
    again = np.flatnonzero(differs & huge & (rows[:, 0] == STEP))
    if again.size:
        with jax.disable_jit():
            numbers[again], flags[again] = by_jax(subject.artefact, subject.layout, rows[again])
    return Wanted(numbers, flags)


def compared(made: np.ndarray, wanted: Wanted, rows: np.ndarray, odd: np.ndarray) -> tuple[str, Json, list[str]]:
    """What differs.

    On rows of huge numbers, and `odd` ones, which are there for the branches, results may be anything: each has to be
    finite where that of JAX is, and both zero or neither.
    """
    count = wanted.numbers.shape[1]
    got, flags = made[:, :count], made[:, count:]
    size = np.abs(np.nan_to_num(rows[:, len(FIRST) :], nan=0.0, posinf=0.0, neginf=0.0)).max(axis=1)
    finite = np.isfinite(wanted.numbers)
    largest = np.where(finite, np.abs(wanted.numbers), 1.0).max(axis=1, initial=1.0)
    usual = (size < USUAL) & (largest < USUAL) & ~odd
    with np.errstate(all="ignore"):
        away = np.where(finite, np.abs(got - wanted.numbers), 0.0) / largest[:, None]
    away = np.where(np.isnan(away), np.inf, away).max(axis=1, initial=0.0)
    kinds = (np.isfinite(got) != finite).any(axis=1)
    found = [f"row {i}: off by {away[i]:.1e}" for i in np.flatnonzero(usual & (away > TOLERANCE))]
    found += [f"row {i}: a number is finite in one and not in the other" for i in np.flatnonzero(kinds)]
    for column, what in enumerate(("limited", "status")):
        differs = flags[:, column] != wanted.flags[:, column]
        found += [
            f"row {i}: {what} is {flags[i, column]:g}, of JAX {wanted.flags[i, column]:g}"
            for i in np.flatnonzero(differs)
        ]
    worst = float(away[usual].max(initial=0.0))
    steps = int((rows[:, 0] == ON).sum())
    figures = {"rows": len(rows), "usual": int(usual.sum()), "driven": steps, "worst": worst, "tolerance": TOLERANCE}
    return f"{len(rows)} rows, {steps} of them of a drive: largest deviation {worst:.1e}", figures, found
