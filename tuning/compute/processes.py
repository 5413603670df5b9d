"""Tuning on several machines: every process runs the same program, and `evaluate` shares the scenarios among them.

Arguments of what they compute together must be NumPy arrays, the same in every process; so are the results.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import jax
import numpy as np
from jaxtyping import PyTree

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
    """Whether other processes compute with this one."""
    return jax.distributed.is_initialized() and jax.process_count() > 1


def chief() -> bool:
    """Whether this is the process that prints and writes: the first, or the only one."""
    return not joined() or jax.process_index() == 0


def gathered(compute: Callable[..., PyTree]) -> Callable[..., PyTree]:
    """A jitted function whose result is on one device of every process, however many devices computed it."""

    def call(*arguments: PyTree) -> PyTree:
        if not joined():
            return jax.device_put(compute(*arguments), jax.local_devices()[0])
        return jax.tree.map(np.asarray, compute(*jax.tree.map(np.asarray, arguments)))

    return call


@contextlib.contextmanager
def folder(make: Callable[[], Path], shared: str) -> Iterator[Path]:
    """The folder to write to: `make` makes that of the first process; the others have one that is deleted again.

    The file of the first process named `shared` is copied to the others, if it is there.
    """
    if chief():
        out = make()
        _share(out / shared)
        yield out
        return
    with tempfile.TemporaryDirectory(prefix="agvjax-") as name:
        _share(Path(name) / shared)
        yield Path(name)


def _share(path: Path) -> None:
    """Copy a file of the first process to all others."""
    if not joined():
        return
    from jax.experimental import multihost_utils  # late: few need it

    data = np.frombuffer(path.read_bytes() if chief() and path.exists() else b"", np.uint8)
    size = int(multihost_utils.broadcast_one_to_all(np.int64(data.size)))
    if size:
        whole = multihost_utils.broadcast_one_to_all(data if chief() else np.zeros(size, np.uint8))
        if not chief():
            path.write_bytes(np.asarray(whole, np.uint8).tobytes())
