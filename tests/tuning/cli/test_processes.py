"""Several processes at once, processes that are killed, and a disk that is full: as a user meets them."""

import json
import random
import socket
import time

import numpy as np
import pytest

from commands import FAST, HUNG, SHORT_TUNE, arguments, run, start
from tuning.sweep import results, shards

SWEEP = [
    "simulate.horizon=2",
    "sweep.integrator=euler",
    "sweep.shard=256",
    "sweep.radius=false",
    'sweep.metrics=["total_rmse", "longest_settling_time"]',
    "tune.search.scouts=16",
]
RANDOM = ("--ensemble", "--samples", "16000")  # 63 shards
pytestmark = pytest.mark.slow


def swept(out, *more):
    return arguments("sweep", out, SWEEP, *RANDOM, *more)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    out = tmp_path_factory.mktemp("sweep") / "undisturbed"
    run(swept(out))
    return results.load(out), out


def same(folder, other):
    found = results.load(folder)
    assert found.manifest == other.manifest
    np.testing.assert_array_equal(found.ok, other.ok)
    for arrays, wanted in ((found.metrics, other.metrics), (found.leaves, other.leaves)):
        for name in wanted:
            np.testing.assert_array_equal(arrays[name], wanted[name])


def whole(folder):
    """When every finished shard was written."""
    return {path.name: path.stat().st_mtime_ns for path in folder.glob("shard-*.npz")}


def wait_for(folder, count):
    end = time.monotonic() + 120
    while len(whole(folder)) < count:
        assert time.monotonic() < end, f"fewer than {count} shards after two minutes"
        time.sleep(0.01)


def test_a_sweep_killed_five_times_ends_as_if_it_never_was(undisturbed, tmp_path):
    out, rng = tmp_path / "killed", random.Random(1)
    for stop in range(5):
        process = start(swept(out))
        wait_for(out, 8 * (stop + 1))
        time.sleep(0.2 * rng.random())
        process.kill()
        process.communicate()
        kept = whole(out)
        assert 8 * (stop + 1) <= len(kept) < 63
        for path in out.glob("shard-*.npz"):
            np.load(path)  # none is half written
    run(swept(out))
    assert kept.items() <= whole(out).items()  # none was made again
    same(out, undisturbed[0])
    assert not list(out.glob(".*.part")) and not list(out.glob("*.claim"))


def test_a_second_process_in_the_folder_is_refused_and_the_first_goes_on(undisturbed, tmp_path):
    out = tmp_path / "two"
    first = start(swept(out))
    wait_for(out, 1)
    _, said = run(swept(out), code=2)
    assert f"--out = {out}: must be a folder in which no other process is at work" in said and "--scheduler" in said
    _, said = first.communicate(timeout=HUNG)
    assert first.returncode == 0, said
    same(out, undisturbed[0])


def test_a_full_disk_stops_with_a_message_and_loses_nothing(undisturbed, tmp_path):
    """The limit on the size of a file stands for it: shards are larger than the manifest."""
    out = tmp_path / "full"
    run(swept(out, "--set", "sweep.shard=4000", "--quiet"))
    size = max(path.stat().st_size for path in out.glob("shard-*.npz"))
    kept = sorted(out.glob("shard-*.npz"))[:2]
    before = {path.name: path.read_bytes() for path in kept}
    for path in sorted(out.glob("shard-*.npz"))[2:]:
        path.unlink()

    limit = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({size // 2}, {size // 2}))"
    limited = ("-c", f"{limit}; from tuning.cli.main import run; run()")  # Python ignores the signal of it by itself
    process = start(swept(out, "--set", "sweep.shard=4000", "--quiet"), limited)
    _, said = process.communicate(timeout=HUNG)
    assert process.returncode == 1 and "Traceback" not in said
    assert "could not be written" in said and "2 of 4 are kept" in said
    assert {path.name: path.read_bytes() for path in kept} == before
    assert not list(out.glob(".*.part"))


TUNE = [*FAST, "simulate.horizon=2.0", *SHORT_TUNE, "controller.omega_n=30.0", "tune.iterations=60"]
TUNE += ["ensemble.size=10"]  # not a multiple of the devices


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def together(out, settings, *more):
    meet = ("--coordinator", f"127.0.0.1:{free_port()}", "--num-processes", 2, "--process-id")
    return [start(arguments("tune", out, settings, *more, *meet, k)) for k in (0, 1)]


def history(folder):
    return (folder / "history.csv").read_text(), (folder / "gains.toml").read_text()


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    out = tmp_path_factory.mktemp("tune") / "alone"
    run(arguments("tune", out, TUNE))
    return history(out)


def numbers(text):
    return np.array([[float(x) for x in line.split(",")] for line in text.splitlines()[1:]])


def test_two_processes_and_four_devices_tune_to_the_gains_of_one(alone, tmp_path, monkeypatch):
    for process in together(tmp_path / "two", TUNE):
        _, said = process.communicate(timeout=HUNG)
        assert process.returncode == 0, said
    monkeypatch.setenv("JAX_NUM_CPU_DEVICES", "4")
    run(arguments("tune", tmp_path / "four", TUNE))
    for name in ("two", "four"):
        np.testing.assert_allclose(numbers(history(tmp_path / name)[0]), numbers(alone[0]), rtol=1e-9, atol=1e-12)


def test_a_lost_process_ends_the_other_and_the_run_goes_on_to_the_same_result(alone, tmp_path):
    out = tmp_path / "lost"
    longer = [*TUNE, "tune.iterations=2000", "tune.patience=3000"]
    first, second = together(out, longer)
    end = time.monotonic() + 200
    while not (out / "checkpoint.npz").exists() and time.monotonic() < end:
        time.sleep(0.05)
    second.kill()
    lost = time.monotonic()
    _, said = first.communicate(timeout=HUNG)
    assert time.monotonic() - lost < 60 and first.returncode != 0
    assert "another process was lost" in said and "--resume" in said
    second.communicate()
    for process in together(out, longer, "--resume"):
        _, said = process.communicate(timeout=HUNG)
        assert process.returncode == 0, said
    run(arguments("tune", tmp_path / "alone", longer))
    np.testing.assert_allclose(numbers(history(out)[0]), numbers(history(tmp_path / "alone")[0]), rtol=1e-9, atol=1e-12)


def test_a_vehicle_of_a_sweep_is_rolled_out_again(undisturbed, tmp_path):
    found, folder = undisturbed
    listed = json.loads((folder / "findings.json").read_text())["configured"]["worst"]
    values = found.metrics["total_rmse"][0]
    assert listed == np.argsort(-values, kind="stable")[:10].tolist()
    timing = ["simulate.dt=0.01", "simulate.integrator=euler"]
    out = tmp_path / "again"
    run([*arguments("simulate", out, timing), "--from", str(folder), "--index", str(listed[0])])
    metrics = json.loads((out / "metrics.json").read_text())
    np.testing.assert_allclose(metrics["total_rmse"], values[listed[0]], rtol=1e-9)
    assert shards.read_manifest(folder).size == 16000
