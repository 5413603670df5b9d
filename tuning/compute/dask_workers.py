"""Jobs on the workers of a Dask scheduler."""

from __future__ import annotations

import contextlib
import importlib
import logging
import uuid
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from dask import config as dask_config
from distributed import Client, Future, KilledWorker, LocalCluster, Security, as_completed
from distributed.deploy.cluster import Cluster

from agvjax import Fault, InputError

from . import deaf, worker
from .jobs import Jobs, T, WorkFailed

ANSWER = 30  # s in which a scheduler must answer
NOTHING = logging.CRITICAL + 1  # of its logs: what matters is said here, and workers that go are no news to it
MOST = 500  # letters of an error of a worker that are shown


class Workers:
    """Those of a scheduler, now and whoever joins later."""

    def __init__(self, client: Client, note: Callable[[str], None]):
        self._client, self._note = client, note
        self._lost = 0
        client.subscribe_topic("all", self._heard)

    def _heard(self, event: tuple[float, dict[str, object]]) -> None:
        """Count workers that go without a word while they have something to do."""
        about = event[1]
        if about.get("action") == "remove-worker" and not about.get("expected") and about.get("processing-tasks"):
            self._lost += 1

    def each(self, jobs: Jobs[T], numbers: Sequence[int]) -> Iterator[tuple[int, bytes]]:
        """As `Engine`: one job, one task; one that is lost with its worker is made by another.

        Raises:
            WorkFailed: the scheduler is gone, workers died of one job more often than it allows
                (`distributed.scheduler.allowed-failures`), or a job failed, as where a worker is unlike this process.
        """
        if not numbers:
            return
        token, before = uuid.uuid4().hex, self._lost
        if not self._client.nthreads():
            self._note("no worker is there yet: waiting for the first")
        # a task of its own, and no scattered data: what a task made is made again where its worker dies
        order = self._client.submit(worker.Order, *worker.order(jobs), key=f"order-{token}", pure=False)
        tasks = {
            self._client.submit(worker.job, order, number, key=f"{jobs.name}-{number}-{token}", pure=False): number
            for number in numbers
        }
        for task in as_completed(tasks, loop=self._client.loop):
            number = tasks[task]
            yield number, _result(task, f"{jobs.name} {number}")
            task.release()  # or its worker keeps the bytes
        if lost := self._lost - before:
            self._note(f"{lost} worker(s) died meanwhile; what they had begun was computed again by others")


def _result(task: Future, job: str) -> bytes:
    """What a finished task made."""
    try:
        return task.result()
    except KilledWorker as error:
        deaths = error.allowed_failures + 1
        raise WorkFailed(f"{job}: {deaths} workers died while they computed it") from error
    except Exception as error:
        if task.status != "error":  # cancelled, or the connection broke while the bytes came
            raise WorkFailed("the scheduler was lost, or what was asked of it was cancelled") from error
        raise WorkFailed(f"{job} failed on a worker: {type(error).__name__}: {str(error)[:MOST]}") from error


@contextlib.contextmanager
def opened(kind: str, where: str, note: Callable[[str], None], key: str) -> Iterator[Workers]:
    """The workers of a scheduler; those that are started for this end with the block."""
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(NOTHING)
    with contextlib.ExitStack() as ends:
        try:
            place = where if kind == "address" else ends.enter_context(_cluster(kind, int(where), key))
            client = ends.enter_context(Client(place, timeout=ANSWER, set_as_default=False))
        except OSError as error:
            raise WorkFailed(f"no scheduler answers at {where}: {error}") from error
        client.run(worker.awake, wait=False)  # those that are there import while this process compiles
        yield Workers(client, note)
        client.unsubscribe_topic("all")


def _cluster(kind: str, count: int, key: str) -> Cluster:
    """A scheduler with workers that are started for it."""
    if kind == "local":
        # encrypted, or anybody with an account on this machine could have his code executed; and no pages of its own
        more: dict[str, Any] = {"silence_logs": NOTHING, "preload": deaf.__name__, "security": Security.temporary()}
        more["scheduler_kwargs"] = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}
        with dask_config.set({"distributed.scheduler.http.routes": [], "distributed.worker.profile.enabled": False}):
            return LocalCluster(n_workers=count, threads_per_worker=1, **more)
    if kind == "kubernetes":
        return importlib.import_module("dask_kubernetes.operator").KubeCluster(n_workers=count, quiet=True)
    from dask_jobqueue.slurm import SLURMCluster

    try:
        cluster = SLURMCluster()
    except ValueError as error:
        rule = f"used with jobqueue.slurm in Dask's configuration, e.g. ~/.config/dask/jobqueue.yaml ({error})"
        raise InputError([Fault(key, f"slurm:{count}", rule)]) from error
    cluster.scale(jobs=count)
    return cluster
