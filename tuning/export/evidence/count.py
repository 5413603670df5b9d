"""How many instructions a step takes, as callgrind counts them."""

from __future__ import annotations

import re

import numpy as np

from ...io.files import Json
from .check import Bench, Check, judged
from .harness import STRICT, Subject, compiled, ran
from .rows import START


def check(subject: Subject, bench: Bench, rows: np.ndarray) -> Check:
    """Of the machine that makes the evidence; the most over the rows is the most that was seen, and no bound."""

    def look(bench: Bench) -> tuple[str, Json, list[str]]:
        if wrong := compiled(bench, subject, ["gcc", *STRICT, "-O2", "-g"], "counted"):
            return "it does not compile", {}, wrong
        step = f"{subject.name}_step"
        options = [f"--toggle-collect={step}", f"--dump-after={step}", "--combine-dumps=yes"]
        command = ["valgrind", "--tool=callgrind", *options, "--callgrind-out-file=counted.out", "./counted"]
        made, said = ran(bench, subject, rows, *command)
        if made is None:
            return "it does not run", {}, [said[:300]]
        text = (bench.folder / "counted.out").read_text()
        counts = [int(x) for x in re.findall(r"^totals: (\d+)", text, re.M)]
        steps = np.flatnonzero(rows[:, 0] != START)
        each = [x for x in counts if x > 0]
        if len(each) != len(steps):
            return "not counted", {"counts": len(each)}, [f"{len(each)} counts of {len(steps)} steps"]
        most, least = max(each), min(each)
        figures = {"worst_seen": most, "least_seen": least, "row": int(steps[int(np.argmax(each))]), "steps": len(each)}
        return f"{most} instructions in the worst step seen, {least} in the least, of {len(each)}", figures, []

    asks = "counted on every row; the worst seen is stated, no bound on what can be"
    return judged("instructions", asks, ["gcc", "valgrind"], bench, subject.texts, look)
