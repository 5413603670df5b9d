"""A second start that neither traces nor compiles: both are kept on disk, keyed by everything they depend on."""

from __future__ import annotations

import hashlib
import importlib.metadata
import os
import platform
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax import export

import agvjax

from ..io import files

_POOL = ThreadPoolExecutor(2)  # compilers run without Python's lock


def folder() -> Path:
    """Where they are kept: `agvjax` under XDG_CACHE_HOME or ~/.cache. Safe to delete."""
    return Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")) / "agvjax"


def keep_compiled() -> None:
    """Let JAX keep what it compiles, however quickly it was compiled; apart for each kind of processor."""
    jax.config.update("jax_compilation_cache_dir", str(folder() / f"xla-{_machine()}"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


def traced(function: Callable[..., Any], settings: str, *example: Any) -> Callable[..., Any]:
    """`function` compiled, its trace taken from disk if the same code traced it before for the same settings.

    Args:
        function: what to compile; its result must depend on its arguments and on `settings` alone.
        settings: all that shapes the trace besides the code and the versions of the libraries.
        example: arguments of the right shapes and dtypes.
    """
    path = folder() / "traces" / f"{_key(settings)}.bin"
    if path.exists():
        try:
            return _committed(export.deserialize(bytearray(path.read_bytes())), example)
        except Exception:  # damaged, or of a build that only looks the same: trace again
            path.unlink(missing_ok=True)
    module = export.export(jax.jit(function))(*example)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        files.write(path, bytes(module.serialize()))
    except OSError:  # no place to keep it: the next start traces again
        pass
    return _committed(module, example)


class Ahead:
    """A function that is being made ready in the background; whoever calls it first waits for it."""

    def __init__(self, function: Callable[..., Any], settings: str, *example: Any, after: Ahead | None = None):
        """As `traced`; `after` goes first, undisturbed."""

        def make() -> Callable[..., Any]:
            if after is not None:
                after.made.result()
            return traced(function, settings, *example)

        self.made = _POOL.submit(make)

    def __call__(self, *arguments: Any) -> Any:
        """What the function returns."""
        return self.made.result()(*arguments)


def meanwhile(function: Callable[..., Any], *arguments: Any) -> None:
    """Call a function in the background after all that, for the sake of what it compiles."""
    _POOL.submit(function, *arguments)


def _machine() -> str:
    """Of this processor: what was compiled for another may not run on it, and a home may be shared by both."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        told = sorted({line for line in lines if line.startswith(("model name", "flags", "Features", "CPU part"))})
    except OSError:
        told = [platform.processor()]
    return hashlib.sha256(repr((platform.machine(), told)).encode()).hexdigest()[:8]


def _committed(module: export.Exported, example: tuple[Any, ...]) -> Callable[..., Any]:
    """Compiled. What was exported for several devices needs its arguments on all; what comes back is on the first."""
    devices = jax.local_devices()[: module.nr_devices]
    mesh = jax.sharding.Mesh(np.array(devices), ("scenarios",))
    everywhere = jax.sharding.NamedSharding(mesh, jax.sharding.PartitionSpec())
    call = jax.jit(module.call).lower(*jax.device_put(example, everywhere)).compile()
    return lambda *arguments: jax.device_put(call(*jax.device_put(arguments, everywhere)), devices[0])


def _key(settings: str) -> str:
    digest = hashlib.sha256()
    for package in (Path(agvjax.__file__).parent, Path(__file__).parents[1]):
        for source in sorted(package.rglob("*.py")):
            digest.update(source.read_bytes())
    versions = [importlib.metadata.version(name) for name in ("jax", "jaxlib", "optax")]
    state = (versions, os.environ.get("XLA_FLAGS"), str(jax.numpy.result_type(float)), settings)
    digest.update(repr((*state, jax.default_backend(), jax.local_device_count())).encode())
    return digest.hexdigest()[:32]
