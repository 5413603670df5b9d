"""Figures of margins: along the run, Bode plot of the tightest loop, and where limit cycles are predicted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from control import StateSpace

from agvjax.draw import plot

from ...io.panels import panels
from .cycles import Curve, crossings
from .loops import frequencies

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
    delay.set(xlabel="t [s]", ylabel="delay margin [ms]")
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


def cycles(curve: Curve, label: str) -> Figure:
    """Nyquist curve of L beside -1 / N(A), and where they cross; where they do not, where they are closest."""
    drawn, ((axes,),) = panels(1, 1, (6.5, 5.5))
    moving = np.abs(curve.N) > 1e-3
    line = np.where(moving, -1 / np.where(moving, curve.N, 1), np.nan)
    axes.plot(np.real(curve.response), np.imag(curve.response), lw=1.2, color=COLORS[0], label=f"L, {label}")
    axes.plot(np.real(line), np.imag(line), ".-", ms=4, lw=1.2, color=COLORS[1], label="-1 / N(A)")
    axes.plot(-1, 0, "+", color="0.3", ms=10)
    found = [hit for hit in crossings(curve) if hit[-1]]
    for a, w, along_a, along_w, _ in found:
        at = curve.response[w] + along_w * (curve.response[w + 1] - curve.response[w])
        A = curve.amplitude[a] + along_a * (curve.amplitude[a + 1] - curve.amplitude[a])
        omega = curve.omega[w] + along_w * (curve.omega[w + 1] - curve.omega[w])
        axes.plot(np.real(at), np.imag(at), "o", color=COLORS[3], label=f"no harmonics: {A:.3g}, {omega:.3g} rad/s")
    if not found:
        apart, w, a = curve.nearest()
        at = curve.response[w]
        axes.plot(
            at.real, at.imag, "s", color="0.3", label=f"closest: |1 + L N| = {apart:.2g}, A = {curve.amplitude[a]:.3g}"
        )
    shown = [hit[1] for hit in found] or [curve.nearest()[1]]
    far = 1.5 * max(1.0, *np.abs(curve.response[shown]))
    axes.set(xlim=(-far, far / 3), ylim=(-far * 2 / 3, far * 2 / 3), xlabel="Re L", ylabel="Im L")
    axes.legend(fontsize=8, loc="lower left")
    return drawn
