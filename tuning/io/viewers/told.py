"""What is told of a simulated run, and of a drive beside what a model makes of it, whatever the file."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

import agvjax
from agvjax.draw.plot import CHANNELS
from agvjax.geometry import into_body, into_plane
from agvjax.metrics import tracking_error
from agvjax.protocols import Plant

from ..curves import Track

TWIST = 2  # numbers of a command that is a speed and a yaw rate
ROUTE = {"cross_track": "m", "heading_error": "rad", "ahead": "m"}  # errors of a run along a route


class Run(NamedTuple):
    """A simulated run.

    Attributes:
        track: poses of the middle of the axle, of a plant without one of its reference point; errors, what actuators
            were asked for and what they delivered.
        moving: speed ahead and to the left of that point [m/s] and yaw rate [rad/s], (N, 3).
        wanted: pose of the reference, (N, 3).
        command: speed [m/s] and yaw rate [rad/s] asked for, (N, 2); None where the law asks for something else.
    """

    track: Track
    moving: np.ndarray
    wanted: np.ndarray
    command: np.ndarray | None


def of_run(run: agvjax.Trajectory, plant: Plant) -> Run:
    """What is told of one; a number that is not finite stays as it is."""
    t, heading, yaw_rates = np.asarray(run.t, float), np.asarray(run.heading, float), _yaw_rates(run)
    lever, turned = float(plant.lever() or 0.0), jnp.asarray(run.heading, float)
    ahead = into_plane(jnp.asarray(lever), jnp.zeros(()), turned).T
    along, across = into_body(jnp.asarray(run.velocity).T, turned)
    pose = np.column_stack([np.asarray(run.position, float) - np.asarray(ahead), heading])
    moving = np.column_stack([along, np.asarray(across) - lever * yaw_rates, yaw_rates])
    wanted = np.column_stack([run.reference_position, run.reference_heading]).astype(float)
    command = np.asarray(run.command, float)
    return Run(Track(t, pose, *_numbers(run, plant)), moving, wanted, command if command.shape[1] == TWIST else None)


def _yaw_rates(run: agvjax.Trajectory) -> np.ndarray:
    """Slopes [rad/s] of the heading, (N,)."""
    t, heading = np.asarray(run.t, float), np.asarray(run.heading, float)
    return np.gradient(heading, t) if len(t) > 1 else np.zeros_like(heading)


def _numbers(run: agvjax.Trajectory, plant: Plant) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """By topic what is a number at every sample, and units."""
    errors = {f"error/{name}": x for name, x in zip(CHANNELS, np.asarray(tracking_error(run)).T, strict=False)}
    units = {topic: "rad" if topic.endswith("heading") else "m" for topic in errors}
    if run.route is not None:
        errors = {f"error/{name}": np.asarray(x) for name, x in vars(run.route).items() if name in ROUTE}
        units = {f"error/{name}": unit for name, unit in ROUTE.items()}
    asked, delivered, i = np.asarray(run.inputs), np.asarray(run.delivered), 0
    for actuator in plant.actuators:
        for part in plant.parts(actuator):
            errors |= {f"asked/{part}": asked[:, i], f"delivered/{part}": delivered[:, i]}
            unit = plant.units.get(part, plant.units.get(actuator, ""))
            units |= dict.fromkeys((f"asked/{part}", f"delivered/{part}"), unit)
            i += 1
    return errors, units
