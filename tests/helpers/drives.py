"""Drives of bases as robots record them, by a program that is not the package.

Commands at 50 Hz that come a quarter of a second late, the pose at 10 Hz with noise that lasts from one to the next.
"""

import csv
from dataclasses import dataclass, replace

import numpy as np

from reference_bases import Motor, TwoWheels, stepped

PERIOD, EVERY, FINE = 0.02, 5, 0.005  # s between commands; commands from pose to pose; s, of the program's steps
LATE, LASTING = 0.25, 0.9  # s; the correlation of the noise from one period to the next
NOISE = (0.01, 0.01, 0.005)  # m, m, rad, standard deviations
NAMES = ("slope_right", "slope_left", "threshold_right", "threshold_left")


@dataclass(frozen=True)
class Sticking(TwoWheels):
    """A base whose left wheel sticks: at rest it takes more to break away than to keep turning."""

    breakaway: float = 0.08  # m/s beyond the deadzone

    def change(self, first, second, sent, push):
        stuck = abs(first) < 0.01 and abs(sent[0]) < self.breakaway
        return super().change(first, second, (0.0 if stuck else sent[0], sent[1]), push)


def drawn(seed, kind=TwoWheels, **more):
    """A base, every number of it drawn."""
    rng = np.random.default_rng([seed, 1])

    def motor():
        slopes, thresholds = rng.uniform(0.85, 1.05, 2), rng.uniform(0.05, 0.1, 2)
        return Motor(*slopes, *thresholds, delay=LATE)

    motors = motor(), motor()
    numbers = {"track": rng.uniform(0.4, 0.6), "tau": rng.uniform(0.1, 0.3), "a_max": rng.uniform(0.7, 1.2)}
    return kind(motors=motors, drift=rng.uniform(-0.02, 0.02), **numbers, **more)


def truth(base):
    """Its numbers, by the names that the package has for them."""
    told = {"plant.track": base.track, "plant.time_constant": base.tau}
    told |= {"plant.acceleration": base.a_max, "plant.drift": base.drift}
    for side, motor in zip(("left", "right"), base.motors, strict=True):
        told |= {f"deadzone.{side}.{name}": getattr(motor, name) for name in NAMES}
        told[f"actuators.{side}.delay.time"] = motor.delay
    return told


def levels(seed, rows):
    """Twists (rows, 2), each held for 0.4 to 1.6 s; every third is small."""
    rng, twists = np.random.default_rng([seed, 2]), np.empty((rows, 2))
    i = k = 0
    while i < rows:
        n, size = int(rng.integers(20, 80)), 0.25 if k % 3 == 0 else 1.0
        twists[i : i + n] = size * rng.uniform([-0.7, -1.2], [0.9, 1.2])
        i, k = i + n, k + 1
    return twists


def smoothed(twists, lag):
    """What a first-order lag makes of twists that are held, every FINE."""
    held, state, out = np.repeat(twists, round(PERIOD / FINE), axis=0), np.zeros(2), []
    for u in held:
        out.append(state)
        state = state + -np.expm1(-FINE / lag) * (u - state)
    return np.array(out)


def lasting(rng, rows, share):
    """Noise of deviation 1 (rows, 3), each row `share` of the one before and something new."""
    e = rng.standard_normal((rows, 3))
    for i in range(1, rows):
        e[i] = share * e[i - 1] + np.sqrt(1 - share**2) * e[i]
    return e


def slipping(base, share=0.8):
    """The same base on another floor: its wheels roll this share of what they did."""
    slower = (replace(m, slope_right=share * m.slope_right, slope_left=share * m.slope_left) for m in base.motors)
    return replace(base, motors=tuple(slower))


# by kind: the base of a seed, and what of its drive no model of the package has
KINDS = {
    "right": lambda seed: (drawn(seed), {}),
    "white": lambda seed: (drawn(seed), {"lasts": 0.0}),
    "lag": lambda seed: (drawn(seed), {"smoother": 0.2}),
    "sticks": lambda seed: (drawn(seed, Sticking), {}),
    "floor": lambda seed: (drawn(seed), {"then": slipping(drawn(seed))}),
}


def recorded(file, base, seed, seconds=120.0, lasts=LASTING, smoother=0.0, then=None):
    """Writes a drive of a base as a CSV file; a `smoother` [s] is a lag of the commands before the base.

    `then` is what the base is from half of the drive on.
    """
    rows, each = round(seconds / PERIOD), round(PERIOD / FINE)
    twists = levels(seed, rows)
    if smoother:
        states = stepped(base, smoothed(twists, smoother), FINE, np.zeros(3), FINE)[::each]
    else:
        states = stepped(base, twists, PERIOD, np.zeros(3), FINE, then)
    seen = states[:, :3] + lasting(np.random.default_rng([seed, 3]), rows, lasts) * NOISE
    with open(file, "w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(("t", "x", "y", "heading", "cmd_v", "cmd_w"))
        for i, (pose, twist) in enumerate(zip(seen, twists, strict=True)):
            there = [f"{value:.6f}" for value in pose] if i % EVERY == 0 else [""] * 3
            writer.writerow((f"{i * PERIOD:.3f}", *there, *(f"{value:.6f}" for value in twist)))
    return str(file)
