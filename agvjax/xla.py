"""Compiler options that make rollouts several times faster on a CPU; undocumented by XLA, so probed, never assumed."""

from __future__ import annotations

import functools
import importlib.metadata
import os
import subprocess
import sys

FAST = (
    "--xla_backend_extra_options="
    "xla_cpu_use_multi_output_fusion=true,"  # a kernel may have several outputs: nothing is computed twice
    "xla_cpu_small_while_loop_byte_threshold=100000000,"  # the whole loop is one function: no launch for each kernel
    "-vectorize-memory-check-threshold=100000"  # kernels with dozens of arrays are vectorised too
    " --xla_cpu_prefer_vector_width=512"
)
REVERSE = "--xla_backend_extra_options=xla_cpu_use_multi_output_fusion=true --xla_cpu_prefer_vector_width=512"


TRIED = ((0, 8), (0, 12))  # jaxlib releases, from and to, on which these options were tried by hand


@functools.cache
def _accepted(flags: str) -> bool:
    """Whether this jaxlib starts with these flags; an unknown one is asked in a process of its own."""
    release = tuple(int(part) for part in importlib.metadata.version("jaxlib").split(".")[:2])
    if TRIED[0] <= release <= TRIED[1] and flags in (FAST, REVERSE):
        return True
    probe = [
        sys.executable,
        "-c",
        "import jax, jax.numpy as j; jax.jit(lambda x: x + 1)(j.ones(4)).block_until_ready()",
    ]
    environment = {**os.environ, "XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"}
    return subprocess.run(probe, env=environment, capture_output=True, check=False).returncode == 0


def tune_xla(*, reverse: bool = False) -> str:
    """Set the compiler options for fast rollouts on a CPU; call it before the first use of JAX in the process.

    Args:
        reverse: for a process that takes reverse-mode gradients, which the forward options slow down.

    Returns:
        What was done, in one sentence to show: set, left alone because XLA_FLAGS already names backend options,
        too late because JAX has started (then rollouts run several times slower), or refused by this jaxlib.
    """
    flags, present = REVERSE if reverse else FAST, os.environ.get("XLA_FLAGS", "")
    if "xla_backend_extra_options" in present:
        return "XLA_FLAGS already holds backend options; left as they are"
    if _started():
        return (
            "JAX has already started: its compiler options stay at their defaults and rollouts run several times slower"
        )
    combined = f"{present} {flags}".strip()
    if not _accepted(combined):
        return "this jaxlib refuses the fast compiler options; rollouts run at its defaults, several times slower"
    os.environ["XLA_FLAGS"] = combined
    return "fast compiler options set"


def _started() -> bool:
    if "jax" not in sys.modules:
        return False
    from jax._src import xla_bridge  # no public way to ask without starting it

    return xla_bridge.backends_are_initialized()
