"""Where on the route a vehicle binds: the run of the worst one, and the instant at which it is farthest off."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

import agvjax

from ...config import mapped
from .study import Study, late
from .tried import Tried


class Place(NamedTuple):
    """A run and the instant that counts in it."""

    tried: Tried
    run: agvjax.Trajectory
    sample: int  # number of it

    @property
    def arc(self) -> float:
        """Way along the route [m]."""
        return float(_beside(self.run).arc[self.sample])

    @property
    def position(self) -> np.ndarray:
        """On the route (2,) [m], where the vehicle is nearest to it."""
        return np.asarray(_beside(self.run).position[self.sample])

    @property
    def across(self) -> float:
        """Distance to the left of the route [m], to the right negative."""
        return float(_beside(self.run).cross_track[self.sample])

    @property
    def words(self) -> str:
        """Where, in a sentence's part."""
        x, y = self.position
        side, when = "left" if self.across > 0 else "right", float(self.run.t[self.sample])
        return (
            f"{1e3 * abs(self.across):.1f} mm to the {side} at ({x:.2f}, {y:.2f}), {self.arc:.2f} m along the route,"
            f" {when:.1f} s after the start (vehicle {self.tried.vehicle})"
        )


def place(study: Study, tried: Tried) -> Place:
    """Where the vehicle that binds at a speed is farthest off its route, or of its corridor where that counts."""
    run = mapped.drawn(study.drive(tried), study.config.scenario)
    return Place(tried, run, farthest(run, late(study.config, tried.factor), not study.config.speed.within))


def farthest(run: agvjax.Trajectory, after: float, corridor: bool) -> int:
    """The sample from `after` [s] on that lies farthest off the route, or nearest to a side of the corridor."""
    beside = _beside(run)
    across = np.asarray(beside.cross_track)
    counted = np.abs(across)
    if corridor and beside.room is not None:
        left, right = (np.asarray(side) for side in beside.room)
        counted = np.maximum(across - left, -across - right)
    return int(np.argmax(np.where(np.asarray(run.t) >= after, counted, -np.inf)))


def _beside(run: agvjax.Trajectory) -> Any:
    return run.route
