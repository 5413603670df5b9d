"""Where jobs are made: in this process, one after the other, or on the workers of Dask."""

from __future__ import annotations

import contextlib
import importlib.util
import re
import shutil
from collections.abc import Callable, Iterator

from agvjax import Fault, InputError

from .jobs import Engine, Here

SPELLED = re.compile(r"(?P<kind>local|slurm|kubernetes):(?P<count>[1-9]\d{0,4})|(?P<address>(?:tcp|tls)://\S+:\d+)")
RULE = "local:N, tcp://HOST:PORT, tls://HOST:PORT, slurm:N or kubernetes:N, with N workers or jobs"
NEEDS = {  # the module of a kind of scheduler, and what installs it
    "slurm": ("dask_jobqueue", "pip install dask-jobqueue"),
    "kubernetes": ("dask_kubernetes", "pip install dask-kubernetes"),
}
INSTALL = "pip install 'agvjax[cluster]'"


def checked(spelled: str, key: str = "--scheduler") -> tuple[str, str]:
    """The kind of a scheduler, `address` among them, and how many or where.

    Raises:
        InputError: nobody knows it, or what it needs is not there.
    """
    match = SPELLED.fullmatch(spelled)
    if match is None:
        raise InputError([Fault(key, repr(spelled), RULE)])
    kind = match["kind"] or "address"
    for module, install in (("distributed", INSTALL), NEEDS.get(kind, ("distributed", INSTALL))):
        if importlib.util.find_spec(module) is None:
            raise InputError([Fault(key, spelled, f"one whose package is installed ({module} is not: {install})")])
    if kind == "slurm" and shutil.which("sbatch") is None:
        raise InputError([Fault(key, spelled, "used where SLURM is: there is no sbatch on the PATH")])
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
