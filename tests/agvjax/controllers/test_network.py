"""The network of radial basis functions by hand, (20)."""

import jax.numpy as jnp
import numpy as np

from agvjax import RadialBasis


def test_network_by_hand():
    net = RadialBasis()
    np.testing.assert_allclose(net(jnp.array(0.0)), np.exp([-18, -4.5, 0, -4.5, -18]), rtol=1e-14)  # c^2 / .5
    # two coordinates: node i sits at (c_i, c_i), so (1.5, 0) is (4.5, 1.5) from node 1: 22.5 / .5 = 45
    squared = np.array([4.5**2 + 9, 9 + 2.25, 2.25, 2.25, 2.25 + 9])
    np.testing.assert_allclose(net(jnp.array([1.5, 0.0])), np.exp(-squared / 0.5), rtol=1e-14)
    np.testing.assert_allclose(net.energy(jnp.array([1.5, 0.0])), np.exp(-4 * squared).sum(), rtol=1e-14)
    wide = RadialBasis(centers=np.array([1.0]), width=2.0)
    np.testing.assert_allclose(wide(jnp.array([2.0, 0.0, 1.0])), [np.exp(-1.0)], rtol=1e-14)
