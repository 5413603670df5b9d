"""Sharing a batch between devices changes no metric and no derivative. Each check needs a process of its own."""

import ast
import os
import sys

import pytest

import agvjax
from agvjax.engine import xla
from commands import ROOT, python, run

PROGRAM = """
import jax, jax.numpy as jnp, numpy as np
jax.config.update("jax_enable_x64", True)
import agvjax
values = {"start.heading": np.linspace(-0.5, 1.0, 10), "deadzone.heading.slope_left": np.linspace(0.4, 1.0, 10)}

def total(k1, shares, values):
    many = agvjax.batch(agvjax.Scenario(), values)
    law = agvjax.replace(agvjax.NeuroBackstepping(), {"k1": k1})
    return agvjax.evaluate(law, many, n_steps=300, block=2, devices=shares).rmse

assert jax.local_device_count() == 4
one, three, four = (np.asarray(total(20.0, n, values)) for n in (1, 3, 4))
assert one.shape == (10, 3) and len(np.unique(one[:, 2])) == 10
np.testing.assert_allclose(three, one, rtol=1e-12)
np.testing.assert_allclose(four, one, rtol=1e-12)
one, four = (jax.jvp(lambda k: total(k, n, values), (20.0,), (1.0,))[1] for n in (1, 4))
np.testing.assert_allclose(four, one, rtol=1e-9)
one, four = (jax.grad(lambda k, v: total(k, n, v).sum(), argnums=(0, 1))(20.0, values) for n in (1, 4))
for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(four), strict=True):
    assert np.any(a != 0)
    np.testing.assert_allclose(b, a, rtol=1e-9, atol=1e-13)
law = agvjax.NeuroBackstepping()
mapped = jax.vmap(lambda k: total(k, 4, values))(jnp.array([20.0, 25.0]))
np.testing.assert_allclose(mapped[0], np.asarray(total(20.0, 1, values)), rtol=1e-12)
for bad in (0, 5):
    try:
        total(20.0, bad, values)
    except ValueError as error:
        assert "devices must be from 1 to the 4" in str(error)
    else:
        raise AssertionError(bad)
print("fine")
"""


@pytest.fixture(autouse=True)
def devices_as_jax_finds_them(monkeypatch):
    monkeypatch.delenv("JAX_NUM_CPU_DEVICES", raising=False)


ASK = """
import agvjax, jax, os
print(agvjax.tune_xla({}))
print(jax.local_device_count(), os.environ.get("XLA_FLAGS"))
"""
LATE = """
import agvjax, jax
before = jax.local_device_count()
print(agvjax.tune_xla())
print(jax.local_device_count() - before)
"""
AGAIN = """
import agvjax, jax
agvjax.tune_xla()
jax.devices()
print(agvjax.tune_xla())
"""
OWN = "--xla_backend_extra_options=xla_cpu_use_multi_output_fusion=false"


def test_a_second_call_says_that_the_options_are_set():
    assert python(AGAIN) == "fast compiler options are set already\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "environment", "devices", "said"),
    [
        ("devices=3", {}, 3, "fast compiler options set"),
        ("", {"JAX_NUM_CPU_DEVICES": "2"}, 2, "fast compiler options set"),
        pytest.param(
            "",
            {"XLA_FLAGS": "--xla_force_host_platform_device_count=4"},
            4,
            "fast compiler options set",
            marks=pytest.mark.slow,
        ),
        ("devices=1", {"XLA_FLAGS": OWN}, 1, "already holds backend options"),
    ],
)
def test_options_and_devices_are_set_unless_they_are_set_already(options, environment, devices, said):
    sentence, counted = python(ASK.format(options), **environment).splitlines()
    assert said in sentence
    count, flags = counted.split(" ", 1)
    assert int(count) == devices
    assert flags == OWN if OWN in environment.values() else "small_while_loop" in flags


IMPORTED = """
import os, agvjax, jax
print("small_while_loop" in os.environ.get("XLA_FLAGS", ""), "own" in os.environ.get("XLA_FLAGS", ""))
print(agvjax.tune_xla(devices=1))
print(agvjax.tune_xla(reverse=True, devices=1))
print("small_while_loop" in os.environ.get("XLA_FLAGS", ""))
jax.devices()
print(agvjax.tune_xla())
"""


