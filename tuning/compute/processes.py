"""Tuning on several machines: every process runs the same program, `evaluate` shares the scenarios between them all.

Numbers that go into what all processes compute must be the same in each, and on the host; what comes out is too.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np

HEARTBEAT = 20  # s without a sign of life after which a process is given up, and with it the run


def join(coordinator: str | None, count: int | None, rank: int | None) -> None:
    """Meet the other processes, before JAX is first used.

    Args:
        coordinator: `host:port` of process 0; "auto" for what JAX finds out from SLURM, Open MPI or Kubernetes.
        count: number of processes; None where JAX finds it out.
        rank: which of them this is, from 0; None where JAX finds it out.

    Raises:
        RuntimeError, ValueError: they did not meet, or JAX cannot find out what is not given.
    """
    address = None if coordinator == "auto" else coordinator
    jax.distributed.initialize(address, count, rank, heartbeat_timeout_seconds=HEARTBEAT)


def joined() -> bool:
    """Whether there are other processes."""
    return jax.distributed.is_initialized() and jax.process_count() > 1


def chief() -> bool:
    """Whether this process speaks and writes for all."""
    return not joined() or jax.process_index() == 0


def gathered(compute: Callable[..., Any]) -> Callable[..., Any]:
    """A jitted function whose result is at hand in every process, on one device, however many took part."""

    def call(*arguments: Any) -> Any:
        if not joined():
            return jax.device_put(compute(*arguments), jax.local_devices()[0])
        return jax.tree.map(np.asarray, compute(*jax.tree.map(np.asarray, arguments)))

    return call


def share(path: Path) -> None:
    """Give every process the chief's file of this name, or none if the chief has none."""
    if not joined():
        return
    from jax.experimental import multihost_utils

    data = np.frombuffer(path.read_bytes() if chief() and path.exists() else b"", np.uint8)
    size = int(multihost_utils.broadcast_one_to_all(np.int64(data.size)))
    if size:
        whole = multihost_utils.broadcast_one_to_all(data if chief() else np.zeros(size, np.uint8))
        if not chief():
            path.write_bytes(np.asarray(whole, np.uint8).tobytes())


def own_folder() -> tempfile.TemporaryDirectory[str]:
    """Where a process that is not the chief writes what nobody will read."""
    return tempfile.TemporaryDirectory(prefix="agvjax-")
