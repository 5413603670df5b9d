"""Sensors: numbers by hand, and what a law that is told something else than the truth does."""

import jax.numpy as jnp
import numpy as np
import pytest

import agvjax


def measured(position, velocity, heading, yaw_rate):
    place = {"position": jnp.array(position), "velocity": jnp.array(velocity)}
    return agvjax.Measurement(**place, heading=jnp.asarray(heading), yaw_rate=jnp.asarray(yaw_rate))


def test_a_sensor_beside_the_reference_point_tells_where_it_is_itself():
    """Heading north: 0.2 m ahead is 0.2 m north, 0.1 m to the left 0.1 m west; it turns about the reference point."""
    sensor = agvjax.Mounted(ahead=0.2, left=0.1, turned=0.05)
    told = sensor.seen(measured([3.0, 4.0], [0.0, 1.0], np.pi / 2, 0.5))
    np.testing.assert_allclose(told.position, [2.9, 4.2], atol=1e-12)
    np.testing.assert_allclose(told.velocity, [-0.1, 0.95], atol=1e-12)
    np.testing.assert_allclose([told.heading, told.yaw_rate], [np.pi / 2 + 0.05, 0.5], atol=1e-12)


def test_the_velocity_that_it_tells_is_the_rate_of_the_position_that_it_tells():
    """Along an arc of a metre's radius, at 0.7 rad/s."""
    sensor, h = agvjax.Mounted(ahead=0.3, left=-0.2, turned=0.1), 1e-5

    def told(t):
        turn = 0.7 * t
        place, way = [np.sin(turn), 1 - np.cos(turn)], [0.7 * np.cos(turn), 0.7 * np.sin(turn)]
        return sensor.seen(measured(place, way, turn, 0.7))

    rate = (told(2.0 + h).position - told(2.0 - h).position) / (2 * h)
    np.testing.assert_allclose(told(2.0).velocity, rate, atol=1e-9)


@pytest.mark.slow
def test_a_law_that_is_told_another_place_drives_that_place_along_the_path():
    """A sensor 5 cm to the left: on a straight route the robot ends 5 cm to the right of it."""
    route = agvjax.Route.through([[0.0, 0.0], [6.0, 0.0]], speed=0.5)
    ends = []
    for sensor in (None, agvjax.Mounted(left=0.05)):
        still = {"disturbance": agvjax.NoDisturbance(), "start": agvjax.Start(velocity=np.zeros(2))}
        scenario = agvjax.Scenario.of(agvjax.Base(), path=route, sensor=sensor, **still)
        law = agvjax.Sampled(inner=agvjax.PathPID(), vehicle=agvjax.Base(), period=0.05)
        run = agvjax.simulate(law, scenario, dt=0.01, n_steps=1500)
        assert run.ok
        ends.append(float(run.position[-1][1]))
    assert abs(ends[0]) < 0.01  # what the deadzones leave
    assert abs(ends[1] - ends[0] + 0.05) < 3e-3
