"""Recorded drives as waypoints, of drives made here whose speeds and stops are known."""

import numpy as np
import pytest

from tuning.io import drives

NOISE, SPEED, RADIUS = 0.01, 1.0, 8.0  # m, m/s, m


def driven(noise=NOISE, before=10.0, between=6.0, rate=20.0, seed=1):
    """A drive round half a circle that stands before it begins and once on its way: t and points."""
    way = np.pi * RADIUS
    go, halt = way / SPEED, way / 2
    t = np.arange(0, before + go + between, 1 / rate)
    s = np.clip(SPEED * (t - before), 0, halt) + np.clip(SPEED * (t - before - halt / SPEED - between), 0, halt)
    points = RADIUS * np.column_stack([np.sin(s / RADIUS), 1 - np.cos(s / RADIUS)])
    return t, points + noise * np.random.default_rng(seed).normal(size=points.shape)


@pytest.mark.parametrize("seed", range(5))
def test_standing_and_jitter_are_left_out_and_the_speed_is_that_of_the_drive(seed):
    t, points = driven(seed=seed)
    kept = drives.thinned(points, False, True)
    gaps = np.linalg.norm(np.diff(points[kept.rows], axis=0), axis=1)
    assert kept.rows[0] == 0 and kept.rows[-1] == len(t) - 1 and np.all(np.diff(kept.rows) > 0)
    assert gaps[:-1].min() >= kept.spacing > 5 * NOISE and gaps.min() >= kept.spacing / 2
    speed, stood = drives.speeds(points, t, kept)
    assert np.median(speed) == pytest.approx(SPEED, rel=0.05)
    assert stood == pytest.approx(16.0, abs=2.0)  # s at rest: 10 before it begins, 6 on its way
    assert speed.min() > SPEED / 3


def test_a_drive_without_noise_that_never_stands_keeps_every_point():
    t, points = driven(noise=0.0, before=0.0, between=0.0)
    kept = drives.thinned(points, False, True)
    assert kept.spacing == 0 and len(kept.rows) == len(t)
    speed, stood = drives.speeds(points, t, kept)
    np.testing.assert_allclose(speed, SPEED, rtol=1e-3)  # chords are shorter than arcs
    assert stood < 1e-9


def test_few_points_without_times_are_never_thinned():
    corners = np.array([[0, 0], [10, 0], [10, 0], [10, 5]], float)
    assert drives.thinned(corners, False, False).rows.tolist() == [0, 1, 2, 3]  # one given twice is refused later


def test_a_dense_track_without_times_is_thinned_only_where_no_path_goes_through_it():
    _, points = driven(before=5.0)
    assert drives.thinned(points, False, False).spacing > 0
    _, points = driven(noise=0.0, before=0.0, between=0.0)
    assert drives.thinned(points, False, False).spacing == 0


def test_points_in_one_place_make_no_path():
    with pytest.raises(ValueError, match="say spacing"):
        drives.thinned(np.random.default_rng(0).normal(size=(200, 2)), False, True)


def test_points_are_at_least_a_spacing_apart_and_end_with_the_last():
    line = np.column_stack([np.arange(0, 1.01, 0.1), np.zeros(11)])
    assert drives.apart(line, 0.35).rows.tolist() == [0, 4, 8, 10]  # .2 m are more than half
    assert drives.apart(line, 0.45).rows.tolist() == [0, 5, 10]
    assert drives.apart(line[:10], 0.35).rows.tolist() == [0, 4, 9]  # .1 m after .8: the last stands for it


def test_where_the_speed_is_zero_a_crawl_stands_in_the_direction_of_what_is_near():
    speed, still = drives.moving(np.array([0.0, 2.0, 1e-4, -1.0, 0.0]))
    assert still == 3
    np.testing.assert_allclose(speed, [0.1, 2.0, 0.1, -1.0, -0.1])
    assert drives.moving(np.zeros(3))[1] == 0 and drives.moving(np.ones(3))[1] == 0


@pytest.mark.parametrize("fixes", [1, 61])
def test_a_stop_between_two_points_of_a_slow_log_is_no_slow_driving(fixes):
    """1 m/s at 1 Hz, and a minute at rest at the tenth point: in one step, or with a fix a second."""
    x, stop = np.arange(30.0), np.full(fixes - 1, 10.0)
    points = np.column_stack([np.concatenate([x[:11], stop, x[11:]]), np.zeros(30 + fixes - 1)])
    t = np.concatenate([np.arange(11.0), 10 + np.arange(1.0, fixes), 71 + np.arange(19.0)])
    speed, stood = drives.speeds(points, t, drives.apart(points, 0.5))
    np.testing.assert_allclose(speed, 1.0)
    assert stood == pytest.approx(60.0)
