"""The deadzone as printed, (11), as slope times command plus residual, (12), and by hand."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import reference as independent
from agvjax import Deadzone

slopes = st.floats(0.01, 10)
thresholds = st.floats(0, 5)
few = settings(max_examples=50, deadline=None)


@few
@given(slopes, slopes, thresholds, thresholds, st.lists(st.floats(-20, 20), min_size=1, max_size=8))
def test_deadzone_is_slope_times_command_plus_residual(right, left, s_right, s_left, commands):
    dz = Deadzone(slope_right=right, slope_left=left, threshold_right=s_right, threshold_left=s_left)
    u = jnp.array([*commands, s_right, -s_left, 0.0])
    scale = max(right, left) * (20 + max(s_right, s_left))
    np.testing.assert_allclose(
        dz(u), independent.deadzone(np.asarray(u), right, left, s_right, s_left), atol=1e-14 * scale
    )
    np.testing.assert_allclose(dz.slope(u) * u + dz.residual(u), dz(u), rtol=0, atol=1e-14 * scale)  # (12) == (11)
    assert (np.abs(dz.residual(u)) <= max(right * s_right, left * s_left) * (1 + 1e-12)).all()  # after (14)


def test_deadzone_by_hand():
    dz = Deadzone(slope_right=0.6, slope_left=0.8, threshold_right=0.5, threshold_left=0.4)
    u = jnp.array([-2.4, -0.4, -0.39, 0.0, 0.49, 0.5, 1.5])
    np.testing.assert_allclose(dz(u), [-1.6, 0, 0, 0, 0, 0, 0.6], atol=1e-15)
    np.testing.assert_allclose(jax.vmap(jax.grad(dz))(jnp.array([-2.0, -0.3, 0.3, 2.0])), [0.8, 0, 0, 0.6])
    np.testing.assert_array_equal(Deadzone()(u), u)
