"""The evidence as a page: what passed, what did not and what was not run; the trace; each check with its figures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ...io.pages import grid, publish
from ..artefact import plain
from .check import FAILED, NOT_RUN, PASSED, Check
from .harness import Subject
from .misra import DEVIATIONS, category
from .trace import Trace

RULES, COMMANDS, HASHES = "Each rule", "The commands", "The files"
SHOWN = 20  # findings of a check, at most
LIMITS = """
What it is: checks that tools ran on these files on this day. What it is not: a proof, or a statement by anybody else.
The number of instructions is the largest that was seen on these rows, on this processor, and no bound. Branches are
covered, not each combination of conditions. The target is QEMU's, not a board.
"""


def write(folder: Path, subject: Subject, checks: Sequence[Check], traced: Sequence[Trace]) -> None:
    """`report.md` and `report.html`."""
    facts = subject.artefact.provenance
    title = f"# Evidence: {subject.name}, {facts['law'][-1]} for a {facts['vehicle']}"
    source = f"Gains of `{plain(facts['source'])}`, configuration SHA-256 `{facts['configuration_sha256']}`."
    parts = [plain(title), f"**{verdict(checks)}**", source, LIMITS.strip(), "## The checks", _checks(checks)]
    parts += ["## From requirement to check", _traces(traced)]
    for check in checks:
        if check.findings:
            parts += [f"## Found by {check.name}", _list(check.findings)]
    rules = [check for check in checks if "each" in check.figures]
    if rules:
        parts += [f"## {RULES}", _rules(rules[0])]
    parts += [f"## {HASHES}", _files(checks), f"## {COMMANDS}", _commands(checks)]
    publish(folder, "\n\n".join(parts), (RULES, COMMANDS, HASHES))


def verdict(checks: Sequence[Check]) -> str:
    """In a sentence or two."""
    names = {kind: [check.name for check in checks if check.verdict == kind] for kind in (PASSED, FAILED, NOT_RUN)}
    said = [f"{len(names[PASSED])} of {len(checks)} checks passed"]
    said += [f"{len(names[FAILED])} failed: {', '.join(names[FAILED])}"] * bool(names[FAILED])
    said += [f"{len(names[NOT_RUN])} not run: {', '.join(names[NOT_RUN])}"] * bool(names[NOT_RUN])
    return "; ".join(said) + "."


def _checks(checks: Sequence[Check]) -> str:
    lines = [(c.name, c.verdict, plain(c.asks), plain(c.says), plain("; ".join(c.tools.values()))) for c in checks]
    return grid(["check", "result", "what has to hold", "what was found", "by"], lines)


def _traces(traced: Sequence[Trace]) -> str:
    lines = []
    for one in traced:
        gains = ", ".join(f"{name} = {value}" for name, value in one.gains.items()) or "-"
        lines.append((one.requirement, one.asked, plain(gains), f"{one.file} {one.sha256[:12]}", one.result or "-"))
    return grid(["requirement", "goal, limit or promise", "gains", "file, SHA-256", "checks"], lines)


def _rules(check: Check) -> str:
    lines = []
    for rule in check.figures["each"]:
        seen = {True: "yes", False: "no", None: "not known"}[rule["checked"]]
        lines.append((rule["rule"], rule["category"], seen, rule["violations"], plain(rule["justified"])))
    said = (
        "Numbers and categories of MISRA C:2012; the texts of the rules are the publisher's. Deviations that are known:"
    )
    known = [f"* {rule} ({category(rule)}): {why}" for rule, why in DEVIATIONS.items()]
    table = grid(["rule", "category", "checked by the addon", "violations", "why they stay"], lines)
    return "\n\n".join([said, "\n".join(known), table])


def _files(checks: Sequence[Check]) -> str:
    files = {file: sha for check in checks for file, sha in check.files.items()}
    return grid(["file", "SHA-256"], sorted(files.items()))


def _commands(checks: Sequence[Check]) -> str:
    lines = [f"* {check.name}: `{plain(command)}`" for check in checks for command in check.commands]
    return "In a folder with the exported files and the program that runs the rows on them.\n\n" + "\n".join(lines)


def _list(findings: Sequence[str]) -> str:
    lines = [f"* `{plain(finding)}`" for finding in findings[:SHOWN]]
    return "\n".join(lines + [f"* and {len(findings) - SHOWN} more"] * (len(findings) > SHOWN))
