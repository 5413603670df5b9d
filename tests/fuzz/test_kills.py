"""Commands that are killed at any moment, and go on: the files in the end are those of a command that never was."""

import random
import time

import pytest

from commands import HUNG, arguments, start
from tuning.sweep import shards

KILLS = 40
SHORT = ["simulate.horizon=1", "simulate.dt=0.01", "simulate.integrator=euler"]
TUNE = [
    *SHORT,
    "tune.dt=0.01",
    "tune.integrator=euler",
    "tune.iterations=12",
    "tune.checkpoint_every=1",
    "ensemble.size=4",
]
TUNE += ["ensemble.validation_size=4", "tune.search.checks=0", "tune.search.scouts=8", "tune.search.starts=1"]
TUNE += ["tune.search.iterations=1", 'tune.gains=["k1","k3"]']
SWEEP = [
    *SHORT,
    "sweep.dt=0.01",
    "sweep.integrator=euler",
    "sweep.shard=8",
    "sweep.radius=false",
    "tune.search.scouts=8",
]
COMMANDS = {"tune": (TUNE, ()), "sweep": (SWEEP, ("--ensemble", "--samples", 400))}
pytestmark = pytest.mark.slow


def end(argv):
    process = start(argv)
    _, err = process.communicate(timeout=HUNG)
    assert process.returncode in (0, 1) and "Traceback" not in err, err
    return process.returncode


def results(folder):
    """The bytes of all files, but of pictures of the run's own folder."""
    return {
        p.name: p.read_bytes() for p in folder.iterdir() if p.suffix in (".toml", ".csv", ".jsonl", ".npz", ".json")
    }


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_killed_forty_times_writes_what_it_would_have(command, tmp_path):
    settings, more = COMMANDS[command]
    whole, out, rng = tmp_path / "whole", tmp_path / "killed", random.Random(7)
    begun = time.monotonic()
    code = end(arguments(command, whole, settings, *more))
    took = time.monotonic() - begun
    out.mkdir()
    resume = ("--resume",) if command == "tune" else ()
    for _ in range(KILLS):
        process = start(arguments(command, out, settings, *more, *resume))
        time.sleep(rng.uniform(0.3, 1.0) * took)
        process.kill()
        process.communicate()
        assert process.returncode in (-9, code)
    assert end(arguments(command, out, settings, *more, *resume)) == code
    assert results(out) == results(whole)
    assert not list(out.glob(".*.part")) and not list(out.glob("*.claim"))
    if command == "sweep":
        manifest = shards.read_manifest(out)
        assert all(shards.read_shard(out, manifest, i) is not None for i in range(manifest.shards))
