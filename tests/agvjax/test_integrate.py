"""Integrators: their Taylor polynomial, their instants, the edge of their stability."""

import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from agvjax import EULER, HEUN, RK4, NeuroBackstepping


@pytest.mark.parametrize(
    ("method", "taylor"), [(EULER, [1, 1]), (HEUN, [1, 1, 1 / 2]), (RK4, [1, 1, 1 / 2, 1 / 6, 1 / 24])]
)
def test_one_step_multiplies_a_mode_by_the_taylor_polynomial(method, taylor):
    for z in (-0.7 + 0.4j, -2.0, 1.1j, -2.5 + 0.1j):
        R = sum(c * z**k for k, c in enumerate(taylor))
        assert method.amplification(z) == pytest.approx(abs(R), rel=1e-13)
        # x' = lambda x as a real system, the method as it is used
        matrix = jnp.array([[z.real, -z.imag], [z.imag, z.real]]) / 0.5
        end, seen = method.advance(
            lambda x, signal, A=matrix: (A @ x, signal), jnp.array([1.0, 0.0]), 0.5, method.nodes
        )
        np.testing.assert_allclose(end, [R.real, R.imag], atol=1e-13)
        assert seen == 0.0


def test_methods_look_at_the_instants_of_their_nodes():
    # quadrature of t^3 on [0, 2]: RK4 is Simpson's rule, exact; Heun the trapezoid; Euler the left end
    for method, wanted in ((EULER, 0.0), (HEUN, 8.0), (RK4, 4.0)):
        times = [2.0 * node for node in method.nodes]
        end, _ = method.advance(lambda x, t: (t**3, ()), 0.0, 2.0, times)
        assert end == pytest.approx(wanted, abs=1e-14)


def test_stable_step_is_the_edge_of_the_stability_region():
    assert RK4.stable_step(np.array([-1.0])) == pytest.approx(2.785, rel=2e-3)
    assert RK4.stable_step(np.array([-100.0, -1.0])) == pytest.approx(0.02785, rel=2e-3)
    assert RK4.stable_step(np.array([1j, -1j])) == pytest.approx(2.828, rel=2e-3)
    assert EULER.stable_step(np.array([-4.0])) == pytest.approx(0.5, rel=2e-3)
    assert HEUN.stable_step(np.array([-4.0])) == pytest.approx(0.5, rel=2e-3)
    # Euler on a damped pair: |1 + h s| = 1 at h = 2 zeta / omega_n
    poles = NeuroBackstepping().poles()
    np.testing.assert_allclose(sorted(poles.imag), [-90 * np.sqrt(1 - 0.75**2), 90 * np.sqrt(1 - 0.75**2)], rtol=1e-12)
    assert EULER.stable_step(poles) == pytest.approx(2 * 0.75 / 90, rel=2e-3)


def test_error_of_a_mode_is_the_first_term_a_method_leaves_out():
    z = 0.01
    for method, wanted in ((agvjax.EULER, z / 2), (agvjax.HEUN, z**2 / 6), (agvjax.RK4, z**4 / 120)):
        assert method.error(z) == pytest.approx(wanted, rel=0.01)
