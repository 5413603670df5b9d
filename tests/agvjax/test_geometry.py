"""Angles: wrapped to half a turn, and a bearing that has a value and a slope everywhere."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from agvjax import Bearing, Dumbbell, Line, Tangent
from agvjax.geometry import bearing, wrap
from agvjax.paths.heading import reference
from agvjax.readings import RawBearing, SwappedBearing

few = settings(max_examples=50, deadline=None)


@few
@given(st.floats(-1000, 1000))
def test_wrap_is_the_same_angle_in_half_a_turn_either_side(angle):
    wrapped = float(wrap(jnp.array(angle)))
    assert abs(wrapped) <= np.pi * (1 + 1e-15) + 1e-13  # 1e-13: the rounding of 1000 rad
    turns = (angle - wrapped) / (2 * np.pi)
    assert abs(turns - round(turns)) < 1e-12
    assert float(jax.grad(wrap)(jnp.array(angle))) == 1.0


def test_bearing_has_value_and_derivative_zero_where_it_is_undefined():
    zero = jnp.array(0.0)
    for function in (bearing, jax.grad(bearing, 0), jax.grad(bearing, 1)):
        assert float(function(zero, zero)) == 0.0
    # jvp of the whole reference at t = 0, where the dumbbell is at the origin
    for heading in (RawBearing(), SwappedBearing(), Tangent(), Bearing()):
        assert all(np.isfinite(np.asarray(x)).all() for x in jax.tree.leaves(reference(Dumbbell(), heading, zero)))
    standing = reference(Line(velocity=np.zeros(2)), None, zero)
    assert float(standing.heading) == 0.0 and float(standing.heading_rate) == 0.0
    y, x = jnp.array([0.3, -2.0, 1.0, 0.0]), jnp.array([-1.0, -0.1, 0.0, -2.0])
    np.testing.assert_allclose(jax.vmap(bearing)(y, x), np.arctan2(y, x), rtol=1e-15)
    np.testing.assert_allclose(jax.grad(bearing, (0, 1))(jnp.array(3.0), jnp.array(4.0)), (4 / 25, -3 / 25), rtol=1e-14)
