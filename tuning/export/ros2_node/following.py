"""What the node does in a period, free of ROS: odometry and a path in, a speed and a yaw rate out.

It moves only while it has a path and fresh odometry, and is within reach of the path; everything else is a stop.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .driver import Driver
from .reference import Reference, timing

LIMITS = ("speed", "acceleration", "max_speed", "max_yaw_rate")
SLOWEST = 1e-4  # of `speed`: stamps that ask for less have not been set
CHANGED = 0.25  # of the speed asked for: a path that replaces another and is driven as fast is no news
OVER = "a path is sent again that was finished or given up: it is not begun again unless an empty one is sent before"


class Follower(Driver):
    """One vehicle, one path at a time. Times are in seconds of one clock, that of the odometry's stamps."""

    def __init__(self, controller, inputs, period, values):
        """See `Driver`."""
        super().__init__(controller, inputs, period, values)
        self.reference: Any = None
        self.time: Any = None  # s, since the path was joined
        self.over: Any = None  # the reference that was driven, once it is finished or given up
        self.before: Any = None  # the reference that is replaced, and its time [s]
        self.order: Any = None  # timing and limits with which the newest path was sent
        self.warned, self.share = set(), 1.0  # what was said; of the speed asked for, the share

    def follow(self, points, times=None):
        """Drive along these points (N, 2) [m] from where the vehicle is; no points at all are the order to stop.

        The path that is driven, sent again whole or without a part that lies behind, changes nothing. One that replaces
        it goes on at its pace, from the place of the reference where it passes that. Raises ValueError where the points
        make no path; the vehicle then stops too.
        """
        points = np.asarray(points, float).reshape(-1, 2)
        timed = self._timing(points, times) if len(points) else None
        order = (timed, [self.values[name] for name in LIMITS])
        if len(points) and self._same(points, times, order):
            if self.over is not None:
                self._warn(OVER)
            return
        try:
            reference = Reference(points, timed, self.values["spacing"]) if len(points) else None
        except ValueError:
            near, last = 2 * max(self.values["spacing"], self.values["goal_tolerance"]), self.reference
            if last is not None and np.linalg.norm(points - last.points[-1], axis=-1).max() < near:
                return  # no more than the end of the path that is driven is left of it
            self._drop(None)
            raise
        before = self.before if self.time is None else (self.reference, self.time)
        self._drop(None)
        self.reference, self.order = reference, order
        self.before = before if reference is not None and self.moving else None
        self.moving = self.before is not None

    def _drop(self, over):
        """No path from now on; `over` is the one that must not begin again by being sent again."""
        self.reference = self.time = self.before = None
        self.over = over

    def _timing(self, points, times):
        """The times (N,) [s] from the first on; None, and why is said once, where they are no timing."""
        values = self.values
        if times is None or not values["use_stamps"]:
            return None
        times, why = timing(points, times, values["spacing"], SLOWEST * values["speed"], values["max_speed"])
        if why:
            self._warn(
                f"stamps of the path {why}: it is driven at speed = {values['speed']:g} (use_stamps = false: ever)"
            )
        return times

    def _warn(self, text):
        if text not in self.warned:
            self.warned.add(text)
            self.warning = text

    def _same(self, points, times, order):
        """Whether they are the path of the reference, or what is left of it, to be driven alike."""
        if self.over is not None:
            return self.over.cut(points) is not None
        last = self.reference
        front = None if last is None else last.cut(points)
        if last is None or front is None or order[1] != self.order[1]:
            return False
        timed = self.order[0]
        if timed is None and order[0] is not None:
            return False
        if timed is not None and (
            times is None or not np.allclose(np.subtract(times, times[0]), timed[front:] - timed[front], 0, 1e-6)
        ):
            return False
        at = last.reached if self.time is None else last.motion(self.time)[0]
        ahead = np.linalg.norm(points[0] - last.spline(at)[0])
        behind = np.interp(front, last.kept, last.spline.knots) <= at
        return bool(front == 0 or behind or ahead <= self.values["max_error"])

    def ordered(self):
        """While there is a path."""
        return self.reference is not None

    def _give_up(self):
        self._drop(None if self.time is None else self.reference)

    def _stop(self, error="", info=""):
        self.time, self.before = None, None
        return super()._stop(error, info)

    def _drive(self, measurement):
        info = self._begin(measurement) if self.time is None else ""
        asked = self.reference.at(self.time, measurement["heading"])
        off = float(np.linalg.norm(measurement["position"] - asked["position"]))
        if off > self.values["max_error"]:
            raise ValueError(f"{off:.2f} m from where the vehicle should be, max_error is {self.values['max_error']:g}")
        over = self.time - self.reference.motion.duration
        if over >= 0 and (off < self.values["goal_tolerance"] or over >= self.values["settling_time"]):
            self._drop(self.reference)
            return self._stop(info=f"path finished, {off:.3f} m from its end; {self.clipped} of {self.periods} limited")
        if not self.moving:
            self.controller.start(measurement, asked)
            self.moving = True
        step = self._sent(self.controller.step(measurement, asked), info)
        self.time += self.period
        return step

    def _begin(self, measurement):
        """Join the path at the place of it that is abreast; a path that replaces another goes on at its pace."""
        values, again, replaces = self.values, self.reference.heading is not None, self.before is not None
        start, pace = None, (0.0, 0.0, 0.0)
        if replaces:
            start = self.reference.goes_on(*self.before, max(values["spacing"], values["goal_tolerance"]))
            pace = self.before[0].pace(self.before[1])[2]
        if start is None:
            after = self.reference.reached if again else 0.0
            start = self.reference.nearest(measurement["position"], after, values["max_error"])
        share = self.reference.drive(start, *pace, *(values[name] for name in LIMITS))
        self.time, self.before = self._rested(start) if replaces else 0.0, None
        slower = f", {share:.0%} of the speed asked for, as its bends and max_speed want" if share < 0.99 else ""
        told = replaces and abs(share - self.share) < CHANGED
        self.share = self.share if told else share
        if not replaces:
            self.periods = self.clipped = 0
            self.warned.discard(OVER)
        if not self.moving:
            self.vehicle.start(*self.velocity)
            measurement.update(self.vehicle.seen())
        how = "joined again" if again else "replaced" if replaces else "begun"
        return "" if told else f"path {how}, {self.reference.motion.duration:.1f} s to its end{slower}"

    def _rested(self, start):
        """The time into a drive that begins at u = `start`; where that is the end, waiting there is not begun anew."""
        reference, time = self.before
        over = time - reference.motion.duration
        return self.reference.motion.duration + over if over > 0.0 and start == self.reference.end else 0.0

    def _limited(self, speed, yaw_rate):
        """A velocity that the robot may be given, and not further from its own than the leads."""
        values, (v, w) = self.values, self.velocity
        speed = min(max(speed, v - values["max_speed_lead"]), v + values["max_speed_lead"])
        yaw_rate = min(max(yaw_rate, w - values["max_yaw_rate_lead"]), w + values["max_yaw_rate_lead"])
        most = values["max_yaw_rate"]
        return min(max(speed, -values["max_reverse_speed"]), values["max_speed"]), min(max(yaw_rate, -most), most)
