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


def tune_xla(*, reverse: bool = False, devices: int | None = None) -> str:
    """Set the XLA options that make rollouts fast on a CPU; call it before the first use of JAX in the process.

    Args:
        reverse: for a process that takes reverse-mode gradients, which the forward options slow down.
        devices: how many devices JAX makes of the CPU, between which `evaluate` shares a large batch; None for one on
            each core that this process may use, unless JAX's own JAX_NUM_CPU_DEVICES or XLA_FLAGS say so already.

    Returns:
        What was done, in one sentence to show: set, now or by an earlier call, left alone because XLA_FLAGS already
        names backend options, too late because JAX has started (then rollouts run several times slower), or refused by
        this jaxlib.

    Raises:
        ValueError: `devices` is less than 1.
    """
    if devices is not None and devices < 1:
        raise ValueError(f"devices must be at least 1; got {devices}")
    flags, present = REVERSE if reverse else FAST, os.environ.get("XLA_FLAGS", "")
    if _started():
        if flags in present:
            return "fast compiler options are set already"
        return (
            "JAX has already started: compiler options and devices stay as they are, rollouts run several times slower"
        )
    if devices is not None or not ("JAX_NUM_CPU_DEVICES" in os.environ or "host_platform_device_count" in present):
        _set_devices(cores() if devices is None else devices)
    if "xla_backend_extra_options" in present:
        return "XLA_FLAGS already holds backend options; left as they are"
    combined = f"{present} {flags}".strip()
    if not _accepted(combined):
        return "this jaxlib refuses the fast compiler options; rollouts run at its defaults, several times slower"
    os.environ["XLA_FLAGS"] = combined
    return "fast compiler options set"


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _set_devices(count: int) -> None:
    import jax

    jax.config.update("jax_num_cpu_devices", count)


def _started() -> bool:
    if "jax" not in sys.modules:
        return False
    from jax._src import xla_bridge  # no public way to ask without starting it

    return xla_bridge.backends_are_initialized()
