"""The curves that interactive figures and viewers show: of a run by name, of a recording or a model as a track."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import agvjax


class Track(NamedTuple):
    """Poses over time, and numbers beside them.

    Attributes:
        t: times (N,) [s].
        pose: x, y [m] and heading [rad] (N, 3).
        numbers: by topic, each (N,).
        units: of numbers, by topic, where they are known.
    """

    t: np.ndarray
    pose: np.ndarray
    numbers: Mapping[str, np.ndarray]
    units: Mapping[str, str]


def of_run(run: agvjax.Trajectory) -> dict[str, Array]:
    """Samples (n,) or (n, c) by name.

    `t` [s], `path` and `position` (n, 2) [m], `errors` (n, c) as `error_labels` says, `asked` and `delivered` (n, m) of
    the actuators.
    """
    picked = {"t": run.t, "path": run.reference_position, "position": run.position}
    return picked | {"errors": _errors(run), "asked": run.inputs, "delivered": run.delivered}


def error_labels(scenario: agvjax.Scenario) -> tuple[tuple[str, str], ...]:
    """Name and unit of each column of the errors."""
    if scenario.path.by_arc():
        return ("to the left of the route", "mm"), ("heading error", "deg"), ("speed error", "m/s")
    named = (("error in x", "m"), ("error in y", "m"), ("heading error", "rad"))
    return named if scenario.plant.commands_heading else named[:2]


def columns(curves: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The curves as columns (n,) of one table: `errors0`, `errors1` and so on."""
    found = {}
    for name, curve in curves.items():
        found |= {name: curve} if curve.ndim == 1 else {f"{name}{i}": x for i, x in enumerate(curve.T)}
    return found


def _errors(run: agvjax.Trajectory) -> Array:
    """The columns that `error_labels` names."""
    ride = run.route
    if ride is None:
        return agvjax.tracking_error(run)
    return jnp.stack([1e3 * ride.cross_track, jnp.degrees(ride.heading_error), ride.speed - ride.wanted], axis=-1)
