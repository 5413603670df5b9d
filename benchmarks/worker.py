"""One contestant: reads its job from the command line, prepares, then runs once for each line of input."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

PEERS = {"numpy": "numpy_batch", "numba": "numba_loop", "scipy": "scipy_ivp", "diffrax": "diffrax_loop"}
PEERS |= {"casadi": "casadi_loop", "c": "c_loop"}


def main() -> None:
    """Pin, prepare, say what was prepared, serve."""
    job = json.loads(sys.argv[1])
    if hasattr(os, "sched_setaffinity"):  # elsewhere libraries may use more threads than they are told
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: job.get("threads", 1)])
    begin = time.perf_counter()
    if job["kind"] == "rollout":
        from . import rollout as part
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


def jax_ready(job: dict[str, Any]) -> Callable[[Any], Any]:
    """Start JAX as the job wants it: compiler options, precision. Returns what waits for a result."""
    import agvjax

    if job.get("flags", "fast") != "default":
        print(agvjax.tune_xla(reverse=job.get("flags") == "reverse", devices=job.get("threads", 1)), file=sys.stderr)
    import jax

    jax.config.update("jax_enable_x64", job.get("dtype", "float32") == "float64")
    return jax.block_until_ready


if __name__ == "__main__":
    main()
