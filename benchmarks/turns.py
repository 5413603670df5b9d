"""Contestants in processes of their own that take turns, so that a noisy machine slows all of them alike.

What counts is the median of the ratios of neighbouring runs; compiler options and threads belong to a process.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
from collections.abc import Mapping
from typing import Any


class Contestant:
    """A worker that has compiled its job and runs it when told."""

    def __init__(self, job: Mapping[str, Any]):
        self.job = dict(job)
        environment = {**os.environ, "JAX_PLATFORMS": "cpu", "JAX_NUM_CPU_DEVICES": str(job.get("threads", 1))}
        environment |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, "-m", "benchmarks.worker", json.dumps(self.job)]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, env=environment, text=True)
        self.facts = self._read()

    def _read(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(f"{self.job} ended with exit code {self.process.wait()}")
        return json.loads(line)

    def turn(self) -> float:
        """Seconds of one run."""
        assert self.process.stdin is not None
        self.process.stdin.write("go\n")
        self.process.stdin.flush()
        return self._read()["seconds"]

    def end(self) -> None:
        """Let the process go."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait()


def take_turns(jobs: Mapping[str, Mapping[str, Any]], turns: int) -> dict[str, dict[str, Any]]:
    """Facts and seconds of every job; one that cannot run is left out, with the reason said."""
    running: dict[str, Contestant] = {}
    for name, job in jobs.items():
        try:
            running[name] = Contestant(job)
        except RuntimeError as error:
            print(f"left out: {error}", file=sys.stderr)
    seconds: dict[str, list[float]] = {name: [] for name in running}
    for _ in range(turns):
        for name, contestant in running.items():
            seconds[name].append(contestant.turn())
    for contestant in running.values():
        contestant.end()
    return {name: {**running[name].facts, "seconds": seconds[name]} for name in running}


def ratio(slow: Mapping[str, Any], fast: Mapping[str, Any]) -> tuple[float, float, float]:
    """How many times the work per second of `slow` does `fast` do: median, smallest, largest of neighbouring runs."""
    each = sorted(
        (fast["work"] / f) / (slow["work"] / s) for s, f in zip(slow["seconds"], fast["seconds"], strict=True)
    )
    return statistics.median(each), each[0], each[-1]


def rate(result: Mapping[str, Any]) -> float:
    """Median work per second."""
    return result["work"] / statistics.median(result["seconds"])
