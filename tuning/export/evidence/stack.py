"""How much stack each function takes, as the compiler lays it out; functions of math.h come on top."""

from __future__ import annotations

from collections.abc import Sequence

from ...io.files import Json
from .check import Bench, Check, judged
from .harness import Subject

CORTEX = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16")


def check(subject: Subject, bench: Bench, name: str, compiler: Sequence[str]) -> Check:
    """In double and in single precision."""

    def look(bench: Bench) -> tuple[str, Json, list[str]]:
        figures: Json = {}
        found: list[str] = []
        for bits in (64, 32):
            command = [*compiler, "-std=c99", "-O2", "-fstack-usage", *subject.single(bits), "-c", f"{subject.name}.c"]
            done = bench.call(*command, "-o", "stack.o")
            usage = bench.folder / "stack.su"
            if done.returncode or not usage.is_file():
                return "it does not compile", {}, [done.stderr[:300]]
            for line in usage.read_text().splitlines():
                place, size, kind = line.split("\t")
                function = place.rpartition(":")[2]
                figures[f"{function}_{bits}"] = int(size)
                found += [f"{function}: the size of its stack is {kind}"] * ("static" not in kind)
        step = {bits: figures.get(f"{subject.name}_step_{bits}", 0) for bits in (64, 32)}
        return f"a step takes {step[64]} bytes in double, {step[32]} in single precision", figures, found

    asks = "of each function a size that is fixed; bytes are stated, without what functions of math.h take"
    return judged(name, asks, [compiler[0]], bench, subject.texts, look)
