"""Figures of margins: along the run, and the Bode plot of the tightest loop beside that of the configured vehicle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from control import StateSpace
from matplotlib.figure import Figure

from agvjax.draw import plot

from ...io.panels import panels
from .loops import frequencies

COLORS = ("tab:blue", "tab:orange", "tab:green", "tab:red", "tab:purple")


def along(t: np.ndarray, delays: np.ndarray, sensitivities: np.ndarray, names: Sequence[str]) -> Figure:
    """Delay margin [ms] and Ms of every vehicle (V, K, m) along the run: the tightest, and the median."""
    drawn, ((delay, peak),) = panels(1, 2, (10.5, 3.8))
    for i, name in enumerate(names):
        color = COLORS[i % len(COLORS)]
        for axes, values, least in (
            (delay, 1e3 * delays[:, :, i], np.nanmin),
            (peak, sensitivities[:, :, i], np.nanmax),
        ):
            known = np.isfinite(values).any(axis=0)
            inside = np.where(np.isfinite(values), values, np.nan)[:, known]
            axes.plot(t[known], plot.shown(least(inside, axis=0)), "o-", ms=3, lw=1.2, color=color, label=name)
            axes.plot(t[known], plot.shown(np.nanmedian(inside, axis=0)), ":", lw=1.2, color=color)
    delay.set(xlabel="t [s]", ylabel="more delay that it bears [ms]")
    delay.set_ylim(bottom=0)
    peak.axhline(2, color="0.5", lw=0.8)
    peak.set(xlabel="t [s]", ylabel="Ms, largest |S|", yscale="log")
    delay.legend(title="tightest vehicle; dotted: median", fontsize=8)
    return drawn


def bode(loops: Sequence[tuple[str, StateSpace]], period: float) -> Figure:
    """Gain and phase of loops, open at one actuator."""
    drawn, ((gain,), (phase,)) = panels(2, 1, (7.5, 6.0), "both", sharex=True)
    omega = frequencies(period)
    for (label, space), color in zip(loops, COLORS, strict=False):
        response = np.ravel(space(np.exp(1j * omega * period)))
        gain.loglog(omega, np.abs(response), lw=1.2, color=color, label=label)
        phase.semilogx(omega, np.degrees(np.unwrap(np.angle(response))), lw=1.2, color=color)
    gain.axhline(1, color="0.5", lw=0.8)
    phase.axhline(-180, color="0.5", lw=0.8)
    gain.set(ylabel="|L|")
    phase.set(xlabel="frequency [rad/s]", ylabel="phase [degrees]")
    gain.legend(fontsize=8)
    return drawn
