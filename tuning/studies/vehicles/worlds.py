"""Vehicles that are not ours, as worlds for `drive`: MuJoCo's robot and CommonRoad's single-track car."""

from __future__ import annotations

import importlib
from typing import Any

import jax.numpy as jnp
import numpy as np

import agvjax

from .robot import Robot


class RobotWorld:
    """The robot of `robot.xml`.

    Raises:
        ImportError: MuJoCo is not installed.
    """

    def __init__(self, L: float):
        self.robot = Robot(L=L)

    def reset(self, position: Any, velocity: Any, heading: float) -> None:
        """Its reference point there, its wheels rolling."""
        self.robot.reset(position, velocity, heading)

    def measure(self) -> agvjax.Measurement:
        """What is true."""
        position, velocity, heading, yaw_rate = (jnp.asarray(x) for x in self.robot.pose())
        return agvjax.Measurement(position=position, velocity=velocity, heading=heading, yaw_rate=yaw_rate)

    def apply(self, delivered: dict[str, float], period: float) -> None:
        """Torques at the wheels."""
        steps = round(period / self.robot.timestep)
        self.robot.step(delivered["torque_left"], delivered["torque_right"], steps)


class CommonRoadWorld:
    """The package's own function of the single-track model and parameters of a vehicle, stepped by RK4.

    Raises:
        ImportError: commonroad-vehicle-models is not installed.
    """

    def __init__(self, vehicle: int = 2, step: float = 5e-3):
        try:
            model = importlib.import_module("vehiclemodels.vehicle_dynamics_st")
            parameters = importlib.import_module(f"vehiclemodels.parameters_vehicle{vehicle}")
        except ImportError as error:
            raise ImportError("the car needs CommonRoad's models: pip install 'agvjax[vehicles]'") from error
        self._rate = model.vehicle_dynamics_st
        self.parameters = getattr(parameters, f"parameters_vehicle{vehicle}")()
        self.step, self.state = step, np.zeros(7)

    def reset(self, position: Any, velocity: Any, heading: float) -> None:
        """Its front axle there, its rear axle not slipping."""
        start = agvjax.Start(position=position, velocity=velocity, heading=heading)
        s = agvjax.SingleTrack().start(start)
        self.state = np.array([*s.position, s.steering_angle, s.speed, s.heading, s.yaw_rate, s.slip_angle], float)

    def measure(self) -> agvjax.Measurement:
        """What is true of its front axle."""
        x, y, delta, v, psi, r, beta = self.state
        front, ahead = self.parameters.a, np.array([np.cos(psi), np.sin(psi)])
        velocity = v * np.array([np.cos(psi + beta), np.sin(psi + beta)]) + front * r * np.array([-ahead[1], ahead[0]])
        place = np.array([x, y]) + front * ahead
        place, velocity, psi, r, delta = (jnp.asarray(x) for x in (place, velocity, psi, r, delta))
        return agvjax.Measurement(position=place, velocity=velocity, heading=psi, yaw_rate=r, steering_angle=delta)

    def apply(self, delivered: dict[str, float], period: float) -> None:
        """Steering rate and acceleration."""
        u, h = [delivered["steering_rate"], delivered["acceleration"]], self.step

        def rate(x: np.ndarray) -> np.ndarray:
            return np.array(self._rate(list(x), u, self.parameters))

        for _ in range(round(period / h)):
            a = rate(self.state)
            b = rate(self.state + h / 2 * a)
            c = rate(self.state + h / 2 * b)
            self.state = self.state + h / 6 * (a + 2 * b + 2 * c + rate(self.state + h * c))
