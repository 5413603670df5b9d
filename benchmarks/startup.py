"""From the command to the first thing a person sees."""

from __future__ import annotations

import itertools
import os
import statistics
import subprocess
import sys
import tempfile
import time
from typing import Any

CLI = [sys.executable, "-m", "tuning.cli"]


def _seconds(command: list[str], environment: dict[str, str], until: str = "") -> tuple[float, float]:
    """Time, and time of processors, until a command ends or has shown `until` on the error stream, where phases are."""
    begin = time.perf_counter()
    process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    assert process.stderr is not None
    shown = b""
    while chunk := os.read(process.stderr.fileno(), 4096):
        shown += chunk
        if until and until.encode() in shown:
            process.kill()
            break
    _, _, used = os.wait4(process.pid, 0)
    process.returncode = 0  # it is gone: nobody else has to wait for it
    return time.perf_counter() - begin, used.ru_utime + used.ru_stime


def measure(turns: int) -> list[dict[str, Any]]:
    """Help, imports, `agvjax simulate`; `agvjax tune` to its first iteration and to its end. Medians of `turns`."""
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "XDG_CACHE_HOME": folder, "JAX_PLATFORMS": "cpu"}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # with it every start compiles all of Python's modules anew
        number = itertools.count()

        def add(what: str, command: list[str], count: int, until: str = "") -> None:
            runs = [_seconds([x.format(next(number)) for x in command], environment, until) for _ in range(count)]
            wall, used = (statistics.median(column) for column in zip(*runs, strict=True))
            rows.append({"what": what, "seconds": wall, "processor_seconds": used})

        tune, simulate = ([*CLI, name, "--out", f"{folder}/run{{}}"] for name in ("tune", "simulate"))
        first = "tuning ..."  # the phase that begins with the first iteration
        add("agvjax tune, first start, first iteration", tune, 1, first)
        add("agvjax tune, first start, the rest compiled", tune, 1)
        add("agvjax tune, later start, first iteration", tune, turns, first)
        add("agvjax tune, later start, all of it", tune, turns)
        add("agvjax simulate, first start", simulate, 1)
        add("agvjax simulate, later start", simulate, turns)
        add("agvjax --help", [*CLI, "--help"], turns)
        add("agvjax tune --help", [*CLI, "tune", "--help"], turns)
        add("import jax", [sys.executable, "-c", "import jax"], turns)
        add("import agvjax", [sys.executable, "-c", "import agvjax"], turns)
    return rows
