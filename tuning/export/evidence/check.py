"""What a check of the evidence is, and how the tools that it needs are called."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from ...io.files import Json

PASSED, FAILED, NOT_RUN = "passed", "failed", "not run"
LONGEST = 1200.0  # s that one call of a tool may take


class Check(NamedTuple):
    """One check and what came of it."""

    name: str
    asks: str  # what has to hold
    verdict: str  # PASSED, FAILED or NOT_RUN
    says: str  # what was found, in a line
    tools: dict[str, str]  # by name the version
    commands: tuple[str, ...]
    figures: Json
    findings: tuple[str, ...]  # what keeps it from passing
    files: dict[str, str]  # that were looked at, with their SHA-256

    def plain(self) -> Json:
        """For JSON."""
        return {key: list(x) if isinstance(x, tuple) else x for key, x in self._asdict().items()}


class Bench(NamedTuple):
    """A folder with the exported files, where tools are called and remembered."""

    folder: Path
    commands: list[str]

    def call(self, *command: str, most: float = LONGEST) -> subprocess.CompletedProcess[str]:
        """A tool in the folder, remembered as a command; one that takes too long ends with 124."""
        self.commands.append(" ".join(command))
        try:
            return subprocess.run(
                command,
                cwd=self.folder,
                capture_output=True,
                text=True,
                check=False,
                timeout=most,
                errors="replace",
                env=os.environ | {"LC_ALL": "C"},  # tools are to speak English
            )
        except subprocess.TimeoutExpired:
            return subprocess.CompletedProcess(command, 124, "", f"{command[0]} was stopped after {most:g} s")

    def fresh(self, *more: str) -> Bench:
        """A folder of its own inside, with copies of the exported files."""
        made = self.folder / "-".join(more)
        made.mkdir(exist_ok=True)
        for file in self.folder.iterdir():
            if file.is_file():
                shutil.copy2(file, made / file.name)
        return Bench(made, self.commands)


def version(tool: str) -> str:
    """The first line of what a tool says of its version."""
    done = subprocess.run([tool, "--version"], capture_output=True, text=True, check=False)
    return (done.stdout or done.stderr).strip().partition("\n")[0]


def judged(
    name: str,
    asks: str,
    needs: Sequence[str],
    bench: Bench,
    files: Mapping[str, str],
    look: Callable[[Bench], tuple[str, Json, list[str]]],
) -> Check:
    """A check by what `look` says, finds and objects to; not run, and said so, where a tool is missing.

    Args:
        name: of the check.
        asks: what has to hold.
        needs: tools by the names of their programs.
        bench: where they are called.
        files: that are looked at, names and contents.
        look: a line, figures, objections; none is a pass.
    """
    hashes = {file: hashlib.sha256(text.encode()).hexdigest() for file, text in files.items()}
    if absent := [tool for tool in needs if shutil.which(tool) is None]:
        says = f"not run: {', '.join(absent)} not found"
        return Check(name, asks, NOT_RUN, says, {}, (), {}, (), hashes)
    own = Bench(bench.folder, [])
    says, figures, objections = look(own)
    objections = objections + ["no file was looked at"] * (not files)
    verdict = FAILED if objections else PASSED
    tools = {tool: version(tool) for tool in needs}
    return Check(name, asks, verdict, says, tools, tuple(own.commands), figures, tuple(objections), hashes)
