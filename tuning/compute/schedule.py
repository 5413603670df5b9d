"""Independent jobs, each of which makes bytes: in this process, one after the other, or on the workers of Dask.

For work in parts that need nothing of each other, such as the shards of a sweep:

    with schedule.opened(spelled, note) as engine:      # None: this process
        for number, data in engine.each(jobs, missing):  # in any order, as they are done
            files.write(place_of(number), data)          # only this process writes: workers need not see its folders

Whoever keeps what is done has lost nothing when a scheduler is lost, and asks for the rest the next time.
"""

from __future__ import annotations

import contextlib
import importlib.util
import re
from collections.abc import Callable, Iterator, Sequence
from typing import Generic, NamedTuple, Protocol, TypeVar

from agvjax import Fault, InputError

T = TypeVar("T")
Make = Callable[[int], bytes]  # of a job, by its number
SPELLED = re.compile(r"(?P<kind>local|slurm|kubernetes):(?P<count>[1-9]\d{0,4})|(?P<address>(?:tcp|tls)://\S+:\d+)")
RULE = "local:N, tcp://HOST:PORT, tls://HOST:PORT, slurm:N or kubernetes:N, with N workers or jobs"
NEEDS = {  # the module of a kind of scheduler, and what installs it
    "slurm": ("dask_jobqueue", "pip install dask-jobqueue"),
    "kubernetes": ("dask_kubernetes", "pip install dask-kubernetes"),
}
INSTALL = "pip install 'agvjax[cluster]'"


class Jobs(NamedTuple, Generic[T]):
    """Jobs known by number. The bytes of one depend on `about` and its number alone, not on who makes them or when.

    Attributes:
        name: what one of them is called in messages, "shard".
        here: makes one, in this process.
        prepare: makes the same of `about` in another process, once in each: what is compiled serves all its jobs. A
            function of a module, which is sent by its name; JAX is set there as it is here (precision, options).
        about: plain data that `pickle` takes, without arrays of JAX.
    """

    name: str
    here: Make
    prepare: Callable[[T], Make]
    about: T


class Engine(Protocol):
    """Who makes them."""

    def each(self, jobs: Jobs[T], numbers: Sequence[int]) -> Iterator[tuple[int, bytes]]:
        """The jobs of these numbers, each with its number, in any order.

        Raises:
            WorkFailed: on workers; in this process whatever a job raises.
        """
        ...


class WorkFailed(RuntimeError):
    """The scheduler is gone, workers die of a job, or a job failed on one; what was made before is whole."""


class Here:
    """This process, one job after the other."""

    def each(self, jobs: Jobs[T], numbers: Sequence[int]) -> Iterator[tuple[int, bytes]]:
        """As `Engine`."""
        return ((number, jobs.here(number)) for number in numbers)


def checked(spelled: str, key: str = "--scheduler") -> tuple[str, str]:
    """The kind of a scheduler, `address` among them, and how many or where.

    Raises:
        InputError: nobody knows it, or what it needs is not installed.
    """
    match = SPELLED.fullmatch(spelled)
    if match is None:
        raise InputError([Fault(key, repr(spelled), RULE)])
    kind = match["kind"] or "address"
    for module, install in (("distributed", INSTALL), NEEDS.get(kind, ("distributed", INSTALL))):
        if importlib.util.find_spec(module) is None:
            raise InputError([Fault(key, spelled, f"one whose package is installed ({module} is not: {install})")])
    return kind, match["count"] or match["address"]


@contextlib.contextmanager
def opened(spelled: str | None, note: Callable[[str], None], key: str = "--scheduler") -> Iterator[Engine]:
    """Who makes jobs, and what was started for that ends with the block.

    Args:
        spelled: `local:N` for N processes of this machine, the address of a scheduler that runs, `slurm:N` or
            `kubernetes:N` for N jobs of dask-jobqueue or workers of dask-kubernetes, with the options of Dask's own
            configuration; None: this process.
        note: told what a user should know.
        key: the option or argument that says so, for messages.

    Raises:
        InputError: `spelled` is none of these, what it needs is not installed or not configured.
        WorkFailed: nobody answers at the address.
    """
    if spelled is None:
        yield Here()
        return
    kind, where = checked(spelled, key)
    from . import dask_workers  # late: an extra, and slow to import

    with dask_workers.opened(kind, where, note, key) as engine:
        yield engine
