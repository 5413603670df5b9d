"""Jobs and who makes them: the bytes are those of this process, whatever becomes of workers."""

import importlib.util

import pytest

from agvjax import InputError
from parts import deadly, squares
from tuning.compute import schedule, worker
from tuning.compute.jobs import Here, Jobs, WorkFailed

pytest.importorskip("distributed")


def jobs_of(prepare, about, name="square"):
    return Jobs(name, prepare(about), prepare, about)


@pytest.fixture(scope="module")
def threads():
    """An engine on workers that are threads of this process: what is sent is sent all the same."""
    from distributed import Client, LocalCluster

    from tuning.compute.dask_workers import Workers

    said = []
    more = {"dashboard_address": "127.0.0.1:0", "processes": False, "silence_logs": 60}
    with LocalCluster(n_workers=2, threads_per_worker=1, **more) as cluster, Client(cluster) as client:
        yield Workers(client, said.append), said


def test_workers_make_the_bytes_of_this_process(threads):
    jobs, numbers = jobs_of(squares, 5), [7, 1, 4, 0, 9, 2]
    wanted = {n: f"{5 + n * n} float64".encode() for n in numbers}
    assert dict(Here().each(jobs, numbers)) == wanted
    assert dict(threads[0].each(jobs, numbers)) == wanted
    assert list(threads[0].each(jobs, [])) == []
    assert threads[1] == []


def test_a_job_that_fails_is_named_with_what_it_raised(threads):
    with pytest.raises(WorkFailed, match="^square 13 failed on a worker: ValueError: thirteen is not computed$"):
        list(threads[0].each(jobs_of(squares, 1), [13]))


def test_a_worker_of_other_packages_is_refused():
    asked = worker.order(jobs_of(squares, 2))
    assert worker.job(asked, 3) == b"11 float64"
    for name, value in (("jax", "0.1"), ("agvjax", "0.1.0 (00000000)"), ("device", "tpu")):
        other = asked._replace(facts=tuple({**dict(asked.facts), name: value}.items()))
        with pytest.raises(RuntimeError, match=f"unlike this process.*: {name}: .* there, .*{value[:5]}.* here"):
            worker.job(other, 3)
    with pytest.raises(RuntimeError, match="XLA_FLAGS: .* there, --xla_cpu_prefer_vector_width=1 here"):
        worker.job(asked._replace(options=("--xla_cpu_prefer_vector_width=1",)), 3)


@pytest.mark.parametrize(
    "spelled", ["", "local", "local:0", "local:-1", "local:x", "tcp://host", "slurm", "pbs:3", "4"]
)
def test_a_scheduler_that_nobody_knows_is_refused(spelled):
    with pytest.raises(InputError, match=r"--scheduler = .*local:N, tcp://HOST:PORT.*slurm:N or kubernetes:N"):
        schedule.checked(spelled)


def test_spellings_say_who_and_how_many():
    assert schedule.checked("local:3") == ("local", "3")
    assert schedule.checked("tcp://10.0.0.7:8786") == ("address", "tcp://10.0.0.7:8786")
    assert schedule.checked("tls://login-2:8786") == ("address", "tls://login-2:8786")


@pytest.mark.parametrize(
    ("module", "spelled", "install"),
    [
        ("distributed", "local:2", r"pip install 'agvjax\[cluster\]'"),
        ("distributed", "slurm:2", r"pip install 'agvjax\[cluster\]'"),
        ("dask_jobqueue", "slurm:2", "pip install dask-jobqueue"),
        ("dask_kubernetes", "kubernetes:2", "pip install dask-kubernetes"),
    ],
)
def test_what_is_not_installed_is_said_with_what_installs_it(module, spelled, install, monkeypatch):
    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *more: None if name == module else found("json"))
    with pytest.raises(InputError, match=f"{module} is not: {install}"), schedule.opened(spelled, print):
        pass


def test_slurm_is_asked_for_only_where_it_is(monkeypatch, tmp_path):
    pytest.importorskip("dask_jobqueue")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match="there is no sbatch on the PATH"), schedule.opened("slurm:2", print):
        pass


def test_nobody_at_the_address_is_said(monkeypatch):
    from tuning.compute import dask_workers

    monkeypatch.setattr(dask_workers, "ANSWER", 0.5)
    with pytest.raises(WorkFailed, match="no scheduler answers at tcp://127.0.0.1:9"):
        with schedule.opened("tcp://127.0.0.1:9", print):
            pass


@pytest.mark.slow
def test_a_job_that_kills_its_workers_is_an_error_that_names_it():
    with schedule.opened("local:2", print) as engine:
        assert dict(engine.each(jobs_of(deadly, 4, "batch"), [4])) == {4: b"alive"}
        with pytest.raises(WorkFailed, match="^batch 6: 4 workers died while they computed it$"):
            list(engine.each(jobs_of(deadly, 4, "batch"), [6]))
