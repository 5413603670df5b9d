"""Long jobs two at a time, in threads: most of their time is compilation, on one core each."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")
WORKERS = 2
ENDING = "stopping: what is under way ends first, and is kept where the command has --resume"


def in_pairs(job: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """The results in order. Ctrl-C lets the jobs under way end, says so, and begins no other."""
    with ThreadPoolExecutor(WORKERS) as pool:
        try:
            return list(pool.map(job, items))
        except KeyboardInterrupt:
            print(ENDING, file=sys.stderr, flush=True)
            raise
