"""The map of a proof: the largest error over its bound, simulated, and the boxes that are proved and found."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ...config.settings import Config
from ...io.panels import panels
from .found import late_errors, scenarios
from .problem import box, nominal
from .prove import Certified

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POINTS, PLANES, MARGIN = 21, 3, 1.15  # of a plane along each side; planes; how far beyond the widest box it goes
SHORT = (("deadzone.", ""), ("disturbance.", ""), ("start.", "start "), (".", " "), ("_", " "))


class Plane(NamedTuple):
    """Two sides of the box, and the error over its bound on a grid of them, all else nominal."""

    names: tuple[str, str]
    ticks: tuple[np.ndarray, np.ndarray]
    errors: np.ndarray  # (POINTS, POINTS), over the bound; the second side is the row


def planes(config: Config, found: Certified) -> list[Plane]:
    """Simulated planes: of sides that differ in kind, so that slopes, thresholds and amplitude are all seen."""
    whole = box(config)
    long = [name for name, (low, high) in whole.items() if high > low]
    kinds = {kind: next((name for name in long if kind in name), "") for kind in ("slope", "threshold", "amplitude")}
    chosen = [name for name in kinds.values() if name] or long
    others = [name for name in long if name not in chosen]
    names = (chosen + others)[:PLANES]
    pairs = [(a, b) for i, a in enumerate(names) for b in names[i + 1 :]][:PLANES]
    return [_plane(config, pair, max(1.0, min(found.found, 2.0)) * MARGIN) for pair in pairs]


def _plane(config: Config, names: tuple[str, str], share: float) -> Plane:
    ends, middle = box(config, share), nominal(config)
    whole = box(config)
    ticks = []
    for name in names:
        low, high = ends[name]
        low = max(low, 0.02 * middle[name]) if whole[name][0] >= 0 else low
        ticks.append(np.linspace(low, high, POINTS))
    first, second = (jnp.ravel(x) for x in jnp.meshgrid(*map(jnp.asarray, ticks)))
    values = {name: jnp.full(first.shape, value) for name, value in middle.items()} | dict(
        zip(names, (first, second), strict=True)
    )
    leaves = scenarios(config.scenario, values)
    limits = np.array([config.certify.within, config.certify.within, config.certify.within_heading])
    timing = config.timing("sweep")

    def errors(leaves: dict[str, jax.Array]) -> tuple[jax.Array, jax.Array]:
        return late_errors(config.controller, config.scenario, leaves, config.criteria.late, **timing)

    worst, ok = jax.jit(errors)(leaves)
    over = np.where(np.asarray(ok), np.max(np.asarray(worst) / limits[:, None], axis=0), np.nan)
    return Plane(names, (ticks[0], ticks[1]), over.reshape(POINTS, POINTS))


def boxes(config: Config, found: Certified, seen: list[Plane]) -> Figure:
    """Each plane with the proved box, the found one and the one asked about."""
    drawn, axes = panels(1, len(seen), (4.6 * len(seen), 4.4))
    for plane, ax in zip(seen, axes[0], strict=True):
        mesh = ax.pcolormesh(*plane.ticks, np.minimum(plane.errors, 2.0), cmap="RdYlGn_r", vmin=0, vmax=2)
        ax.contour(*plane.ticks, np.nan_to_num(plane.errors, nan=9.0), levels=[1.0], colors="k", linewidths=0.8)
        for ends, color, style, label in _rectangles(config, found):
            (x0, x1), (y0, y1) = (ends[name] for name in plane.names)
            ax.plot([x0, x1, x1, x0, x0], [y0, y0, y1, y1, y0], style, color=color, lw=1.8, label=label)
        ax.set(xlabel=_short(plane.names[0]), ylabel=_short(plane.names[1]))
        ax.set_xlim(plane.ticks[0][0], plane.ticks[0][-1])
        ax.set_ylim(plane.ticks[1][0], plane.ticks[1][-1])
        drawn.colorbar(mesh, ax=ax, shrink=0.85, label="error / bound, all else nominal")
    axes[0][0].legend(fontsize=7, loc="upper left")
    return drawn


def _rectangles(config: Config, found: Certified) -> list[tuple[dict[str, tuple[float, float]], str, str, str]]:
    shown = [(box(config), "0.25", ":", "asked"), (box(config, found.found), "tab:blue", "--", "no violation found")]
    return shown + ([(found.box, "k", "-", "proved")] if found.box else [])


def _short(name: str) -> str:
    for old, new in SHORT:
        name = name.replace(old, new)
    return name
