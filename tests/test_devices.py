"""Sharing a batch between devices changes no metric and no derivative. Each check needs a process of its own."""

import os
import subprocess
import sys

import pytest

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


@pytest.mark.slow
def test_metrics_and_derivatives_do_not_depend_on_the_devices():
    environment = {**os.environ, "JAX_NUM_CPU_DEVICES": "4"}
    done = subprocess.run([sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=False)
    assert done.stdout == "fine\n", done.stderr