@pytest.mark.parametrize(
    ("environment", "first"),
    [
        ({"AGVJAX_XLA": ""}, "True False"),
        pytest.param({"AGVJAX_XLA": "0"}, "False False", marks=pytest.mark.slow),
        pytest.param({"JAX_PLATFORMS": "tpu"}, "False False", marks=pytest.mark.slow),
    ],
)
def test_an_import_sets_options_and_later_calls_do_not_contradict(environment, first):
    program = IMPORTED if "JAX_PLATFORMS" not in environment else "\n".join(IMPORTED.splitlines()[:3])
    said = python(program, **{"AGVJAX_XLA": "", "JAX_PLATFORMS": "cpu"} | environment).splitlines()
    assert said[0] == first
    if said[1:]:
        forward, reverse, whole, again = said[1:]
        assert forward == reverse == "fast compiler options set" and whole == "False"
        assert again.startswith("fast compiler options are set already, those for reverse mode")


def test_an_import_leaves_options_of_ones_own():
    assert python(IMPORTED.partition("print(agvjax")[0], AGVJAX_XLA="", XLA_FLAGS=f"{OWN},own=1") == "False True\n"


SLOW = """
import functools, sys, warnings
import jax
if "started" in sys.argv:
    jax.devices()
import agvjax
law, shape = agvjax.NeuroBackstepping(), functools.partial(agvjax.evaluate, n_steps=10)
with warnings.catch_warnings(record=True) as seen:
    warnings.simplefilter("always")
    for scenario in (agvjax.Scenario(), agvjax.Scenario(path=agvjax.Circle())):
        jax.eval_shape(shape, law, scenario)
print(len(seen), *(str(one.message) for one in seen))
"""


@pytest.mark.slow
def test_a_process_that_runs_slowly_is_told_so_once():
    late = SLOW.replace("sys.argv", "['started']")
    said = python(late, AGVJAX_XLA="", JAX_PLATFORMS="cpu")
    assert said.startswith("1 ") and "JAX had started" in said and "agvjax.tune_xla()" in said
    for program, options in ((late, {"AGVJAX_XLA": "0"}), (SLOW, {"AGVJAX_XLA": ""})):
        assert python(program, **options, JAX_PLATFORMS="cpu") == "0\n"


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ([(2.0, 0.0), (20.0, 0.0)], ["fast compiler options set"]),
        ([(18.0, 0.0), (20.0, 0.0)], ["accepts", "does nothing", "jaxlib<0."]),
        ([None, (20.0, 0.0)], ["refuses", "jaxlib<0."]),
    ],
)
def test_a_release_that_nobody_tried_is_asked_once(monkeypatch, tmp_path, asked, said):
    runs = iter(asked)
    monkeypatch.setattr(xla, "TRIED", ((0, 0), (0, 1)))
    monkeypatch.setattr(xla, "started", lambda: False)
    monkeypatch.setattr(xla, "_set_devices", lambda count: None)
    monkeypatch.setattr(xla.reproducer, "asked", lambda flags: next(runs))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for _ in range(2):  # the second time from what was kept: there is no third run
        monkeypatch.delenv("XLA_FLAGS", raising=False)
        sentence = agvjax.tune_xla(devices=1)
        assert all(word in sentence for word in said)
        assert ("xla_backend_extra_options" in os.environ.get("XLA_FLAGS", "")) == ("set" in sentence)
    (kept,) = (tmp_path / "agvjax").iterdir()
    kept.write_text("{")  # damaged: measured again
    with pytest.raises(StopIteration):
        agvjax.tune_xla(devices=1)


def test_the_reproducer_for_upstream_imports_jax_alone():
    tree = ast.parse((ROOT / "agvjax" / "engine" / "reproducer.py").read_text())
    found = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    assert found - set(sys.stdlib_module_names) == {"jax", "jax.numpy"}
    assert not [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]


def test_too_late_is_said_and_changes_nothing():
    sentence, change = python(LATE).splitlines()
    assert "already started" in sentence and "slower" in sentence and change == "0"


@pytest.mark.slow
def test_metrics_and_derivatives_do_not_depend_on_the_devices():
    assert python(PROGRAM, JAX_NUM_CPU_DEVICES="4") == "fine\n"


@pytest.mark.slow
def test_the_kernel_for_gpus_agrees_with_evaluate():
    small = ["--interpret", "--batches", "8", "--block", "4", "--steps", "20"]
    said, _ = run(small, program=("-m", "benchmarks.gpu"))
    difference = float(said.strip().splitlines()[-1].split("|")[3])
    assert 0 < difference < 1e-8
