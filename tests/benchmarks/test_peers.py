"""The benchmark's peers run the same loop as `evaluate`."""

import importlib
import shutil
import sys

import jax
import numpy as np
import pytest

import agvjax
import reference as r
from commands import ROOT
from tuning import default_draws, sample

DT, N_STEPS, B = 5e-3, 60, 11  # no multiple of a register's width
DOUBLE = {"float64": 1e-9}
BOTH = DOUBLE | {"float32": 1e-4}
# the error integrated as a state, not summed by the trapezoid: 1e-3 of the RMSE this early, 5e-4 over a lap
SOLVERS = {"float64": 5e-3}
PEERS = [
    ("numpy_batch", "numpy", BOTH, {}),
    ("numba_loop", "numba", BOTH, {}),
    ("c_loop", "numpy", BOTH, {}),
    ("c_loop", "numpy", BOTH, {"scalar": True}),
    ("casadi_loop", "casadi", DOUBLE, {}),
    ("casadi_loop", "casadi", DOUBLE, {"compiled": True}),
    ("scipy_ivp", "scipy", SOLVERS, {}),
    ("diffrax_loop", "diffrax", SOLVERS | {"float32": 5e-3}, {}),
]
CASES = [(*peer[:2], dtype, rtol, peer[3]) for peer in PEERS for dtype, rtol in peer[2].items()]


@pytest.fixture(scope="module")
def batch():
    return sample(agvjax.Scenario(), default_draws(), B, seed=0)


@pytest.fixture(autouse=True)
def as_at_home(monkeypatch):
    """The peers are found beside the benchmark, and JAX promotes as its libraries expect."""
    monkeypatch.setattr(sys, "path", [str(ROOT / "benchmarks"), *sys.path])
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        yield


def rmse(name, values, *, dtype, n_steps=N_STEPS, **options):
    module = importlib.import_module(f"peers.{name}")
    return module.contestant(values, dt=DT, n_steps=n_steps, dtype=dtype, **options)()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "needs", "dtype", "rtol", "options"), CASES)
@pytest.mark.filterwarnings("default")  # what other libraries warn of is not ours
def test_a_peer_agrees_with_evaluate(batch, name, needs, dtype, rtol, options):
    pytest.importorskip(needs)
    if (name == "c_loop" or "compiled" in options) and shutil.which("gcc") is None:
        pytest.skip("no gcc")
    found = rmse(name, batch.values, dtype=dtype, **options)
    expected = agvjax.evaluate(agvjax.NeuroBackstepping(), batch, dt=DT, n_steps=N_STEPS).total_rmse
    assert found.shape == (B,) and found.dtype == dtype
    np.testing.assert_allclose(found, expected, rtol=rtol)


def test_a_peer_agrees_with_the_reference(batch):
    v, n_steps = {name: value[0].tolist() for name, value in batch.values.items()}, 600
    numbers = {
        prefix + part: v[f"deadzone.{channel}.{part}"]
        for channel, prefix in (("position", ""), ("heading", "heading_"))
        for part in ("slope_right", "slope_left", "threshold_right", "threshold_left")
    }
    p = r.Parameters(
        start_position=tuple(v["start.position"]),
        start_heading=v["start.heading"],
        disturbance_amplitude=(v["disturbance.amplitude"],) * 3,
        **numbers,
    )
    times, states = r.rk4(p, DT, n_steps)
    expected = np.linalg.norm(r.trapezoid_rmse(times, r.errors(times, states, p)))
    found = rmse(
        "numpy_batch", {name: value[:1] for name, value in batch.values.items()}, dtype="float64", n_steps=n_steps
    )
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_a_missing_compiler_is_named(batch, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(RuntimeError, match="needs gcc"):
        rmse("c_loop", batch.values, dtype="float64")


@pytest.mark.parametrize(("name", "needs"), [("scipy_ivp", "scipy"), ("casadi_loop", "casadi")])
def test_double_precision_only_is_said(batch, name, needs):
    pytest.importorskip(needs)
    with pytest.raises(ValueError, match="float64, not float32"):
        rmse(name, batch.values, dtype="float32")
