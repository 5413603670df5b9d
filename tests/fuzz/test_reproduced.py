"""Calls of the command line that broke a rule once, each as the fuzzer drew it or as a person cut it down."""

import contextlib
import io
import os
import subprocess
import sys
import time
from pathlib import Path

import jax
import numpy as np
import pytest
from rules import Answer, broken

import agvjax
from tuning.cli.main import main
from tuning.compute import compiled

pytestmark = pytest.mark.slow  # whole commands and programs, minutes in all

SMALL = ["--set", "simulate.horizon=0.2", "--set", "simulate.dt=0.005", "--set", "simulate.integrator=euler"]
SWEEP = ["--set", "sweep.dt=0.005", "--set", "sweep.integrator=euler", "--set", "sweep.radius=false"]
REPRODUCED = [  # arguments, and files by name in hexadecimal
    (["simulate", "--set", "a=" + "[" * 5000], {}),
    (["simulate", "--set", "controller.k1=" + "1" * 5000], {}),
    (["simulate", "--set", ".".join("a" * 600) + "=1"], {}),
    (["simulate", "--config", "mine.toml"], {"mine.toml": (b"a." * 100_000 + b"b = 1").hex()}),
    (["tune", "--resume", "--out", "out"], {"out/config.toml": b"x =".hex()}),
    (["sweep", "--out", "out"], {"out/manifest.json": (b"[" * 100_000).hex()}),
    (["sweep", "--out", "out"], {"out/manifest.json": b'{"format": 1, "size": "64"}'.hex()}),
    (["simulate", "--from", "out", "--index", "0"], {"out/manifest.json": b"[]".hex()}),
    (["export", "gains.toml", "--format", "c"], {"gains.toml": (b"a = " + b"{a=" * 400 + b"1" + b"}" * 400).hex()}),
    (["tune", "--coordinator", "localhost", "--num-processes", "2", "--process-id", "0"], {}),
    (["tune", "--set", "tune.optimizer=noisy_sgd"], {}),
    (
        ["simulate", "--out", "out", *SMALL, "--config", "unicycle", "--set", "scenario.path.omega=2215.8026590121613"],
        {},
    ),
    (["sweep", "--out", "out", *SMALL, *SWEEP, "--config", "unicycle", "--set", "controller.inner.k1=1_000"], {}),
]


@pytest.fixture(autouse=True)
def state_of_jax_left_alone(monkeypatch, tmp_path_factory):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
    monkeypatch.setattr(compiled, "keep_compiled", lambda: None)
    monkeypatch.setattr(agvjax, "tune_xla", lambda **_: "fast compiler options set")
    yield
    jax.config.update("jax_enable_x64", True)


@pytest.mark.filterwarnings("ignore:Specifying a key:UserWarning")  # of noisy_sgd
@pytest.mark.parametrize("case", REPRODUCED, ids=lambda case: " ".join(case[0])[:60] + case[0][-1][:20])
def test_what_broke_a_rule_once_breaks_none_now(case, tmp_path, monkeypatch):
    argv, given = case
    monkeypatch.chdir(tmp_path)
    for name, data in given.items():
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_bytes(bytes.fromhex(data))
    before = [str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*")]
    said = io.StringIO()
    with contextlib.redirect_stderr(said):
        code = main(argv)
    assert broken(Answer(code, said.getvalue(), before, Path(os.getcwd()))) == []


@pytest.mark.parametrize("command", [["simulate"], ["simulate", "--config", "car"]], ids=" ".join)
def test_a_call_in_32_bits_after_one_in_64_whose_numbers_are_still_in_use(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main([*command, *SMALL, "--out", "double"]) == 0
    law = agvjax.NeuroBackstepping()
    kept = jax.jit(lambda: agvjax.simulate(law, agvjax.Scenario(), n_steps=2).position)
    kept()
    assert main([*command, *SMALL, "--out", "single", "--precision=32"]) == 0
    double, single = (np.load(f"{name}/trajectory.npz")["position"] for name in ("double", "single"))
    assert (double.dtype, single.dtype) == (np.float64, np.float32)
    np.testing.assert_allclose(single, double, atol=1e-3)


def test_fifty_inputs_break_no_rule():
    """Of a seed that changes from day to day; `make fuzz` takes more."""
    program, seed = str(Path(__file__).parent), str(int(time.time() // 86400) * 1000)
    argv = [sys.executable, program, "--seed", seed, "--count", "50", "--seconds", "240"]
    done = subprocess.run(argv, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-8000:] + done.stderr[-2000:]
