"""How fast a path is driven: ramps of the rate of its parameter, from what it is to what it should be."""

from __future__ import annotations

import numpy as np


class Motion:
    """Progress along a path from `start` to `end`: from the `rate` it has, to `cruise`, and to rest, all smoothly.

    The acceleration of a ramp is a parabola in time whose peak is `acceleration`; it begins with the `pull` there is. A
    path too short for `cruise` is driven slower; one too short even to stop is braked on harder. A ramp takes no less
    than the time `left` of the one that it goes on from, so that a motion planned anew on its way stays what it was.
    """

    def __init__(self, start, end, rate, cruise, acceleration, pull=0.0, left=0.0):
        """All in the unit of the path's parameter, and seconds."""
        length = max(end - start, 1e-9)

        def stages(speed):
            ramp = _Ramp.to(rate, pull, speed, acceleration, left)
            return ramp, _Ramp(1.5 * speed / acceleration, speed, 0.0, 0.0)

        def way(speed):
            return sum(ramp.way for ramp in stages(speed))

        low, high = 0.0, cruise
        if way(cruise) <= length:
            low = cruise
        for _ in range(60 * (low < cruise)):
            middle = (low + high) / 2
            low, high = (middle, high) if way(middle) <= length else (low, middle)
        up, down = stages(low)
        if way(0.0) > length:
            root = np.sqrt(max(rate**2 / 4 + pull * length / 3, 0.0))
            up = _Ramp(2 * length / (rate / 2 + root), rate, pull, 0.0)
        even = _Ramp(max(length - up.way - down.way, 0.0) / low if low > 0.0 else 0.0, low, 0.0, low)
        self.start, self.end, self.stages = start, end, (up, even, down)
        self.duration = sum(ramp.time for ramp in self.stages)

    def __call__(self, t):
        """Progress, its rate and its acceleration a time t [s] after the start."""
        u = self.start
        for ramp in self.stages:
            if t < ramp.time:
                way, rate, acceleration = ramp(max(t, 0.0) / ramp.time)
                return min(u + way, self.end), rate, acceleration
            u, t = u + ramp.way, t - ramp.time
        return self.end, 0.0, 0.0

    def left(self, t):
        """Time [s] that the ramp which is driven at t [s] still takes; none where the rate stays."""
        for ramp in self.stages:
            if t < ramp.time:
                return ramp.time - max(t, 0.0) if ramp.rate != ramp.later or ramp.pull else 0.0
            t = t - ramp.time
        return 0.0


class _Ramp:
    """A rate that changes to `later` in a `time`, from an acceleration `pull`; the acceleration is a parabola to 0."""

    def __init__(self, time, rate, pull, later):
        self.time, self.rate, self.pull, self.later = time, rate, pull, later
        self.bulge = 6 * ((later - rate) / time - pull / 2) if time > 0.0 else 0.0
        self.way = time * ((rate + later) / 2 + pull * time / 12)

    @classmethod
    def to(cls, rate, pull, later, peak, least):
        """The shortest whose acceleration stays within `peak`, of a duration of `least` or more."""
        change, peak = later - rate, max(peak, abs(pull))
        side = 1.0 if change > 0 else -1.0
        most = side * pull / 2 + (2 * peak - side * pull + 2 * np.sqrt(peak**2 - side * peak * pull)) / 6
        ramp = cls(max(abs(change) / most, least), rate, pull, later)
        turn = -pull / ramp.bulge if ramp.bulge > 0.0 > pull else 0.0  # where it is slowest
        if turn < 1.0 and ramp(turn)[1] < 0.0:  # it would go backwards
            return cls.to(rate, 0.0, later, peak, least)
        return ramp

    def __call__(self, s):
        """Way, rate and acceleration after a share s of the time."""
        T, a, k = self.time, self.pull, self.bulge
        way = T * (self.rate * s + T * (a * (s**2 / 2 - s**3 / 6) + k * (s**3 / 6 - s**4 / 12)))
        return way, self.rate + T * (a * (s - s**2 / 2) + k * (s**2 / 2 - s**3 / 3)), (1 - s) * (a + k * s)
