"""Loops as python-control has them, one for each actuator with all others closed, and their margins."""

from __future__ import annotations

from typing import NamedTuple

import control
import numpy as np

from agvjax.linear import GROWTH, SLOWEST

FREQUENCIES = 300  # up to half the sampling frequency
NOTHING = 1e-9  # a loop's gain that is smaller is what rounding leaves of none


class Margins(NamedTuple):
    """Margins of one loop, all others closed; 0, and infinite sensitivity, if it is unstable."""

    gain: float  # its gain may become so many times as large
    less: float  # and so many times as small
    phase: float  # rad
    delay: float  # s, more than there is
    sensitivity: float  # largest |S|, Ms
    crossover: float  # rad/s, where the delay margin is; NaN where the gain is below 1 everywhere
    growth: float  # 1/s, of the fastest mode of the closed loop


LOST = Margins(0.0, 1.0, 0.0, 0.0, np.inf, np.nan, np.inf)


def spaces(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, period: float) -> list[control.StateSpace]:
    """By input L of the loop that is cut there while the others are closed, negative feedback; `whole` matrices."""
    found, m = [], D.shape[0]
    for i in range(m):
        o = [k for k in range(m) if k != i]
        closing = np.linalg.inv(np.eye(len(o)) - D[np.ix_(o, o)])  # u_o = C_o x + D_oi u_i, closed by themselves
        state, direct = closing @ C[o], closing @ D[np.ix_(o, [i])]
        found.append(
            control.StateSpace(
                A + B[:, o] @ state,
                B[:, [i]] + B[:, o] @ direct,
                -(C[[i]] + D[np.ix_([i], o)] @ state),
                -(D[np.ix_([i], [i])] + D[np.ix_([i], o)] @ direct),
                period,
            )
        )
    return found


def frequencies(period: float, changing: float = 0.0) -> np.ndarray:
    """Where a loop that itself changes so fast [rad/s] is looked at [rad/s]."""
    return np.geomspace(max(SLOWEST, changing), np.pi / period * (1 - 1e-6), FREQUENCIES)


def margins(space: control.StateSpace, period: float, fastest: float, changing: float = 0.0) -> Margins:
    """Margins of a loop, by python-control, from its frequency response.

    A loop that is taken at one instant says nothing of what is slower than it changes itself [rad/s]: it is another by
    then. So frequencies count from there on, and modes that grow faster.
    """
    if fastest > GROWTH + changing:
        return LOST._replace(growth=fastest)
    response = control.frequency_response(space, frequencies(period, changing))
    gains, phases, stability, _, crossings, _ = control.stability_margins(response, returnall=True)
    more, less = gains[(gains > 1) & (gains < 1 / NOTHING)], gains[gains < 1]
    ahead = np.radians(phases) % (2 * np.pi)  # how much lag it takes at each crossing, all the way round if need be
    delays = ahead / crossings if len(crossings) else np.array([])
    first = int(np.argmin(delays)) if len(delays) else None
    return Margins(
        gain=float(np.min(more, initial=np.inf)),
        less=float(np.max(less, initial=0.0)),
        phase=float(np.radians(np.min(np.abs(phases), initial=180.0))),
        delay=np.inf if first is None else float(delays[first]),
        sensitivity=float(1 / np.min(stability)) if len(stability) else 1.0,
        crossover=np.nan if first is None else float(crossings[first]),
        growth=fastest,
    )
