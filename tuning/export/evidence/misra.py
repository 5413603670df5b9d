"""The rules of MISRA C:2012 as cppcheck's addon checks them. Their texts are not free: numbers and categories alone."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

from ...io.files import Json
from .check import Bench, Check, judged
from .harness import Subject

MANDATORY = frozenset("9.1 12.5 13.6 17.3 17.4 17.6 19.1 21.13 21.17 21.18 21.19 21.20 22.2 22.4 22.5 22.6".split())
ADVISORY = frozenset(
    "1.2 2.3 2.4 2.5 2.6 2.7 4.2 5.9 8.7 8.9 8.11 8.13 10.5 11.4 11.5 12.1 12.3 12.4 13.3 13.4 15.1 15.4 15.5 17.5 17.8"
    " 18.4 18.5 19.2 20.1 20.5 20.10 21.12".split()
)
SECTIONS = (4, 7, 2, 2, 9, 2, 4, 14, 5, 8, 9, 5, 6, 4, 7, 7, 8, 8, 2, 14, 21, 10)  # how many rules each has
RULES = [f"{section}.{rule}" for section, count in enumerate(SECTIONS, 1) for rule in range(1, count + 1)]
DEVIATIONS = {  # rule -> why the exported code breaks it
    "2.5": "macros of the header (period, words of the status) are for the program that includes it",
    "20.10": "one ## chooses between sin and sinf, so that double and single precision are one source",
}
LONGEST = 3600.0  # s; the time that cppcheck takes grows with the square of the length of a function
PROBE = "int probe(int a);\nint probe(int a)\n{\n    if (a > 0) return 1;\n    return 0;\n}\n"  # breaks 15.5
UNSET = ("__cplusplus", "__FAST_MATH__", "_M_FP_FAST", "__FINITE_MATH_ONLY__")
TEMPLATE = "--template={file}:{line}:{severity}:{id}:{message}"


def category(rule: str) -> str:
    """Of a rule: mandatory, required or advisory."""
    return "mandatory" if rule in MANDATORY else "advisory" if rule in ADVISORY else "required"


def check(subject: Subject, bench: Bench) -> Check:
    """In double and in single precision, with what cppcheck itself objects to."""

    def look(bench: Bench) -> tuple[str, Json, list[str]]:
        (bench.folder / "probe.c").write_text(PROBE)
        if "misra-c2012-15.5" not in _said(bench, [], ["probe.c"]):
            return "the addon does not work", {}, ["cppcheck's addon says nothing of a file that breaks a rule"]
        single = f"{subject.upper}_FLOAT"
        text = "".join(_said(bench, [flag], subject.sources) for flag in (f"-U{single}", f"-D{single}"))
        return judgement(text)

    files = {file: text for file, text in subject.texts.items() if file.endswith((".c", ".h"))}
    return judged("misra", ASKS, ["cppcheck"], bench, files, look)


ASKS = "no rule of MISRA C:2012 is broken, mandatory, required or advisory, that is not justified rule by rule"


def judgement(text: str) -> tuple[str, Json, list[str]]:
    """Of what cppcheck said: each rule with its category and how often it is broken, and what nothing justifies."""
    lines = sorted({line for line in text.splitlines() if re.match(r"[\w.]+:\d+:\w+:", line)})
    broken = Counter(rule for line in lines for rule in re.findall(r":misra-c2012-([\d.]+):", line))
    own = [line for line in lines if ":misra-" not in line and ":information:" not in line]
    found = [line for line in lines for rule in re.findall(r":misra-c2012-([\d.]+):", line) if rule not in DEVIATIONS]
    known = checked()
    rules = [
        {
            "rule": rule,
            "category": category(rule),
            "checked": rule in known if known else None,
            "violations": broken[rule],
            "justified": DEVIATIONS.get(rule, "") if broken[rule] else "",
        }
        for rule in sorted({*RULES, *broken}, key=lambda rule: [int(part) for part in rule.split(".")])
    ]
    counts = {f"unjustified_{kind}": 0 for kind in ("mandatory", "required", "advisory")}
    for rule, times in broken.items():
        counts[f"unjustified_{category(rule)}"] += times * (rule not in DEVIATIONS)
    justified = sum(times for rule, times in broken.items() if rule in DEVIATIONS)
    counts |= {"justified": justified, "rules_checked": len(known), "rules": len(rules), "cppcheck": len(own)}
    said = ", ".join(f"{counts[f'unjustified_{kind}']} {kind}" for kind in ("mandatory", "required", "advisory"))
    line = f"not justified: {said}; justified: {justified}; rules that the addon checks: {len(known) or 'not known'}"
    return line, counts | {"each": rules}, found + own


def _said(bench: Bench, flags: list[str], sources: list[str]) -> str:
    unset = [f"-U{macro}" for macro in UNSET]
    asked = ["--addon=misra", "--std=c99", "--enable=warning,style,performance,portability", "--quiet"]
    done = bench.call(
        "cppcheck", *asked, "--suppress=missingIncludeSystem", *unset, *flags, TEMPLATE, *sources, most=LONGEST
    )
    return f"{done.stdout}{done.stderr}\n" + (
        f"cppcheck:0:error:ended:with {done.returncode}\n" if done.returncode else ""
    )


def checked() -> frozenset[str]:
    """The rules that the addon has code for; none where its file is not where systems put it."""
    places = [Path("/usr/share/cppcheck/addons"), *Path("/usr/lib").glob("*/cppcheck/addons")]
    for file in (place / "misra.py" for place in places):
        if file.is_file():
            found = re.findall(r"def misra_(\d+)_(\d+)\(", file.read_text(encoding="utf-8", errors="replace"))
            return frozenset(".".join(pair) for pair in found)
    return frozenset()
