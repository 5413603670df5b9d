"""What a process does that makes jobs for another: JAX is set as it is there, then they are made."""

from __future__ import annotations

import functools
import os
import pickle
import threading
from typing import NamedTuple

import jax

from agvjax.engine import xla

from . import compiled
from .jobs import Jobs, Make, T
from .packages import versions

DEVICES = "--xla_force_host_platform_device_count"  # said to JAX by itself


class Order(NamedTuple):
    """What is to be made, and how JAX was set where it was asked for."""

    x64: bool
    devices: int  # of JAX there: what is compiled for one of so many is kept for all processes of a machine
    options: tuple[str, ...]  # of the compiler
    facts: tuple[tuple[str, str], ...]
    parcel: bytes  # `prepare` and `about` of the jobs, unpacked when JAX is set


def order(jobs: Jobs[T]) -> Order:
    """The order of jobs that this process asks for."""
    parcel = pickle.dumps((jobs.prepare, jobs.about))
    return Order(bool(jax.config.read("jax_enable_x64")), jax.local_device_count(), _options(), _facts(), parcel)


def job(order: Order, number: int) -> bytes:
    """One job; the first of an order compiles what the others use.

    Raises:
        RuntimeError: this process has other packages than the one that asks, or JAX has started with other options.
    """
    with _ONE:  # threads of one worker: the second waits for what the first compiles
        jax.config.update("jax_enable_x64", order.x64)
        make = _made(order)
    return make(number)


async def awake() -> None:
    """Import what a job needs, as to be sent this function does."""


_ONE = threading.Lock()


@functools.lru_cache(2)  # a worker may serve for months
def _made(order: Order) -> Make:
    if not xla.started():
        os.environ["XLA_FLAGS"] = " ".join(order.options)
        jax.config.update("jax_num_cpu_devices", order.devices)
    compiled.keep_compiled()
    theirs, ours = (
        {**dict(facts), "XLA_FLAGS": " ".join(x)} for facts, x in ((order.facts, order.options), (_facts(), _options()))
    )
    other = [
        f"{name}: {ours.get(name)} there, {value} here" for name, value in theirs.items() if ours.get(name) != value
    ]
    if other:
        raise RuntimeError(f"a worker is unlike this process, results would differ: {'; '.join(other)}")
    prepare, about = pickle.loads(order.parcel)
    return prepare(about)


def _options() -> tuple[str, ...]:
    """The compiler's options of this process, but the number of devices."""
    words = os.environ.get("XLA_FLAGS", "").split()
    return tuple(word for word in words if not word.startswith(DEVICES))


def _facts() -> tuple[tuple[str, str], ...]:
    """What results hang on besides: releases, the code itself, the kind of device."""
    facts = versions()
    facts |= {"agvjax": f"{facts['agvjax']} ({compiled.sources().hex()[:8]})", "device": jax.default_backend()}
    return tuple(facts.items())
