"""Preloaded by the workers that a command starts on this machine: Ctrl-C, which a terminal sends to all, is its own."""

import signal


def dask_setup(worker: object) -> None:
    """Called by Dask when a worker begins, in the main thread of its process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
