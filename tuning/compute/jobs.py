"""Independent jobs, each of which makes bytes, and who makes them.

For work in parts that need nothing of each other, such as the shards of a sweep:

    with schedule.opened(spelled, note) as engine:       # None: this process
        for number, data in engine.each(jobs, missing):  # in any order, as they are done
            files.write(place_of(number), data)          # only this process writes: workers need not see its folders

Whoever keeps what is done has lost nothing when a scheduler is lost, and asks for the rest the next time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Generic, NamedTuple, Protocol, TypeVar

T = TypeVar("T")
Make = Callable[[int], bytes]  # of a job, by its number


class Jobs(NamedTuple, Generic[T]):
    """Jobs known by number. The bytes of one depend on `about` and its number alone, not on who makes them or when.

    Attributes:
        name: what one of them is called in messages, "shard".
        here: makes one, in this process.
        prepare: makes the same of `about` in another process, once in each: what is compiled serves all its jobs. A
            function of a module, which is sent by its name. JAX is set there as it is here (precision, options, number
            of devices): `evaluate` with `devices=1` leaves the cores of other workers alone.
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
