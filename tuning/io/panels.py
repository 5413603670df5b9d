"""Figures with axes in rows and columns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from agvjax.draw import plot

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def panels(
    rows: int, columns: int, size: tuple[float, float], lines: str = "major", **shared: Any
) -> tuple[Figure, np.ndarray]:
    """A figure of `size` [inch] and its axes (rows, columns), each with light grid lines.

    Args:
        rows: of axes.
        columns: of axes.
        size: width and height [inch].
        lines: where grid lines are, at "major" ticks or at "both" kinds.
        **shared: as `Figure.subplots` takes it.
    """
    figure = plot.sheet(size)
    grid = figure.subplots(rows, columns, squeeze=False, **shared)
    for axes in grid.flat:
        axes.grid(alpha=0.3, which=lines)
    return figure, grid
