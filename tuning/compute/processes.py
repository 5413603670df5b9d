"""Tuning on several machines: every process runs the same program, and `evaluate` shares the scenarios among them.

Arguments of what they compute together must be NumPy arrays, the same in every process; so are the results.
"""

from __future__ import annotations

import contextlib
import socket
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import jax
import numpy as np
from jaxtyping import PyTree

MEETING = 120  # s that processes wait for each other before the first computation
HEARTBEAT = 20  # s without a sign of life after which a process is given up, and with it the run

_MEETINGS: list[threading.Thread] = []


def join(coordinator: str | None, count: int | None, rank: int | None) -> None:
    """Meet the other processes, before JAX is first used.

    JAX would wait in silence and then abort the process where they do not come: it waits in a thread of its own, which
    `entangled` then says of.

    Args:
        coordinator: `host:port` of process 0; "auto" for what JAX finds out from SLURM, Open MPI or Kubernetes.
        count: number of processes; None where JAX finds it out.
        rank: which of them this is, from 0; None where JAX finds it out.

    Raises:
        RuntimeError, ValueError: they did not meet within MEETING, or JAX cannot find out what is not given.
        OSError: another program of this machine has the port.
    """
    address = None if coordinator == "auto" else coordinator
    if rank == 0 and address is not None:
        _try(int(address.rpartition(":")[2]))
    failures: list[Exception] = []

    def meet() -> None:
        try:
            long = 100 * MEETING  # JAX ends the process then
            jax.distributed.initialize(
                address, count, rank, initialization_timeout=long, heartbeat_timeout_seconds=HEARTBEAT
            )
        except Exception as error:  # raised where it is waited for
            failures.append(error)

    thread = threading.Thread(target=meet, daemon=True)
    _MEETINGS.append(thread)
    thread.start()
    thread.join(MEETING)
    if thread.is_alive():
        raise RuntimeError(f"not all of them were there within {MEETING} s")
    if failures:
        raise failures[0]


def _try(port: int) -> None:
    """Listen at a port, as JAX will: where another does, JAX crashes."""
    family = socket.AF_INET6 if socket.has_ipv6 else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as place:
        place.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        place.bind(("", port))
        place.listen()


def joined() -> bool:
    """Whether other processes compute with this one."""
    return jax.distributed.is_initialized() and jax.process_count() > 1


def entangled() -> bool:
    """Whether other processes were met or waited for, so that JAX would wait for them when this one ends."""
    return bool(_MEETINGS)


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
