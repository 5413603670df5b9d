"""The smooth settling time beside the true one, and a square root whose slope is finite."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from agvjax.metrics import safe_sqrt
from runs import trajectory


def test_safe_sqrt_has_no_infinite_derivative():
    np.testing.assert_allclose(jax.vmap(jax.value_and_grad(safe_sqrt))(jnp.array([0.0, 4.0])), ([0, 2], [0, 0.25]))


def settling(error, t, smooth=True):
    """True and smooth settling time of a run whose error in x is given."""
    run = trajectory(t, position=jnp.stack([error, jnp.zeros_like(t)], axis=1))
    metrics = agvjax.measure(run, agvjax.Criteria(smooth=smooth))
    return metrics.settling_time[0], metrics.settling_smooth[0] if smooth else metrics.settling_smooth


@pytest.mark.parametrize("tau", [0.2, 0.5, 1.5])
def test_the_smooth_settling_time_of_a_decaying_error_is_the_true_one_and_so_is_its_slope(tau):
    t = jnp.arange(0, 12.0, 1e-3)
    true, smooth = settling(0.8 * jnp.exp(-t / tau), t)
    exact = tau * np.log(0.8 / 0.05)
    np.testing.assert_allclose(true, exact, atol=2e-3)
    np.testing.assert_allclose(smooth, exact, rtol=0.06)  # later by the softness of the band
    slope = jax.jacfwd(lambda a: settling(0.8 * jnp.exp(-t / a), t)[1])(tau)
    np.testing.assert_allclose(slope, np.log(0.8 / 0.05), rtol=0.06)  # d/d tau of tau ln(e0 / band)


@pytest.mark.slow
def test_the_smooth_settling_time_sees_a_later_crossing_come_before_it_counts():
    t = jnp.arange(0, 12.0, 1e-3)

    def both(height):
        return settling(0.8 * jnp.exp(-t / 0.3) + height * jnp.exp(-((t - 4.0) ** 2) / 0.02), t)

    def steps(count):
        heights = jnp.linspace(0.02, 0.08, count)
        return [np.diff(np.asarray(x)) for x in jax.jit(jax.vmap(both))(heights)]

    (true, smooth), (finer_true, finer) = steps(31), steps(241)
    assert min(true.max(), finer_true.max()) > 2.5  # the true one jumps by three seconds, however closely one looks
    assert np.all(finer >= -1e-12) and finer.max() < 0.5 * smooth.max() < 0.6  # the smooth one rises
    assert jax.jacfwd(lambda h: both(h)[1])(0.045) > 10 * abs(jax.jacfwd(lambda h: both(h)[0])(0.045))


def test_a_run_that_has_not_settled_counts_its_horizon_with_the_slope_of_the_time_outside():
    t = jnp.arange(0, 3.0, 1e-3)
    true, smooth = settling(0.8 * jnp.exp(-t / 2.0), t)
    assert np.isinf(true)
    np.testing.assert_allclose(smooth, t[-1], rtol=1e-3)
    assert settling(0.8 * jnp.exp(-t / 2.0), t, smooth=False)[1] is None
    assert jax.jacfwd(lambda a: settling(0.8 * jnp.exp(-t / a), t)[1])(0.9) > 0.5
