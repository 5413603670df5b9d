"""Figures into files, whatever their numbers: one that cannot be drawn becomes a picture that says so."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from agvjax.draw import plot

from .files import write_by

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Drawing = Callable[[], "Figure"]
FAILURES = (ValueError, ArithmeticError)  # of NumPy and matplotlib where numbers are too large, not finite or none


def write_figures(folder: Path, drawings: Mapping[str, Drawing], ending: str = "png") -> list[str]:
    """Draw and write every figure under its name; returns a sentence for each that could not be drawn."""
    said = []
    for name, drawing in drawings.items():
        path = folder / f"{name}.{ending}"
        try:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore", RuntimeWarning)  # NumPy's, of numbers that overflow or are none
                warnings.filterwarnings("ignore", "Attempting to set identical")  # matplotlib makes room by itself
                warnings.filterwarnings("ignore", "Creating legend")  # that takes a second on a busy machine
                _write(path, drawing())
        except FAILURES as error:
            why = f"{path.name} could not be drawn, its numbers are too large or not finite"
            said.append(f"{why} ({error})")
            _write(path, _words(why))
    return said


def _write(path: Path, figure: Figure) -> None:
    write_by(path, lambda file: figure.savefig(file, format=path.suffix[1:], dpi=130))


def _words(text: str) -> Figure:
    figure = plot.sheet((7.5, 0.8), layout=None)
    figure.text(0.5, 0.5, text, ha="center", va="center", fontsize=9, parse_math=False)
    return figure
