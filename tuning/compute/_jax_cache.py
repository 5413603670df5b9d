"""What JAX compiles, kept by us: its own files carry no checksum, and it never replaces one that is damaged.

JAX has no public way to say where compiled programs are kept but a folder; what is used here was tried with 0.8.0,
0.10.1 and 0.12.0.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator
from pathlib import Path

from jax._src import compilation_cache
from jax._src.compilation_cache_interface import CacheInterface
from jax._src.export import _export

from .kept import Kept


class _Programs(CacheInterface):
    """Compiled programs by the key of JAX."""

    def __init__(self, kept: Kept, path: str):
        self.kept, self._path = kept, Path(path)

    def get(self, key: str) -> bytes | None:  # pyright: ignore[reportIncompatibleMethodOverride] of JAX: no return type
        """The program of a key; None where it is to be compiled."""
        return self.kept.get(f"{key}.bin")

    def put(self, key: str, value: bytes) -> None:
        """Keep a program, in place of one that was of no use."""
        self.kept.put(f"{key}.bin", value)


def let_jax_keep(kept: Kept) -> None:
    """From now on JAX keeps its programs there, whatever it compiled before."""
    compilation_cache.get_file_cache = lambda path: (_Programs(kept, path), path)
    compilation_cache.reset_cache()


class _Thread(threading.local):
    plain = False  # whether it lowers what calls nothing of LAPACK


_THREAD = _Thread()
_LOADS_LAPACK = _export._ensure_backends_initialized


def _backends(platforms: tuple[str, ...]) -> None:
    if not _THREAD.plain:
        _LOADS_LAPACK(platforms)


@contextlib.contextmanager
def without_lapack() -> Iterator[None]:
    """Lower exported programs without `scipy.linalg`, which JAX imports for any: half of what loading one takes.

    For those that call nothing of LAPACK; JAX loads it by itself for all that it lowers from its own operations.
    """
    _export._ensure_backends_initialized, _THREAD.plain = _backends, True
    try:
        yield
    finally:
        _THREAD.plain = False
