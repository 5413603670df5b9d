"""Independent NumPy reference of the curvature feed-forward with PD-I terms on a base on two wheels.

Written from the written list of its equations alone, to check the package against; it must never import it. The path is
a fine polyline, on which the nearest point is searched by brute force in a window; a vehicle is stepped by RK4.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Line:
    """A closed way as a fine polyline by arc length, with its heading and curvature."""

    arc: Array  # (n,) m
    points: Array  # (n, 2) m
    heading: Array  # (n,) rad, unwrapped
    curvature: Array  # (n,) 1/m
    length: float

    def nearest(self, position: Array, arc: float, reach: float = 0.4) -> float:
        """The arc length of the nearest point within `reach` of another: on segments, by projection."""
        n, step = len(self.arc), self.length / len(self.arc)
        count = int(reach / step)
        k = (int(arc / step) + np.arange(-count, count + 1)) % n
        a, b = self.points[k], self.points[(k + 1) % n]
        d = b - a
        share = np.clip(np.sum((position - a) * d, axis=1) / np.sum(d * d, axis=1), 0, 1)
        away = np.linalg.norm(a + share[:, None] * d - position, axis=1)
        best = int(np.argmin(away))
        return float((self.arc[k[best]] + share[best] * step) % self.length)

    def at(self, arc: float) -> tuple[Array, float, float]:
        """Position, heading and curvature."""
        n, step = len(self.arc), self.length / len(self.arc)
        x = (arc % self.length) / step
        k, share = int(x) % n, x - int(x)
        after = (k + 1) % n
        turn = (self.heading[after] - self.heading[k] + np.pi) % (2 * np.pi) - np.pi
        place = self.points[k] + share * (self.points[after] - self.points[k])
        bend = self.curvature[k] + share * (self.curvature[after] - self.curvature[k])
        return place, float(self.heading[k] + share * turn), float(bend)


@dataclass(frozen=True)
class Gains:
    """Of the law."""

    k_y: float = 6.0
    k_psi: float = 4.0
    k_i: float = 1.0
    ahead: float = 0.35
    windup: float = 0.3
    min_radius: float = 0.9
    min_speed: float = 0.25
    max_yaw_rate: float = 1.5


@dataclass(frozen=True)
class Robot:
    """Of the base: track [m], lag [s], acceleration [m/s^2], deadzone of each wheel, and delay [s]."""

    track: float = 0.5
    tau: float = 0.15
    a_max: float = 1.0
    threshold: float = 0.06
    slope: float = 0.95
    delay: float = 0.08

    def delivered(self, u: Array) -> Array:
        """Of what has arrived."""
        return self.slope * np.sign(u) * np.maximum(np.abs(u) - self.threshold, 0)

    def rate(self, x: Array, sent: Array) -> Array:
        """Of (x, y, heading, left, right)."""
        v, w = (x[3] + x[4]) / 2, (x[4] - x[3]) / self.track
        wheels = np.clip((sent - x[3:]) / self.tau, -self.a_max, self.a_max)
        return np.array([v * np.cos(x[2]), v * np.sin(x[2]), w, *wheels])


def follow(
    line: Line, gains: Gains, robot: Robot, *, start: Array, arc: float, speed: float, period: float, dt: float, n: int
) -> tuple[Array, Array]:
    """States (n + 1, 5) and deviations (n + 1,) of a vehicle that starts at rest near an arc length."""
    x, integral, queue = np.r_[start, 0.0, 0.0], 0.0, []
    every, late = round(period / dt), round(robot.delay / dt)
    states, away = [x], []
    sent = np.zeros(2)
    for i in range(n + 1):
        arc = line.nearest(x[:2], arc)
        place, heading, _ = line.at(arc)
        e = float(np.cos(heading) * (x[1] - place[1]) - np.sin(heading) * (x[0] - place[0]))
        away.append(e)
        if i == n:
            break
        if i % every == 0:
            e_psi = (x[2] - heading + np.pi) % (2 * np.pi) - np.pi
            v = (x[3] + x[4]) / 2
            _, _, bend = line.at(arc + abs(v) * gains.ahead)
            integral = float(np.clip(integral + period * e, -gains.windup, gains.windup))
            kappa = bend * np.cos(e_psi) / max(1 - bend * e, 0.3)
            kappa += -gains.k_y * e - gains.k_psi * np.sin(e_psi) - gains.k_i * integral
            wanted = speed
            if abs(kappa) * gains.min_radius > 1:
                wanted = max(speed / (abs(kappa) * gains.min_radius), min(gains.min_speed, speed))
            w = np.clip(wanted * kappa, -gains.max_yaw_rate, gains.max_yaw_rate)
            queue.append((i + late, np.array([wanted - w * robot.track / 2, wanted + w * robot.track / 2])))
        while queue and queue[0][0] <= i:
            sent = robot.delivered(queue.pop(0)[1])
        k1 = robot.rate(x, sent)
        k2 = robot.rate(x + dt / 2 * k1, sent)
        k3 = robot.rate(x + dt / 2 * k2, sent)
        k4 = robot.rate(x + dt * k3, sent)
        x = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        states.append(x)
    return np.array(states), np.array(away)
