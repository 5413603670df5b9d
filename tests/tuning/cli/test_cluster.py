"""Sweeps on workers of Dask, where workers, schedulers and files are lost: the bytes stay the same."""

import os
import signal
import socket
import subprocess
import sys
import time

import pytest

from commands import HUNG, ROOT, arguments, run, start

psutil = pytest.importorskip("psutil")
pytest.importorskip("distributed")
pytestmark = pytest.mark.slow

SWEEP = ["simulate.horizon=4", "sweep.integrator=euler", "sweep.shard=256", "sweep.radius=false"]
SWEEP += ['sweep.metrics=["total_rmse","longest_settling_time"]', "tune.search.scouts=16"]
COUNT = 24_000  # 94 shards, the last of them shorter
DASK = "-W", "ignore", "-m"


def swept(out, *more, samples=COUNT):
    return arguments("sweep", out, SWEEP, "--ensemble", "--samples", samples, "--quiet", *more)


def results(folder):
    """The bytes of all that a sweep finds."""
    return {p.name: p.read_bytes() for p in folder.iterdir() if p.suffix in (".npz", ".json", ".csv", ".toml")}


def count(folder):
    return len(list(folder.glob("shard-*.npz")))


def wait_for(process, folder, shards):
    while count(folder) < shards:
        assert process.poll() is None, process.communicate()
        time.sleep(0.02)


def finished(process, code=0):
    out, err = process.communicate(timeout=HUNG)
    assert process.returncode == code, err
    assert "Traceback" not in out + err, out + err
    return out + err


def workers_of(process):
    children = psutil.Process(process.pid).children(recursive=True)
    return [child for child in children if any("spawn_main" in word for word in child.cmdline())]


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    out = tmp_path_factory.mktemp("sweep") / "alone"
    run(swept(out))
    assert count(out) == 94
    return results(out)


def test_six_workers_on_one_folder_write_what_one_process_does(alone, tmp_path):
    out = tmp_path / "six"
    run(swept(out, "--scheduler", "local:6"))
    assert results(out) == alone


def test_a_worker_that_is_killed_is_replaced_and_said(alone, tmp_path):
    out = tmp_path / "killed"
    argv = [word for word in swept(out, "--scheduler", "local:2") if word != "--quiet"]
    process = start(argv)
    wait_for(process, out, 8)
    workers = workers_of(process)
    assert len(workers) == 2
    os.kill(workers[0].pid, signal.SIGKILL)
    assert "1 worker(s) died meanwhile" in finished(process)
    assert results(out) == alone


def test_shards_cut_short_are_computed_again_by_workers_and_no_others_are(alone, tmp_path):
    out = tmp_path / "cut"
    run(swept(out))
    for number in (3, 93):
        path = out / f"shard-{number:05d}.npz"
        path.write_bytes(path.read_bytes()[:-100])
    before = {path.name: path.stat().st_mtime_ns for path in out.glob("shard-*.npz")}
    argv = [word for word in swept(out, "--scheduler", "local:1") if word != "--quiet"]
    assert "2 of 94 shards are damaged or cut short (3, 93)" in finished(start(argv))
    after = {path.name: path.stat().st_mtime_ns for path in out.glob("shard-*.npz")}
    assert {name for name in before if before[name] != after[name]} == {"shard-00003.npz", "shard-00093.npz"}
    assert results(out) == alone


class Cluster:
    """A scheduler and its workers, as a user starts them by hand."""

    def __init__(self):
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.address, self.processes = f"tcp://127.0.0.1:{self.port}", []

    def begin(self, workers=2):
        """Start both."""
        place = ("--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard")
        self._start("distributed.cli.dask_scheduler", *place)
        for _ in range(workers):
            self._start("distributed.cli.dask_worker", self.address, "--nthreads", "1", "--no-dashboard")

    def _start(self, module, *more):
        path = os.pathsep.join([str(ROOT), str(ROOT / "tests" / "helpers")])
        environment = {k: v for k, v in os.environ.items() if k != "XLA_FLAGS"} | {"PYTHONPATH": path}
        nowhere = subprocess.DEVNULL
        command = [sys.executable, *DASK, module, *more]
        self.processes.append(subprocess.Popen(command, env=environment, stdout=nowhere, stderr=nowhere))

    def end(self):
        """End both at once, nannies with what they watch."""
        for process in self.processes:
            for one in [psutil.Process(process.pid), *psutil.Process(process.pid).children(recursive=True)]:
                one.kill()
            process.wait()
        self.processes.clear()


