"""Paths and the headings they ask for: by hand, and beside an independent reference."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import reference as independent
from agvjax import Bearing, Circle, Dumbbell, Lemniscate, Line, Tangent, default_heading
from agvjax.paths.heading import reference
from agvjax.readings import RawBearing, SwappedBearing

TIMES = np.array([0.0, 0.7, 2.1, 2.9, 4.0, 5.5, 7.3, 11.0])


def all_of(path, heading, times=TIMES):
    return jax.vmap(lambda t: reference(path, heading, t))(jnp.asarray(times))


def test_dumbbell_and_its_derivatives():
    ref = all_of(Dumbbell(), None)
    for mine, wanted in zip((ref.position, ref.velocity, ref.acceleration), independent.path(TIMES), strict=True):
        np.testing.assert_allclose(mine, wanted, rtol=0, atol=1e-14)
    big = all_of(Dumbbell(amplitude=40.0, omega=0.1), None, [0.0])
    np.testing.assert_allclose(big.velocity[0], [8.0, 4.0], rtol=1e-14)


@pytest.mark.parametrize(
    ("heading", "name"),
    [
        (Bearing(), "bearing"),
        (RawBearing(), "bearing_raw"),
        (SwappedBearing(), "bearing_swapped"),
        (Tangent(), "tangent"),
    ],
)
def test_heading_readings_and_their_rates(heading, name):
    times = TIMES if name in ("bearing", "tangent") else TIMES[1:]  # (56) has no value at t = 0
    ref = all_of(Dumbbell(), heading, times)
    value, rate = independent.heading(times, name)
    np.testing.assert_allclose(ref.heading, value, rtol=0, atol=1e-13)
    np.testing.assert_allclose(ref.heading_rate, rate, rtol=0, atol=1e-12)


def test_bearing_is_the_printed_one_on_the_first_half_lap_and_pi_off_after():
    t = np.linspace(0.01, 5.98, 40)
    x, y = np.sin(22 / 21 * t), np.sin(11 / 21 * t)
    np.testing.assert_allclose(all_of(Dumbbell(), Bearing(), t).heading, np.arctan2(y, x), atol=1e-13)
    later = t + np.pi * 21 / 11
    smooth = np.asarray(all_of(Dumbbell(), Bearing(), later).heading)
    printed = np.arctan2(np.sin(11 / 21 * later), np.sin(22 / 21 * later))
    np.testing.assert_allclose(np.abs(smooth - printed), np.pi, atol=1e-12)


def test_default_heading_is_the_smooth_bearing_only_where_there_is_one():
    assert isinstance(default_heading(Dumbbell()), Bearing)
    for path in (Circle(), Lemniscate(), Line()):
        assert isinstance(default_heading(path), Tangent)
    np.testing.assert_array_equal(all_of(Circle(), None).heading, all_of(Circle(), Tangent()).heading)


def test_circle_by_hand():
    radius, omega = 2.0, 0.5
    ref = all_of(Circle(radius=radius, omega=omega), None)
    phase = omega * TIMES
    radial = np.column_stack([np.cos(phase), np.sin(phase)])
    np.testing.assert_allclose(ref.position, radius * radial, atol=1e-14)
    np.testing.assert_allclose(
        ref.velocity, radius * omega * np.column_stack([-np.sin(phase), np.cos(phase)]), atol=1e-14
    )
    np.testing.assert_allclose(ref.acceleration, -radius * omega**2 * radial, atol=1e-14)
    np.testing.assert_allclose(ref.heading_rate, omega, atol=1e-14)
    np.testing.assert_allclose(np.exp(1j * np.asarray(ref.heading)), np.exp(1j * (phase + np.pi / 2)), atol=1e-14)


def test_lemniscate_by_hand():
    a, w = 3.0, 0.5
    ref = all_of(Lemniscate(amplitude=a, omega=w), None, [0.0, np.pi / (2 * w), 1.3])
    # at the tip: (a, 0), moving up at a w, and x = a (1 - 3/2 (w t)^2 + ..), so x'' = -3 a w^2
    np.testing.assert_allclose(
        [ref.position[0], ref.velocity[0], ref.acceleration[0]], [[a, 0], [0, a * w], [-3 * a * w**2, 0]], atol=1e-14
    )
    # at the crossing w t = pi/2 + e: x = -a e / 2, y = -a e / 2 to first order; no acceleration by symmetry
    half = -a * w / 2
    np.testing.assert_allclose(
        [ref.position[1], ref.velocity[1], ref.acceleration[1]], [[0, 0], [half, half], [0, 0]], atol=1e-14
    )
    np.testing.assert_allclose(ref.heading[1], -0.75 * np.pi, rtol=1e-14)
    x, y = np.asarray(ref.position[2])
    np.testing.assert_allclose((x**2 + y**2) ** 2, a**2 * (x**2 - y**2), rtol=1e-13)  # Bernoulli's curve


def test_line_by_hand():
    ref = all_of(Line(origin=np.array([1.0, -2.0]), velocity=np.array([0.3, 0.4])), None, [0.0, 2.0])
    np.testing.assert_allclose(ref.position, [[1, -2], [1.6, -1.2]], rtol=1e-14)
    np.testing.assert_allclose(ref.velocity, [[0.3, 0.4]] * 2)
    np.testing.assert_array_equal(ref.acceleration, np.zeros((2, 2)))
    np.testing.assert_allclose(ref.heading, np.arctan2(0.4, 0.3))
    np.testing.assert_array_equal(ref.heading_rate, [0, 0])
