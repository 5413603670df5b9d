"""What every node does in a period, free of ROS: it moves only with an order to, on fresh odometry; else it stops."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .odometry import measured, unwrapped, yaw
from .vehicles import VEHICLES

GAINS = "controller."  # what the names of the law's parameters begin with


class Step(NamedTuple):
    """What to command for a period, and what there is to say."""

    speed: float = 0.0  # m/s
    yaw_rate: float = 0.0  # rad/s
    error: str = ""  # why it stands still although it is to drive
    info: str = ""  # what happened, once
    warning: str = ""  # what is not done as it was sent, once


class Driver:
    """One vehicle under the law. Times are in seconds of one clock, that of the odometry's stamps."""

    what = "path"  # that it follows

    def __init__(self, controller, inputs, period, values):
        """The class `Controller` of controller.py, its INPUTS and its PERIOD [s], and the parameters by name."""
        self.new_controller, self.period = controller, period
        self.controller: Any = None
        self.configure(values)
        prefix = f"{GAINS}vehicle."
        parts = {name[len(prefix) :]: value for name, value in values.items() if name.startswith(prefix)}
        self.vehicle = VEHICLES[tuple(inputs)]({**parts, "behind": values.get("steered_behind", False)})
        self.measurement, self.stamp, self.heading, self.velocity = None, 0.0, None, (0.0, 0.0)
        self.moving = False  # whether the law runs
        self.warning = ""  # what is to be said
        self.periods = self.clipped = 0  # periods driven, and those in which the node kept back some of the velocity

    def configure(self, values):
        """Take these parameters from now on; the state of the law stays."""
        self.values = dict(values)
        gains = {name[len(GAINS) :]: value for name, value in values.items() if name.startswith(GAINS)}
        before, self.controller = self.controller, self.new_controller(gains)
        if before is not None:
            self.controller.state = before.state

    def sense(self, position, quaternion, speed, yaw_rate, stamp):
        """Odometry of the axle: position (2,) [m] and quaternion (x, y, z, w), speed and yaw rate of the vehicle.

        Raises ValueError where it is no measurement; the one before then ages on.
        """
        heading = unwrapped(yaw(*quaternion), self.heading)
        self.measurement = measured(position, heading, speed, yaw_rate, self.vehicle.L)
        self.heading, self.velocity, self.stamp = heading, (speed, yaw_rate), stamp

    def step(self, now):
        """The command from `now` [s] until a period later."""
        if not self.ordered():
            return self._stop()
        age = abs(now - self.stamp)
        if self.measurement is None or not age <= self.values["timeout"]:
            late = "none yet" if self.measurement is None else f"the last is of {age:.2f} s from now"
            return self._stop(error=f"no odometry newer than {self.values['timeout']:g} s: {late}")
        try:
            return self._drive({**self.measurement, **self.vehicle.seen()})
        except ValueError as problem:
            self._give_up()
            return self._stop(error=f"{self.what} given up: {problem}")

    def ordered(self):
        """Whether it is to drive."""
        raise NotImplementedError

    def _drive(self, measurement):
        """One period of the law, or the end; ValueError says why not."""
        raise NotImplementedError

    def _give_up(self):
        """Drive no more."""
        raise NotImplementedError

    def _stop(self, error="", info=""):
        self.moving = False
        return Step(error=error, info=info, warning=self._said())

    def _said(self):
        said, self.warning = self.warning, ""
        return said

    def _sent(self, inputs, info):
        """What to command for the inputs that the law asks for, within the limits of the node."""
        wanted = self.vehicle.wanted(inputs, self.period)
        if self.controller.status == "NOT_FINITE" or not np.all(np.isfinite(wanted)):
            raise ValueError("the law asks for a velocity that is not finite")
        speed, yaw_rate = self._limited(*wanted)
        self.vehicle.sent(speed, yaw_rate)
        self.periods, self.clipped = self.periods + 1, self.clipped + ((speed, yaw_rate) != wanted)
        speed, yaw_rate = self.vehicle.command(speed, yaw_rate, self.values)
        return Step(speed, yaw_rate, info=info, warning=self._said())

    def _limited(self, speed, yaw_rate):
        """A velocity that the robot may be given."""
        return speed, yaw_rate
