"""Traces and compiled programs are kept on disk, so that a second start is fast; the key is all that they depend on."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.metadata
import os
import platform
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Generic, TypeVar

import jax
import numpy as np
from jax import export
from jaxtyping import PyTree

import agvjax
from agvjax.engine.xla import cache_folder
from agvjax.metric_table import Followed

from .kept import Kept, private

T = TypeVar("T")
for _results in (agvjax.Metrics, Followed):  # what is traced may return besides arrays, tuples and dictionaries
    export.register_pytree_node_serialization(
        _results,
        serialized_name=f"agvjax.{_results.__name__}",
        serialize_auxdata=lambda static: b"",
        deserialize_auxdata=lambda data: (),
    )


class _Notes:
    """What a user should know of the places; each text once, and those that come early when somebody listens."""

    def __init__(self) -> None:
        self.texts: dict[str, bool] = {}  # whether it was told
        self.listener: Callable[[str], None] | None = None

    def say(self, text: str) -> None:
        self.texts.setdefault(text, False)
        if self.listener is not None and not self.texts[text]:
            self.texts[text] = True
            self.listener(text)


_NOTES = _Notes()


def listen(note: Callable[[str], None]) -> None:
    """Tell `note`, once, of a place that cannot be used, and of files there that were damaged."""
    _NOTES.listener = note
    for text in list(_NOTES.texts):
        _NOTES.say(text)


@functools.cache
def _traces() -> Kept:
    return _kept("traces")


def keep_compiled() -> None:
    """Let JAX keep what it compiles, even if that took no time; in a folder for each kind of processor."""
    kept = _kept(f"programs-{_machine()}")
    jax.config.update("jax_compilation_cache_dir", None if kept.folder is None else str(kept.folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    with contextlib.suppress(ImportError, AttributeError):  # of another release, JAX keeps them by itself
        from ._jax_cache import let_jax_keep

        let_jax_keep(kept)


def _kept(name: str) -> Kept:
    """A folder of this name, or none where it would not be safe."""
    root = cache_folder()
    why = "there is no home folder, and XDG_CACHE_HOME is not set" if root is None else private(root, name)
    if why:
        _NOTES.say(f"compiled programs are not kept, every start compiles again: {why}")
    return Kept(None if root is None or why else root / name, _NOTES.say)


def traced(function: Callable[..., T], settings: str, *example: PyTree) -> Callable[..., T]:
    """`function` compiled, its trace taken from disk if the same code traced it before for the same settings.

    Args:
        function: what to compile; its result must depend on its arguments and on `settings` alone.
        settings: all that shapes the trace besides the code and the versions of the libraries.
        example: arguments of the right shapes and dtypes.
    """
    name = f"{_key(settings)}.bin"
    trace = _traces().get(name)
    if trace is not None:
        try:
            return _committed(export.deserialize(bytearray(trace)), example)
        except Exception:  # of a build that only looks the same: trace again
            _traces().drop(name)
    module = export.export(jax.jit(function))(*example)
    _traces().put(name, bytes(module.serialize()))
    return _committed(module, example)


class Ahead(Generic[T]):
    """A function that is compiled in the background; the first call waits until it is ready."""

    def __init__(self, function: Callable[..., T], settings: str, *example: PyTree, after: Ahead[PyTree] | None = None):
        """As `traced`, begun when `after` is ready."""

        def make() -> Callable[..., T]:
            if after is not None:
                after.ready.result()
            return traced(function, settings, *example)

        self.ready = _pool().submit(make)

    def __call__(self, *arguments: PyTree) -> T:
        """Call the compiled function."""
        return self.ready.result()(*arguments)


def meanwhile(function: Callable[..., object], *arguments: PyTree) -> None:
    """Call a function in the background, after all that is compiled there, so that what it compiles is ready too."""
    _pool().submit(function, *arguments)


@functools.cache
def _pool() -> ThreadPoolExecutor:
    """Two threads, made when first used: compilers run without Python's lock."""
    return ThreadPoolExecutor(2)


def _machine() -> str:
    """A key of the processor: a program compiled for another one may not run here, and both may share a home folder."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        facts = sorted({line for line in lines if line.startswith(("model name", "flags", "Features", "CPU part"))})
    except OSError:
        facts = [platform.processor()]
    return hashlib.sha256(repr((platform.machine(), facts)).encode()).hexdigest()[:8]


def _committed(module: export.Exported, example: tuple[PyTree, ...]) -> Callable[..., PyTree]:
    """The compiled module. One that was exported for several devices needs its arguments on all of them.

    The result is on the first device.
    """
    devices = jax.local_devices()[: module.nr_devices]
    mesh = jax.sharding.Mesh(np.array(devices), ("scenarios",))
    everywhere = jax.sharding.NamedSharding(mesh, jax.sharding.PartitionSpec())
    with _lean(module):
        lowered = jax.jit(module.call).lower(*jax.device_put(example, everywhere))
    call = lowered.compile()
    return lambda *arguments: jax.device_put(call(*jax.device_put(arguments, everywhere)), devices[0])


def _lean(module: export.Exported) -> contextlib.AbstractContextManager[None]:
    """Where a module that has no use for LAPACK is lowered without it; of another release of JAX, with it."""
    if b"lapack" in module.mlir_module_serialized:
        return contextlib.nullcontext()
    try:
        from ._jax_cache import without_lapack
    except (ImportError, AttributeError):
        return contextlib.nullcontext()
    return without_lapack()


def _key(settings: str) -> str:
    digest = hashlib.sha256(sources())
    versions = [importlib.metadata.version(name) for name in ("jax", "jaxlib", "optax")]
    state = (versions, os.environ.get("XLA_FLAGS"), str(jax.numpy.result_type(float)), settings)
    digest.update(repr((*state, jax.default_backend(), jax.local_device_count())).encode())
    return digest.hexdigest()[:32]


@functools.cache
def sources() -> bytes:
    """A digest of the code of both packages, read once a process."""
    digest = hashlib.sha256()
    for package in (Path(agvjax.__file__).parent, Path(__file__).parents[1]):
        for source in sorted(package.rglob("*.py")):
            digest.update(source.read_bytes())
    return digest.digest()
