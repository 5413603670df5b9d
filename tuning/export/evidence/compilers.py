"""What gcc and clang warn of."""

from __future__ import annotations

from ...io.files import Json
from .check import Bench, Check, judged
from .harness import Subject, messages

COMMON = (
    "-Wall -Wextra -Wpedantic -Werror -Wconversion -Wsign-conversion -Wfloat-conversion -Wdouble-promotion -Wshadow"
    " -Wundef -Wcast-align -Wcast-qual -Wstrict-prototypes -Wmissing-prototypes -Wold-style-definition"
    " -Wpointer-arith -Wwrite-strings -Wswitch-default -Wredundant-decls -Wvla -Wformat=2"
).split()
OWN = {  # -Wfloat-equal is left out: x != x is how C99 without macros asks for NaN
    "gcc": "-Wlogical-op -Wduplicated-cond -Wduplicated-branches -Wjump-misses-init".split(),
    "clang": "-Wunreachable-code -Wconditional-uninitialized -Wassign-enum -Wcomma -Wimplicit-fallthrough".split(),
}
STANDARDS = ("c99", "c11")


def check(subject: Subject, bench: Bench, compiler: str) -> Check:
    """One compiler, in double and in single precision, by C99 and C11."""

    def look(bench: Bench) -> tuple[str, Json, list[str]]:
        found: list[str] = []
        runs = 0
        for standard in STANDARDS:
            for bits in (64, 32):
                flags = [f"-std={standard}", "-O2", *COMMON, *OWN[compiler], *subject.single(bits)]
                for source in subject.sources:
                    done = bench.call(compiler, *flags, "-c", source, "-o", "warned.o")
                    runs += 1
                    if done.returncode:
                        found += messages(done.stderr) or [f"{source}: {compiler} ended with {done.returncode}"]
        return f"{len(found)} warnings in {runs} compilations", {"compilations": runs, "warnings": len(found)}, found

    asks = "no warning at all in double and single precision, C99 and C11"
    return judged(f"warnings_{compiler}", asks, [compiler], bench, subject.texts, look)
