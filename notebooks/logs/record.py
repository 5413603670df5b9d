"""Logs of the MuJoCo robot, with the noise of a localisation: `python notebooks/logs/record.py FOLDER`.

The first is the drive that `agvjax identify --config robot` suggests, open loop; the second along a lemniscate and the
third along a spline are driven by the gains that `agvjax tune --config robot` starts with.
"""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import agvjax
from agvjax.controllers.sampled import Computed
from tuning import config as configuration
from tuning.config.settings import Config
from tuning.identify import first_drive
from tuning.io import files
from tuning.studies.vehicles.drive import Drive, drive
from tuning.studies.vehicles.study import unseen_paths
from tuning.studies.vehicles.worlds import RobotWorld

NOISE = (2e-3, 2e-3, 1e-3, 4e-3, 4e-3)  # of x, y [m], heading [rad], vx, vy [m/s]
HEADER = ("t", "x", "y", "heading", "vx", "vy")
DIGITS = 4  # of a number in the log: a tenth of a millimetre


@agvjax.pytree
class Playback(agvjax.Law):
    """A law that plays recorded inputs, one each `period` [s], whatever it measures."""

    inputs: Any  # {actuator: (N,)}
    period: float = 0.02

    def control_period(self) -> float:
        """Time [s] between inputs."""
        return self.period

    def hold(self, measurement: Any, reference: Any) -> Any:
        """Before the first."""
        return self._at(jnp.zeros((), int))

    def jump(self, flow: Any, memory: Computed, measurement: Any, reference: Any, h: Any) -> Any:
        """The next one."""
        return self._at(memory.law + 1)

    def _at(self, count: Any) -> Computed:
        now = {name: jnp.asarray(u)[jnp.maximum(count - 1, 0)] for name, u in self.inputs.items()}
        command = agvjax.Command(position=jnp.zeros(2), heading=jnp.zeros(()), inputs=now)
        return Computed(law=count, command=command, limited=jnp.zeros((), bool))


def _watched(result: Any) -> tuple[Drive, list[Any]]:
    """A drive with what was watched."""
    return result


def recorded(config: Config, law: Any, scenario: Any, horizon: float, seed: int) -> np.ndarray:
    """Rows of a log."""
    world = RobotWorld(float(config.scenario.plant.L))
    driven, seen = _watched(drive(world, law, agvjax.check(scenario), horizon, watch=world.robot.pose))
    columns = [[*place, heading, *velocity] for place, velocity, heading, _ in seen]
    noise = np.random.default_rng(seed).normal(size=(len(columns), len(NOISE))) * NOISE
    return np.column_stack([driven.t, np.array(columns) + noise, driven.inputs]).round(DIGITS)


def logs(config: Config) -> dict[str, np.ndarray]:
    """The three, by name."""
    names = config.scenario.plant.actuators
    suggested = first_drive(config)
    still = agvjax.Start(position=jnp.array([float(config.scenario.plant.L), 0.0]), velocity=jnp.zeros(2), heading=0.0)
    at_rest = dataclasses.replace(config.scenario, start=still, path=agvjax.Line(), heading=agvjax.Tangent())
    played = Playback(inputs=dict(zip(names, suggested.inputs.T, strict=True)))
    found = {"robot-excited": recorded(config, played, at_rest, float(suggested.t[-1]), 1)}
    paths = {"robot-lemniscate": (agvjax.Lemniscate(amplitude=1.5, omega=0.6), 45.0)}
    paths |= {"robot-spline": (unseen_paths()["spline"], 25.0)}
    for seed, (name, (path, horizon)) in enumerate(paths.items(), 2):
        begin = np.asarray(path(jnp.zeros(()))) + [-0.3, 0.3]
        start = agvjax.Start(position=jnp.asarray(begin), velocity=jnp.zeros(2), heading=0.5)
        scenario = dataclasses.replace(config.scenario, path=path, heading=agvjax.Tangent(), start=start)
        found[name] = recorded(config, agvjax.check(config.controller), scenario, horizon, seed)
    return found


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    agvjax.tune_xla()
    folder = Path(sys.argv[1])
    robot = configuration.load(["robot"], [], "identify")
    for log, rows in logs(robot).items():
        header = (*HEADER, *robot.scenario.plant.actuators)
        files.write_csv(folder / f"{log}.csv", header, rows.tolist())
