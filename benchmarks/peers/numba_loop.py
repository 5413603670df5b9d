"""Numba: scenarios outside, time inside, the state of one scenario in scalars."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numba
import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple

from . import constants, equations

compiled = numba.njit(fastmath=True)


@compiled
def _moved(s: Any, h: Any, d: Any) -> Any:
    return (
        *(s[0] + h * d[0], s[1] + h * d[1], s[2] + h * d[2], s[3] + h * d[3]),
        *(s[4] + h * d[4], s[5] + h * d[5], s[6] + h * d[6], s[7] + h * d[7]),
        *(s[8] + h * d[8], s[9] + h * d[9], s[10] + h * d[10], s[11] + h * d[11]),
        *(s[12] + h * d[12], s[13] + h * d[13], s[14] + h * d[14], s[15] + h * d[15]),
    )


def contestant(values: Mapping[str, np.ndarray], *, dt: float, n_steps: int, dtype: str) -> Callable[[], np.ndarray]:
    """RK4, one scenario after the other."""
    number = np.dtype(dtype).type
    derivative = equations.closed_loop(
        exp=math.exp, maximum=max, minimum=min, nearest=np.rint, number=number, compiled=compiled
    )
    half, third, sixth = number(dt / 2), number(dt / 3), number(dt / 6)
    whole, mean, two = number(dt), number(1 / n_steps), number(2)

    @compiled
    def rollout(start: Any, parameters: Any, table: Any, rmse: Any, final: Any) -> None:
        for i in range(len(start)):
            s, p = to_fixed_tuple(start[i], 16), to_fixed_tuple(parameters[i], 9)
            total = -derivative(s, to_fixed_tuple(table[0], 7), p)[1] / two  # the trapezoid: half of either end
            for k in range(n_steps):
                middle = to_fixed_tuple(table[2 * k + 1], 7)
                d1, error = derivative(s, to_fixed_tuple(table[2 * k], 7), p)
                d2, _ = derivative(_moved(s, half, d1), middle, p)
                d3, _ = derivative(_moved(s, half, d2), middle, p)
                d4, _ = derivative(_moved(s, whole, d3), to_fixed_tuple(table[2 * k + 2], 7), p)
                s = _moved(_moved(_moved(_moved(s, sixth, d1), third, d2), third, d3), sixth, d4)
                total += error
            total += derivative(s, to_fixed_tuple(table[2 * n_steps], 7), p)[1] / two
            rmse[i] = math.sqrt(total * mean)
            for j in range(len(s)):  # else the compensator, which drives nothing, would be optimised away
                final[i, j] = s[j]

    start = constants.start(values).astype(dtype)
    parameters, table = constants.parameters(values).astype(dtype), constants.tabulate(dt, n_steps, dtype)
    rmse, final = np.empty(len(start), dtype), np.empty_like(start)
    rollout(start[:0], parameters[:0], table, rmse[:0], final[:0])  # compiles

    def run() -> np.ndarray:
        rollout(start, parameters, table, rmse, final)
        return rmse.copy()

    return run
