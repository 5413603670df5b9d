"""Numba: regulated pure pursuit on a base, the way a careful user writes it: scalars, a window of a fine polyline."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numba
import numpy as np

compiled = numba.njit(fastmath=True)
APART, WINDOW = 0.01, 40  # m between points of the polyline; points either way that the nearest one is looked for in
LOOK_AHEAD, LEAST, MOST = 1.5, 0.3, 0.9  # s, m, m
MIN_RADIUS, MIN_SPEED, MAX_TURN = 0.9, 0.25, 1.5  # m, m/s, rad/s
TRACK = 0.5  # m
LEAVES = [f"deadzone.{w}.{n}_{s}" for w in ("left", "right") for n in ("threshold", "slope") for s in ("right", "left")]
LEAVES += ["actuators.left.delay.time", "actuators.right.delay.time"]
LEAVES += ["plant.time_constant", "plant.acceleration", "plant.drift"]


@compiled
def _delivered(c: Any, up: Any, down: Any, slope_up: Any, slope_down: Any) -> Any:
    return slope_up * (c - up) if c > up else slope_down * (c + down) if c < -down else 0.0 * c


@compiled
def _clip(x: Any, most: Any) -> Any:
    return min(max(x, -most), most)


@compiled
def _turned(heading: Any, left: Any, right: Any, tau: Any, most: Any, drift: Any, sent: Any) -> Any:
    v = (left + right) / 2
    rates = _clip((sent[0] - left) / tau, most), _clip((sent[1] - right) / tau, most)
    return v * math.cos(heading), v * math.sin(heading), (right - left) / TRACK + drift, rates[0], rates[1]


@compiled
def _nearest(line: Any, x: Any, y: Any, near: int) -> Any:
    best, least = near, 1e9
    for j in range(near - WINDOW, near + WINDOW):
        k = j % len(line)
        square = (line[k, 0] - x) ** 2 + (line[k, 1] - y) ** 2
        if square < least:
            best, least = k, square
    return best


@compiled
def _carrot(line: Any, x: Any, y: Any, near: int, look: Any) -> Any:
    k = near
    while (line[k, 0] - x) ** 2 + (line[k, 1] - y) ** 2 < look * look:
        k = (k + 1) % len(line)
    return line[k, 0] - x, line[k, 1] - y


@compiled
def _asked(line: Any, speed: Any, x: Any, y: Any, heading: Any, v: Any, near: int) -> Any:
    """Wheel speeds."""
    ahead, aside = _carrot(line, x, y, near, min(max(abs(v) * LOOK_AHEAD, LEAST), MOST))
    across = -math.sin(heading) * ahead + math.cos(heading) * aside
    bend = 2 * across / (ahead * ahead + aside * aside)
    wanted = speed
    if abs(bend) * MIN_RADIUS > 1:
        wanted = max(speed / (abs(bend) * MIN_RADIUS), MIN_SPEED)
    turn = _clip(wanted * bend, MAX_TURN) * TRACK / 2
    return wanted - turn, wanted + turn


@compiled
def _rollouts(line: Any, p: Any, start: Any, speed: Any, dt: Any, n: int, every: int, late: int, rms: Any) -> None:
    for i in range(len(p)):
        x, y, psi, wl, wr = start[i, 0], start[i, 1], start[i, 2], dt * 0, dt * 0
        q, near, total = p[i], 0, dt * 0
        for j in range(len(line)):  # the only time that all are looked at
            if (line[j, 0] - x) ** 2 + (line[j, 1] - y) ** 2 < (line[near, 0] - x) ** 2 + (line[near, 1] - y) ** 2:
                near = j
        waiting = np.zeros((2, 8), line.dtype)  # what was sent at the last eight instants
        for k in range(n):
            near = _nearest(line, x, y, near)
            ahead, after = line[near], line[(near + 1) % len(line)]
            ex, ey = after[0] - ahead[0], after[1] - ahead[1]
            off = (ex * (y - ahead[1]) - ey * (x - ahead[0])) / math.sqrt(ex * ex + ey * ey)
            if k >= late:
                total += off * off
            if k % every == 0:
                slot = (k // every) % 8
                waiting[0, slot], waiting[1, slot] = _asked(line, speed, x, y, psi, (wl + wr) / 2, near)
            old = (max(k - round(q[8] / dt), -1) // every) % 8, (max(k - round(q[9] / dt), -1) // every) % 8
            sent = (
                _delivered(waiting[0, old[0]], q[0], q[1], q[2], q[3]),
                _delivered(waiting[1, old[1]], q[4], q[5], q[6], q[7]),
            )
            a = _turned(psi, wl, wr, q[10], q[11], q[12], sent)
            h = dt / 2
            b = _turned(psi + h * a[2], wl + h * a[3], wr + h * a[4], q[10], q[11], q[12], sent)
            c = _turned(psi + h * b[2], wl + h * b[3], wr + h * b[4], q[10], q[11], q[12], sent)
            d = _turned(psi + dt * c[2], wl + dt * c[3], wr + dt * c[4], q[10], q[11], q[12], sent)
            s = dt / 6
            x, y = x + s * (a[0] + 2 * b[0] + 2 * c[0] + d[0]), y + s * (a[1] + 2 * b[1] + 2 * c[1] + d[1])
            psi = psi + s * (a[2] + 2 * b[2] + 2 * c[2] + d[2])
            wl, wr = wl + s * (a[3] + 2 * b[3] + 2 * c[3] + d[3]), wr + s * (a[4] + 2 * b[4] + 2 * c[4] + d[4])
        rms[i] = math.sqrt(total / (n - late))


def contestant(
    values: Mapping[str, np.ndarray], points: np.ndarray, speed: float, *, dt: float, n_steps: int, dtype: str
) -> Callable[[], np.ndarray]:
    """RMS distances to the way through dense `points` (N, 2) after 4 s, one vehicle after the other."""
    arc = np.r_[0, np.cumsum(np.linalg.norm(np.diff(points, axis=0, append=points[:1]), axis=1))]
    at = np.arange(0, arc[-1], APART)
    line = np.column_stack([np.interp(at, arc, np.r_[c, c[:1]]) for c in points.T]).astype(dtype)
    parameters = np.column_stack([np.asarray(values[name]) for name in LEAVES]).astype(dtype)
    start = np.column_stack([values["start.position"], values["start.heading"]]).astype(dtype)
    number, rms = np.dtype(dtype).type, np.empty(len(start), dtype)
    counts = n_steps, round(0.05 / dt), round(4.0 / dt)

    def run() -> np.ndarray:
        _rollouts(line, parameters, start, number(speed), number(dt), *counts, rms)
        return rms.copy()

    _rollouts(line, parameters[:0], start[:0], number(speed), number(dt), *counts, rms[:0])  # compiles
    return run
