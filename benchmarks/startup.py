"""From the command to the first thing a person sees."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from typing import Any

CLI = [sys.executable, "-m", "tuning.cli"]


def _seconds(command: list[str], environment: dict[str, str], until: str = "") -> float:
    """Until the command ends, or until it has shown `until` on the error stream, where the progress bar is."""
    begin = time.perf_counter()
    process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    assert process.stderr is not None
    shown = b""
    while chunk := os.read(process.stderr.fileno(), 4096):
        shown += chunk
        if until and until.encode() in shown:
            process.kill()
            break
    process.wait()
    return time.perf_counter() - begin


def measure(turns: int) -> list[dict[str, Any]]:
    """Help, import, and the first iteration of `agvjax tune` on a first and on a later start."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "XDG_CACHE_HOME": folder, "JAX_PLATFORMS": "cpu"}

        def tune(number: int) -> float:
            return _seconds([*CLI, "tune", "--out", f"{folder}/run{number}"], environment, until="| 1/")

        rows.append({"what": "agvjax tune, first start, first iteration", "seconds": tune(0)})
        again = statistics.median(tune(1 + i) for i in range(turns))
        rows.append({"what": "agvjax tune, later start, first iteration", "seconds": again})
        for what, command in (
            ("agvjax --help", [*CLI, "--help"]),
            ("import agvjax", [sys.executable, "-c", "import agvjax"]),
        ):
            middle = statistics.median(_seconds(command, environment) for _ in range(turns))
            rows.append({"what": what, "seconds": middle})
    return rows
