"""CasADi: one symbolic RK4 step, folded over the horizon; one scenario after the other, double precision only."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca
import numpy as np

from . import constants, equations

STATES, SIGNALS, PARAMETERS = (len(n) for n in (constants.STATES, constants.SIGNALS, constants.PARAMETERS))


def contestant(
    values: Mapping[str, np.ndarray], *, dt: float, n_steps: int, dtype: str, compiled: bool = False
) -> Callable[[], np.ndarray]:
    """RK4 in CasADi's virtual machine, or, if `compiled`, with the step as C code built by gcc."""
    if dtype != "float64":
        raise ValueError(f"CasADi computes in float64, not {dtype}")
    step, squared_error = _functions(dt, compiled)
    rollout = step.fold(n_steps)
    table = constants.tabulate(dt, n_steps, dtype)
    rows = ca.DM(np.hstack([table[0:-1:2], table[1::2], table[2::2]]).T)  # one column per step
    # what differs between scenarios travels with the state: as an input it would be repeated for every step
    start = np.pad(np.hstack([constants.start(values), constants.parameters(values)]), ((0, 0), (0, 1)))

    def run() -> np.ndarray:
        rmse = np.empty(len(start))
        for i, first in enumerate(start):
            last = rollout(first, rows)
            ends = squared_error(last, table[-1]) - squared_error(first, table[0])  # the trapezoid: half of either end
            rmse[i] = np.sqrt(float(last[-1] + ends / 2) / n_steps)
        return rmse

    return run


def _functions(dt: float, compiled: bool) -> tuple[Any, Any]:
    """One step, and the squared error at its start, of state, parameters and sum in one column."""
    derivative = equations.closed_loop(
        exp=ca.exp, maximum=ca.fmax, minimum=ca.fmin, nearest=lambda a: ca.floor(a + 0.5)
    )

    def rate(state: Any, row: Any) -> tuple[Any, Any]:
        rates, error = derivative(ca.vertsplit(state), ca.vertsplit(row), ca.vertsplit(parameters))
        return ca.vertcat(*rates), error

    whole, rows = ca.SX.sym("whole", STATES + PARAMETERS + 1), ca.SX.sym("rows", 3 * SIGNALS)
    state, parameters, total = ca.vertsplit(whole, [0, STATES, STATES + PARAMETERS, whole.numel()])
    begin, middle, end = ca.vertsplit(rows, SIGNALS)
    d1, error = rate(state, begin)
    d2, _ = rate(state + dt / 2 * d1, middle)
    d3, _ = rate(state + dt / 2 * d2, middle)
    d4, _ = rate(state + dt * d3, end)
    moved = state + dt / 6 * (d1 + 2 * d2 + 2 * d3 + d4)
    options = {"jit": True, "compiler": "shell", "jit_options": {"flags": ["-O3", "-march=native", "-ffast-math"]}}
    step = ca.Function(
        "step", [whole, rows], [ca.vertcat(moved, parameters, total + error)], options if compiled else {}
    )
    return step, ca.Function("squared_error", [whole, begin], [error])
