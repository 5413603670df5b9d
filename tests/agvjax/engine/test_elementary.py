"""The exponential of the fast form against extended precision, its edges and its derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from agvjax.engine.elementary import exp_p

exp = jax.jit(exp_p.bind)


@pytest.mark.parametrize(("dtype", "most"), [(np.float32, 87.0), (np.float64, 708.0)])
def test_error_is_two_units_and_what_rounding_the_argument_costs(dtype, most):
    x = np.concatenate([np.random.default_rng(0).uniform(-most, most, 50_000), np.linspace(-2, 2, 50_001)]).astype(
        dtype
    )
    exact = np.exp(x.astype(np.longdouble))
    error = np.abs(np.asarray(exp(x)) - exact) / exact / np.finfo(dtype).eps
    assert np.all(error <= 2 + np.abs(x))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_edges(dtype):
    edge = np.array([0.0, -0.0, np.nan, -np.inf, -1e5, 1e5, np.inf], dtype)
    tiny = np.finfo(dtype).tiny
    np.testing.assert_array_equal(exp(edge)[:5], np.array([1, 1, np.nan, tiny, tiny], dtype))
    assert not np.any(np.isfinite(exp(edge)[5:]))


def test_derivatives_are_the_value():
    x = jnp.array([-3.0, -0.2, 0.0, 1.5])
    for derivative in (jax.grad, jax.jacfwd, lambda f: jax.grad(jax.grad(f))):
        np.testing.assert_allclose(jax.vmap(derivative(exp_p.bind))(x), np.exp(x), rtol=1e-14)
