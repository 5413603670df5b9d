"""A differential-drive robot in MuJoCo: wheels that touch a floor, motors with limits, friction where one has it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

MODEL = Path(__file__).with_name("robot.xml")
SETTLING = 1.0  # s, after which it stands still
WHEELS = ("left", "right")
CASTERS = ("front", "rear")


def _engine() -> Any:
    try:
        import mujoco  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise ImportError("the robot needs MuJoCo: pip install 'agvjax[vehicles]'") from error
    return mujoco


class Robot:
    """The robot of `robot.xml`, seen through its reference point, L ahead of the middle of its axle.

    Without friction nothing slows its wheels and casters down; the wheels still hold on to the floor, or they would
    not roll. `floor_friction` is the coefficient between floor and wheels.

    Raises:
        ImportError: MuJoCo is not installed.
    """

    def __init__(self, friction: bool = True, floor_friction: float = 1.0, L: float = 0.15):
        self._mujoco = _engine()
        self.model = self._mujoco.MjModel.from_xml_path(str(MODEL))
        self.data = self._mujoco.MjData(self.model)
        self.L = L  # m
        self.model.geom("floor").friction[0] = floor_friction
        if not friction:
            for name in WHEELS:
                self.model.joint(name).frictionloss[:] = self.model.joint(name).damping[:] = 0.0
            for name in CASTERS:
                self.model.geom(name).friction[:] = 0.0
        self._address = {self.model.joint(i).name: i for i in range(self.model.njnt)}  # each joint has one coordinate
        self._settle()

    def _settle(self) -> None:
        """Find how it stands still: its weight on wheels and springs."""
        self.step(0.0, 0.0, round(SETTLING / self.timestep))
        self._standing = self.data.qpos.copy()
        for name in ("x", "y", "yaw", *WHEELS):
            self._standing[self._address[name]] = 0.0
        self._warm = self.data.qacc_warmstart.copy()
        self.reset((0.0, 0.0), (0.0, 0.0), 0.0)

    @property
    def timestep(self) -> float:
        """Of the physics [s]."""
        return float(self.model.opt.timestep)

    @property
    def wheel_radius(self) -> float:
        """Of an unloaded wheel [m]."""
        return float(self.model.geom("left").size[0])

    @property
    def track(self) -> float:
        """From the left wheel to the right [m]."""
        return float(self.model.body("left").pos[1] - self.model.body("right").pos[1])

    def _rolling(self, v: float, w: float, heading: float = 0.0) -> np.ndarray:
        """Velocities of all joints where the axle moves at v [m/s] and turns at w [rad/s] and the wheels roll."""
        velocities = np.zeros(self.model.nv)
        half = w * self.track / 2
        speeds = {"x": v * np.cos(heading), "y": v * np.sin(heading), "yaw": w}
        speeds |= {"left": (v - half) / self.wheel_radius, "right": (v + half) / self.wheel_radius}
        for name, speed in speeds.items():
            velocities[self._address[name]] = speed
        return velocities

    def generalised_mass(self) -> np.ndarray:
        """Mass matrix (2, 2) of forward speed [m/s] and yaw rate [rad/s] of the robot at rest, wheels rolling.

        Off its diagonal stands what a centre of mass that is not above the axle would add.
        """
        data = self._mujoco.MjData(self.model)
        data.qpos[:] = self._standing
        self._mujoco.mj_forward(self.model, data)
        product, motions = np.zeros(self.model.nv), (self._rolling(1.0, 0.0), self._rolling(0.0, 1.0))
        mass = np.zeros((2, 2))
        for i, motion in enumerate(motions):
            self._mujoco.mj_mulM(self.model, data, product, motion)
            mass[i] = [product @ other for other in motions]
        return mass

    @property
    def effective_mass(self) -> float:
        """M [kg] of M v' = (t_r + t_l) / R: the mass and what it takes to spin the wheels and rotors."""
        return float(self.generalised_mass()[0, 0])

    @property
    def effective_inertia(self) -> float:
        """I [kg m^2] of I w' = (t_r - t_l) track / (2 R), about the middle of the axle, wheels and rotors spinning."""
        return float(self.generalised_mass()[1, 1])

    def wheel_friction(self) -> tuple[float, float]:
        """Coulomb [Nm] and viscous [Nm s] friction at each wheel that resist as much as all friction there is.

        A caster of load N and coefficient mu resists by mu N against its own motion. At both wheels mu N R / 2 for each
        caster does the same where the robot drives straight or turns on the spot. In a wide turn it does not: wheels
        that both turn forward leave the yaw free of Coulomb friction, casters do not.
        """
        coulomb = float(self.model.joint("left").frictionloss[0])
        for name in CASTERS:
            joint = self.model.joint(name)
            spring = joint.stiffness[0] * (self._standing - self.model.qpos_spring)[self._address[name]]
            load = -self.model.opt.gravity[2] * self.model.body(name).mass[0] + spring
            coulomb += float(self.model.geom(name).friction[0] * load) * self.wheel_radius / 2
        return coulomb, float(self.model.joint("left").damping[0])

    def reset(self, position: Any, velocity: Any, heading: float, L: float | None = None) -> None:
        """Put the reference point at a position (2,) [m] with a velocity (2,) [m/s], wheels rolling, nothing falling.

        What of the velocity lies across the heading turns the robot: w = across / L. `L` [m] is kept for later calls.
        """
        self.L = self.L if L is None else L
        sine, cosine = np.sin(heading), np.cos(heading)
        v, across = velocity[0] * cosine + velocity[1] * sine, velocity[1] * cosine - velocity[0] * sine
        self._mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = self._standing
        place = {"x": position[0] - self.L * cosine, "y": position[1] - self.L * sine, "yaw": heading}
        for name, value in place.items():
            self.data.qpos[self._address[name]] = value
        self.data.qvel[:] = self._rolling(v, across / self.L, heading)
        self.data.qacc_warmstart[:] = self._warm
        self._mujoco.mj_forward(self.model, self.data)

    def pose(self) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Position (2,) [m], velocity (2,) [m/s] of the reference point, heading [rad, unwrapped], yaw rate [rad/s]."""
        x, y, heading = (float(self.data.qpos[self._address[name]]) for name in ("x", "y", "yaw"))
        dx, dy, w = (float(self.data.qvel[self._address[name]]) for name in ("x", "y", "yaw"))
        ahead = self.L * np.array([np.cos(heading), np.sin(heading)])
        turned = np.array([-ahead[1], ahead[0]])
        return np.array([x, y]) + ahead, np.array([dx, dy]) + w * turned, heading, w

    def step(self, torque_left: float, torque_right: float, count: int = 1) -> None:
        """Apply torques [Nm] at the wheels for so many steps of the physics; the motors give 4 Nm at most."""
        self.data.ctrl[:] = torque_left, torque_right
        self._mujoco.mj_step(self.model, self.data, count)
