"""Compiler options that make rollouts several times faster on a CPU; undocumented by XLA, so probed, never assumed."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import os
import platform
import sys
import tempfile
import warnings
from pathlib import Path

from . import reproducer
from .reproducer import FLAGS as FAST

REVERSE = "--xla_backend_extra_options=xla_cpu_use_multi_output_fusion=true --xla_cpu_prefer_vector_width=512"
BACKEND = "--xla_backend_extra_options"  # which is there once: what a user has there himself stays
TRIED = ((0, 8), (0, 12))  # jaxlib releases, from and to, on which these options were tried by hand
IDLE = 1.5  # times as fast: less is no effect; on every release tried it is 5 and more
PIN = f"pip install 'jax<0.{TRIED[1][1] + 1}' 'jaxlib<0.{TRIED[1][1] + 1}'"
SWITCH = "AGVJAX_XLA"  # of the environment; 0: `import agvjax` leaves the options as they are


def tune_xla(*, reverse: bool = False, devices: int | None = None) -> str:
    """Set the XLA options that make rollouts fast on a CPU; call it before the first use of JAX in the process.

    `import agvjax` has set those for forward mode already, where it could; see `set_on_import`.

    Args:
        reverse: for a process that takes reverse-mode gradients, which the forward options slow down.
        devices: how many devices JAX makes of the CPU, between which `evaluate` shares a large batch; None for one on
            each core that this process may use, unless JAX's own JAX_NUM_CPU_DEVICES or XLA_FLAGS say so already.

    Returns:
        What was done, in one sentence to show: set, now or by an earlier call, left alone because XLA_FLAGS already
        names backend options, too late because JAX has started (then rollouts run several times slower), or refused by
        this jaxlib, or accepted and without effect.

    Raises:
        ValueError: `devices` is less than 1.
    """
    if devices is not None and devices < 1:
        raise ValueError(f"devices must be at least 1; got {devices}")
    flags, present = REVERSE if reverse else FAST, os.environ.get("XLA_FLAGS", "")
    if started():
        return _too_late(flags, present)
    if devices is not None or not ("JAX_NUM_CPU_DEVICES" in os.environ or "host_platform_device_count" in present):
        _set_devices(cores() if devices is None else devices)
    own = present.replace(FAST, "").replace(REVERSE, "").strip()
    if BACKEND in own:
        return "XLA_FLAGS already holds backend options; left as they are"
    combined = f"{own} {flags}".strip()
    if why := _useless(combined, own):
        os.environ["XLA_FLAGS"] = own
        return why
    os.environ["XLA_FLAGS"] = combined
    return "fast compiler options set"


def _too_late(flags: str, present: str) -> str:
    if flags in present:
        return "fast compiler options are set already"
    if FAST in present:
        return "fast compiler options are set already, those for forward mode: reverse-mode gradients run slower"
    if REVERSE in present:
        return "fast compiler options are set already, those for reverse mode: the rest runs somewhat slower"
    if BACKEND in present:
        return "XLA_FLAGS already holds backend options, and JAX has started; left as they are"
    return "JAX has already started: compiler options and devices stay as they are, rollouts run several times slower"


def set_on_import() -> None:
    """Set the options for forward mode, silently, where nothing speaks against it; devices stay as they are.

    Not where the environment has AGVJAX_XLA=0 or JAX_PLATFORMS without a CPU, where XLA_FLAGS has backend options,
    where JAX has started, or where nobody has tried them with this jaxlib: probing takes seconds, `tune_xla` does it.
    """
    present = os.environ.get("XLA_FLAGS", "")
    if _left_alone() or BACKEND in present or not _tried() or started():
        return
    os.environ["XLA_FLAGS"] = f"{present} {FAST}".strip()


def warn_if_slow() -> None:
    """A warning, once, where rollouts are compiled without the options although nobody asked for that."""
    set_on_import()  # JAX may still not have started
    if _left_alone() or BACKEND in os.environ.get("XLA_FLAGS", "") or _WARNED:
        return
    if started():
        import jax

        if jax.default_backend() != "cpu":
            return
        why = (
            "JAX had started before agvjax was imported: import agvjax, or call agvjax.tune_xla(), before its first use"
        )
    else:
        why = "nobody has tried agvjax's compiler options with this jaxlib: agvjax.tune_xla() does, before JAX starts"
    _WARNED.append(why)
    warnings.warn(f"rollouts run 5 to 50 times slower than they could; {why} ({SWITCH}=0: not said)", stacklevel=3)


_WARNED: list[str] = []


def _left_alone() -> bool:
    platforms = os.environ.get("JAX_PLATFORMS", "")
    return os.environ.get(SWITCH) == "0" or bool(platforms and "cpu" not in platforms)


def _release() -> str:
    return importlib.metadata.version("jaxlib")


def _tried() -> bool:
    return TRIED[0] <= tuple(int(part) for part in _release().split(".")[:2]) <= TRIED[1]


def _useless(flags: str, own: str) -> str:
    """Why these flags are of no use with this jaxlib, against the user's `own`; empty where they are.

    Of a release that nobody tried, a process of its own is asked with each; what it said is kept for the next time.
    """
    if _tried() and flags in (FAST, REVERSE):
        return ""
    key = hashlib.sha256(repr((_release(), platform.machine(), platform.processor(), flags, own)).encode())
    place = cache_folder()
    path = None if place is None else place / f"xla-{key.hexdigest()[:16]}.json"
    try:
        found = json.loads(path.read_text()) if path is not None else None
        faster = float(found["faster"]) if found else None
    except (OSError, ValueError, KeyError, TypeError):
        faster = None
    if faster is None:
        faster = _faster(flags, own)
        _keep(path, {"jaxlib": _release(), "flags": flags, "faster": faster})
    if faster == 0:
        return f"jaxlib {_release()} refuses the fast compiler options; rollouts run several times slower ({PIN})"
    idle = f"jaxlib {_release()} accepts the fast compiler options and does nothing with them"
    return f"{idle}: rollouts run several times slower ({PIN})" if faster < IDLE else ""


def _faster(flags: str, own: str) -> float:
    """How many times as fast a loop runs with these flags; 0 where JAX does not start with them."""
    with_them, without = reproducer.asked(flags), reproducer.asked(own)
    return 0.0 if with_them is None else without[0] / with_them[0] if without else IDLE


def _keep(path: Path | None, found: dict[str, object]) -> None:
    """As a whole or not at all; where it cannot be kept it is measured again."""
    if path is None:
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        handle, name = tempfile.mkstemp(dir=path.parent)
        with os.fdopen(handle, "w") as file:
            json.dump(found, file)
        Path(name).replace(path)
    except OSError:
        pass


def cache_folder() -> Path | None:
    """What saves work at the next start, safe to delete: `agvjax` under XDG_CACHE_HOME or ~/.cache. None: no place."""
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "agvjax"
    except RuntimeError:  # a user without a home
        return None


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _set_devices(count: int) -> None:
    import jax

    jax.config.update("jax_num_cpu_devices", count)


def started() -> bool:
    """Whether JAX has started in this process, and what it was started with stays."""
    if "jax" not in sys.modules:
        return False
    from jax._src import xla_bridge  # no public way to ask without starting it

    return xla_bridge.backends_are_initialized()
