"""One contestant: reads its job from the command line, prepares, then runs once for each line of input."""

from __future__ import annotations

import json
import os
import sys
import time
from typing import Any

import numpy as np


def main() -> None:
    """Pin, prepare, say what was prepared, serve."""
    job = json.loads(sys.argv[1])
    if hasattr(os, "sched_setaffinity"):  # elsewhere libraries may use more threads than they are told
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: job.get("threads", 1)])
    begin = time.perf_counter()
    if job["kind"] == "rollout":
        from . import rollout as part
    elif job["kind"] == "following":
        from . import following as part
    elif job["kind"] == "sweep":
        from . import sweep as part
    else:
        from . import gradient as part
    run = part.prepare(job)
    first = run()
    facts = {"ready_s": time.perf_counter() - begin, "work": part.work(job), "value": summary(first)}
    print(json.dumps(facts), flush=True)
    for _ in sys.stdin:
        start = time.perf_counter()
        run()
        print(json.dumps({"seconds": time.perf_counter() - start}), flush=True)


def summary(result: Any) -> float:
    """One number to see that all did the same."""
    return float(np.sqrt(np.mean(np.asarray(result, float) ** 2)))


if __name__ == "__main__":
    main()