@pytest.fixture
def cluster():
    cluster = Cluster()
    yield cluster
    cluster.end()


def test_a_scheduler_that_is_lost_ends_the_command_and_the_next_one_goes_on(alone, cluster, tmp_path):
    out = tmp_path / "restarted"
    cluster.begin()
    process = start(swept(out, "--scheduler", cluster.address))
    wait_for(process, out, 8)
    cluster.end()
    said = finished(process, 1)
    assert "the scheduler was lost" in said and f"of 94 are kept in {out}" in said and "it continues" in said
    kept = {path.name: path.stat().st_mtime_ns for path in out.glob("shard-*.npz")}
    assert 8 <= len(kept) < 94
    cluster.begin()
    run(swept(out, "--scheduler", cluster.address, "--resume"))
    assert kept.items() <= {path.name: path.stat().st_mtime_ns for path in out.glob("shard-*.npz")}.items()
    assert results(out) == alone


def test_a_worker_with_other_compiler_options_is_refused(cluster, tmp_path, monkeypatch):
    """It served a process without ours, and JAX has started in it."""
    from distributed import Client

    cluster.begin(workers=1)
    with Client(cluster.address) as client:
        client.wait_for_workers(1)
        assert client.submit(eval, "__import__('jax').numpy.ones(2).sum().item()").result() == 2.0
    said = finished(start(swept(tmp_path / "out", "--scheduler", cluster.address, samples=600)), 1)
    assert "a worker is unlike this process" in said and "XLA_FLAGS" in said


def test_an_interrupt_of_the_terminal_ends_all_and_loses_nothing(tmp_path):
    out = tmp_path / "interrupted"
    process = start(swept(out, "--scheduler", "local:2"), apart=True)
    wait_for(process, out, 8)
    workers = workers_of(process)
    os.killpg(process.pid, signal.SIGINT)
    assert finished(process, 130).endswith("agvjax sweep: interrupted\n")
    assert psutil.wait_procs(workers, timeout=30)[1] == []
    assert not list(out.glob(".*.part"))


SBATCH = """#!/bin/sh
# stands for SLURM: a job is a process of this machine, in a session of its own
sed -n '1!p' "$1" > "$0.$$.sh"
setsid sh "$0.$$.sh" > "$0.$$.log" 2>&1 &
echo "Submitted batch job $!"
"""
SCANCEL = '#!/bin/sh\nkill -9 -- "-$1"\n'
JOBQUEUE = """
jobqueue:
  slurm:
    cores: 1
    processes: 1
    memory: 2GB
    interface: lo
    death-timeout: 60
"""


def test_jobs_of_slurm_compute_a_sweep(alone, tmp_path, monkeypatch):
    """dask-jobqueue itself, on programs that stand for those of SLURM."""
    pytest.importorskip("dask_jobqueue")
    (tmp_path / "bin").mkdir()
    for name, text in (("sbatch", SBATCH), ("scancel", SCANCEL)):
        (tmp_path / "bin" / name).write_text(text)
        (tmp_path / "bin" / name).chmod(0o755)
    (tmp_path / "dask").mkdir()
    (tmp_path / "dask" / "jobqueue.yaml").write_text(JOBQUEUE)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("DASK_CONFIG", str(tmp_path / "dask"))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    out = tmp_path / "slurm"
    finished(start(swept(out, "--scheduler", "slurm:2")))
    assert len(list((tmp_path / "bin").glob("sbatch.*.sh"))) == 2
    assert results(out) == alone


def test_workers_draw_rare_failures_as_one_process_does(tmp_path):
    settings = ["simulate.horizon=4", "sweep.integrator=euler", "sweep.shard=2048", "sweep.rollouts=20000"]
    settings += ["sweep.fails={ total_rmse = 1.3 }", 'sweep.metrics=["total_rmse"]']
    found = []
    for name, more in (("one", ()), ("two", ("--scheduler", "local:2"))):
        out = tmp_path / name
        finished(start(arguments("sweep", out, settings, "--rare", "--ensemble", "--quiet", *more)))
        found.append(results(out))
    assert found[0] == found[1] and sum(name.startswith("rare-draws") for name in found[0]) > 2
