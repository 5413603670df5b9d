"""Independent SciPy reference of bases that are driven by velocities, under recorded twists.

Written from the written list of their equations alone, to check the package against; it must never import it. A
motor's signal is deadzone(command(t - delay)); commands are held in between, so that between two arrivals the vehicle
is an ordinary differential equation with constant inputs. Every vehicle has the state (x, y, heading, first motor,
second motor).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motor:
    """What stands between a command and a motor."""

    slope_right: float = 1.0
    slope_left: float = 1.0
    threshold_right: float = 0.0
    threshold_left: float = 0.0
    delay: float = 0.0

    def delivered(self, u: float) -> float:
        """Of a command that has arrived."""
        if u > self.threshold_right:
            return self.slope_right * (u - self.threshold_right)
        if u < -self.threshold_left:
            return self.slope_left * (u + self.threshold_left)
        return 0.0


@dataclass(frozen=True)
class Vehicle:
    """Common to all: two motors, a drift of the yaw rate, and a disturbance (plane, plane, yaw rate) of time."""

    motors: tuple[Motor, Motor] = (Motor(), Motor())
    drift: float = 0.0
    disturbance: Callable[[float], Array] = field(default=lambda t: np.zeros(3))

    def asked(self, v: float, w: float) -> tuple[float, float]:
        """Commands for a speed and a yaw rate."""
        raise NotImplementedError

    def twist(self, first: float, second: float) -> tuple[float, float]:
        """Speed and yaw rate of the two motors."""
        raise NotImplementedError

    def change(self, first: float, second: float, sent: tuple[float, float], push: float) -> tuple[float, float]:
        """Rates of the two motors."""
        raise NotImplementedError

    def rate(self, t: float, state: Array, sent: tuple[float, float]) -> list[float]:
        """Of the pose x' = v cos psi, y' = v sin psi, psi' = w, and of the motors."""
        _, _, psi, first, second = state
        v, w = self.twist(first, second)
        dx, dy, turn = self.disturbance(t)
        push = dx * np.cos(psi) + dy * np.sin(psi)
        return [v * np.cos(psi), v * np.sin(psi), w + turn, *self.change(first, second, sent, push)]


def toward(value: float, goal: float, tau: float, most: float) -> float:
    """clip((goal - value) / tau, +-most)."""
    return min(max((goal - value) / tau, -most), most)


@dataclass(frozen=True)
class TwoWheels(Vehicle):
    """Wheel speeds of a base."""

    track: float = 0.5
    tau: float = 0.15
    a_max: float = 1.0
    left: float = 1.0
    right: float = 1.0
    believed_track: float = 0.5

    def asked(self, v: float, w: float) -> tuple[float, float]:
        return v - w * self.believed_track / 2, v + w * self.believed_track / 2

    def twist(self, first: float, second: float) -> tuple[float, float]:
        left, right = self.left * first, self.right * second
        return (left + right) / 2, (right - left) / self.track + self.drift

    def change(self, first: float, second: float, sent: tuple[float, float], push: float) -> tuple[float, float]:
        a = toward(first, sent[0], self.tau, self.a_max) + push
        return a, toward(second, sent[1], self.tau, self.a_max) + push


@dataclass(frozen=True)
class ByTwist(Vehicle):
    """Speed and yaw rate of a base."""

    tau: tuple[float, float] = (0.15, 0.15)
    a_max: tuple[float, float] = (1.0, 3.0)

    def asked(self, v: float, w: float) -> tuple[float, float]:
        return v, w

    def twist(self, first: float, second: float) -> tuple[float, float]:
        return first, second + self.drift

    def change(self, first: float, second: float, sent: tuple[float, float], push: float) -> tuple[float, float]:
        a = toward(first, sent[0], self.tau[0], self.a_max[0]) + push
        return a, toward(second, sent[1], self.tau[1], self.a_max[1])


