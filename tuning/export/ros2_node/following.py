"""What the node does in a period, free of ROS: odometry and a path in, a speed and a yaw rate out.

It moves only while it has a path and fresh odometry, and is within reach of the path; everything else is a stop.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .odometry import measured, unwrapped, yaw
from .reference import Reference
from .vehicles import VEHICLES

GAINS = "controller."  # what the names of the law's parameters begin with


class Step(NamedTuple):
    """What to command for a period, and what there is to say."""

    speed: float = 0.0  # m/s
    yaw_rate: float = 0.0  # rad/s
    error: str = ""  # why it stands still although there is a path
    info: str = ""  # what happened, once


class Follower:
    """One vehicle, one path at a time. Times are in seconds of one clock, that of the odometry's stamps."""

    def __init__(self, controller, inputs, period, values):
        """The class `Controller` of controller.py, its INPUTS and its PERIOD [s], and the parameters by name."""
        self.new_controller, self.period = controller, period
        self.controller: Any = None
        self.configure(values)
        prefix = f"{GAINS}vehicle."
        parts = {name[len(prefix) :]: value for name, value in values.items() if name.startswith(prefix)}
        self.vehicle = VEHICLES[tuple(inputs)](parts)
        self.measurement, self.stamp, self.heading, self.velocity = None, 0.0, None, (0.0, 0.0)
        self.reference: Any = None
        self.time: Any = None  # s, since the path was joined
        self.moving, self.along = False, 0.0  # whether the law runs, and the reference's speed along the path [m/s]
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

    def follow(self, points, times=None):
        """Drive along these points (N, 2) [m] from where the vehicle is; no points at all are the order to stop.

        Raises ValueError where they make no path; the vehicle then stops too.
        """
        self.reference, self.time = None, None
        if len(points):
            self.reference = Reference(points, times, self.values["spacing"])
        self.moving = self.moving and self.reference is not None

    def step(self, now):
        """The command from `now` [s] until a period later."""
        if self.reference is None:
            return self._stop()
        age = abs(now - self.stamp)
        if self.measurement is None or not age <= self.values["timeout"]:
            late = "none yet" if self.measurement is None else f"the last is of {age:.2f} s from now"
            return self._stop(error=f"no odometry newer than {self.values['timeout']:g} s: {late}")
        try:
            return self._drive({**self.measurement, **self.vehicle.seen()})
        except ValueError as problem:
            self.reference = None
            return self._stop(error=f"path given up: {problem}")

    def _stop(self, error="", info=""):
        self.moving, self.time, self.along = False, None, 0.0
        return Step(error=error, info=info)

    def _drive(self, measurement):
        info = self._begin(measurement) if self.time is None else ""
        asked = self.reference.at(self.time, measurement["heading"])
        off = float(np.linalg.norm(measurement["position"] - asked["position"]))
        if off > self.values["max_error"]:
            raise ValueError(f"{off:.2f} m from where the vehicle should be, max_error is {self.values['max_error']:g}")
        over = self.time - self.reference.motion.duration
        if over >= 0 and (off < self.values["goal_tolerance"] or over >= self.values["settling_time"]):
            self.reference = None
            return self._stop(info=f"path finished, {off:.3f} m from its end; {self.clipped} of {self.periods} limited")
        if not self.moving:
            self.controller.start(measurement, asked)
            self.moving = True
        wanted = self.vehicle.wanted(self.controller.step(measurement, asked), self.period)
        if not np.all(np.isfinite(wanted)):
            raise ValueError(f"the law asks for a velocity that is not finite: {wanted}")
        sent = self._limited(*wanted)
        self.vehicle.sent(*sent)
        self.periods, self.clipped = self.periods + 1, self.clipped + (sent != wanted)
        self.time, self.along = self.time + self.period, float(np.linalg.norm(asked["velocity"]))
        return Step(*sent, info=info)

    def _begin(self, measurement):
        """Join the path at the place of it that is abreast; a path that replaces another keeps the vehicle's pace."""
        values, again = self.values, self.reference.heading is not None
        after = self.reference.reached if again else 0.0
        start = self.reference.nearest(measurement["position"], after, values["max_error"])
        limits = [values[name] for name in ("speed", "acceleration", "max_speed", "max_yaw_rate")]
        share = self.reference.drive(start, self.along, *limits)
        self.time, self.periods, self.clipped = 0.0, 0, 0
        if not self.moving:
            self.vehicle.start(*self.velocity)
            measurement.update(self.vehicle.seen())
        slower = f", {share:.0%} of the speed asked for, as its bends and max_speed want" if share < 0.99 else ""
        return f"path {'joined again' if again else 'begun'}, {self.reference.motion.duration:.1f} s to its end{slower}"

    def _limited(self, speed, yaw_rate):
        """A velocity that the robot may be given, and not further from its own than the leads."""
        values, (v, w) = self.values, self.velocity
        speed = min(max(speed, v - values["max_speed_lead"]), v + values["max_speed_lead"])
        yaw_rate = min(max(yaw_rate, w - values["max_yaw_rate_lead"]), w + values["max_yaw_rate_lead"])
        most = values["max_yaw_rate"]
        return min(max(speed, -values["max_reverse_speed"]), values["max_speed"]), min(max(yaw_rate, -most), most)
