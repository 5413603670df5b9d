"""Disturbances by hand."""

import jax.numpy as jnp
import numpy as np

from agvjax import Cosine, CosineSum, NoDisturbance, Step


def test_disturbances_by_hand():
    t = jnp.array(3.0)
    np.testing.assert_allclose(Cosine()(t), [0.2 * np.cos(1.5)] * 3, rtol=1e-14)
    each = Cosine(amplitude=np.array([1.0, 2.0, 3.0]), omega=np.array([0.0, 1.0, 2.0]), phase=np.array([0.0, 0.5, 1.0]))
    np.testing.assert_allclose(each(t), [1, 2 * np.cos(3.5), 3 * np.cos(7.0)], rtol=1e-14)
    step = Step(amplitude=np.array([1.0, 0.0, -2.0]), time=3.0)
    np.testing.assert_array_equal(step(t), [1, 0, -2])
    np.testing.assert_array_equal(step(jnp.array(2.999)), [0, 0, 0])
    sum_of_two = CosineSum(amplitudes=np.array([0.3, -0.1]), omegas=np.array([1.0, 5.0]), phases=np.array([0.2, 0.0]))
    np.testing.assert_allclose(sum_of_two(t), [0.3 * np.cos(3.2) - 0.1 * np.cos(15.0)] * 3, rtol=1e-14)
    np.testing.assert_array_equal(NoDisturbance()(t), [0, 0, 0])
    for disturbance in (Cosine(), each, step, sum_of_two, NoDisturbance()):
        assert disturbance(t).shape == (3,)