@dataclass(frozen=True)
class Steered(Vehicle):
    """Speed and steering angle; psi' = +-v tan(angle) / L by whether the steered wheel is before or behind."""

    wheelbase: float = 1.2
    tau: float = 0.2
    a_max: float = 1.0
    steering_tau: float = 0.1
    steering_rate: float = 0.8
    stop: float = 1.0
    behind: bool = False

    def asked(self, v: float, w: float) -> tuple[float, float]:
        if abs(v) < 1e-3:
            return v, 0.0
        angle = min(max(np.arctan(self.wheelbase * w / v), -self.stop), self.stop)
        return v, -angle if self.behind else angle

    def twist(self, first: float, second: float) -> tuple[float, float]:
        w = first * np.tan(second) / self.wheelbase
        return first, (-w if self.behind else w) + self.drift

    def change(self, first: float, second: float, sent: tuple[float, float], push: float) -> tuple[float, float]:
        wanted = min(max(sent[1], -self.stop), self.stop)
        a = toward(first, sent[0], self.tau, self.a_max) + push
        return a, toward(second, wanted, self.steering_tau, self.steering_rate)


def run(vehicle: Vehicle, twists: Sequence[tuple[float, float]], period: float, start: Array, times: Array) -> Array:
    """States (n, 5) at `times` of a vehicle at rest that is sent one of the twists every period; 0 is sent before."""
    commands = [(0.0, 0.0), *(vehicle.asked(v, w) for v, w in twists)]
    arrivals = [motor.delay + period * np.arange(len(twists)) for motor in vehicle.motors]
    marks = np.unique(np.round(np.concatenate([[0.0], *arrivals, times]), 9))
    marks = marks[marks <= times[-1] + 1e-9]
    state, states = np.r_[start, 0.0, 0.0], {0.0: np.r_[start, 0.0, 0.0]}
    for begin, end in zip(marks[:-1], marks[1:], strict=True):
        came = [int(np.searchsorted(line, begin + 1e-7, "right")) for line in arrivals]
        sent = tuple(m.delivered(commands[k][i]) for i, (m, k) in enumerate(zip(vehicle.motors, came, strict=True)))
        step = solve_ivp(vehicle.rate, (begin, end), state, args=(sent,), rtol=1e-9, atol=1e-11)
        state = step.y[:, -1]
        states[float(end)] = state
    known = np.array(sorted(states))
    return np.array([states[float(known[np.argmin(np.abs(known - t))])] for t in times])


def stepped(
    vehicle: Vehicle,
    twists: Sequence[tuple[float, float]],
    period: float,
    start: Array,
    step: float = 0.005,
    then: Vehicle | None = None,
) -> Array:
    """States (n, 5) at the beginning of every period, by Runge and Kutta's steps: a hundred times faster than `run`.

    `step` must divide the period and the delays; `then` is what the vehicle is from half of the time on, as late.
    """
    each, state = round(period / step), np.r_[start, 0.0, 0.0]
    late = [round(motor.delay / step) for motor in vehicle.motors]
    commands = [vehicle.asked(v, w) for v, w in twists]
    states = np.empty((len(commands), 5))
    for i in range(each * len(commands)):
        if i % each == 0:
            states[i // each] = state
        now = vehicle if then is None or 2 * i < each * len(commands) else then
        came = [(i - k) // each if i >= k else None for k in late]
        u = [0.0 if k is None else commands[k][j] for j, k in enumerate(came)]
        sent = tuple(motor.delivered(x) for motor, x in zip(now.motors, u, strict=True))
        a = np.array(now.rate(i * step, state, sent))
        b = np.array(now.rate((i + 0.5) * step, state + step / 2 * a, sent))
        c = np.array(now.rate((i + 0.5) * step, state + step / 2 * b, sent))
        d = np.array(now.rate((i + 1) * step, state + step * c, sent))
        state = state + step / 6 * (a + 2 * b + 2 * c + d)
    return states
