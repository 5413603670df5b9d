"""SciPy's `solve_ivp`, one scenario after the other; double precision only.

LSODA at 1e-6 (relative) and 1e-8 (absolute) keeps the position within 1e-6 m, RK4 at 1e-3 s within 2e-6 m. DOP853 and
RK45 at the same tolerances take twice as long and are less accurate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
from scipy.integrate import solve_ivp

from . import constants, equations


def contestant(
    values: Mapping[str, np.ndarray],
    *,
    dt: float,
    n_steps: int,
    dtype: str,
    method: str = "LSODA",
    rtol: float = 1e-6,
    atol: float = 1e-8,
) -> Callable[[], np.ndarray]:
    """The solver chooses its steps; the squared error is integrated as one more state."""
    if dtype != "float64":
        raise ValueError(f"SciPy integrates in float64, not {dtype}")
    horizon = dt * n_steps
    derivative = equations.closed_loop(exp=math.exp, maximum=max, minimum=min, nearest=round)

    def rate(t: float, state: np.ndarray, parameters: list[float]) -> list[float]:
        # plain floats: several times faster than small arrays
        rates, error = derivative(state.tolist()[:-1], constants.signals(t, math), parameters)
        return [*rates, error]

    start = [np.append(row, 0.0) for row in constants.start(values)]
    parameters = constants.parameters(values).tolist()

    def run() -> np.ndarray:
        rmse = np.empty(len(start))
        for i, (first, numbers) in enumerate(zip(start, parameters, strict=True)):
            done = solve_ivp(rate, (0.0, horizon), first, method, [horizon], args=(numbers,), rtol=rtol, atol=atol)
            if not done.success:
                raise RuntimeError(f"scenario {i}: {done.message}")
            rmse[i] = math.sqrt(done.y[-1, -1] / horizon)
        return rmse

    return run
