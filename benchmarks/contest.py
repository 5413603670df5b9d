"""Who takes part beside agvjax, and how JAX is started for it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

PEERS = {"numpy": "numpy_batch", "numba": "numba_loop", "scipy": "scipy_ivp", "diffrax": "diffrax_loop"}
PEERS |= {"casadi": "casadi_loop", "c": "c_loop"}


def jax_ready(job: dict[str, Any]) -> Callable[[Any], Any]:
    """Start JAX as the job wants it: compiler options, precision. Returns what waits for a result."""
    import agvjax

    if job.get("flags", "fast") != "default":
        print(agvjax.tune_xla(reverse=job.get("flags") == "reverse", devices=job.get("threads", 1)), file=sys.stderr)
    import jax

    jax.config.update("jax_enable_x64", job.get("dtype", "float32") == "float64")
    return jax.block_until_ready
