"""Commands that are not what they are taken for: of another sign or unit, or in each other's column."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from agvjax import Fault

from ..io.csv_file import Column

FAR = 3.0  # times its noise that a log may be missed by in the mean before its commands are doubted
CLOSER = 3.0  # times closer another reading of them must come to be believed
UNITS = {1e-3: "them in a unit 1000 times smaller", 1e3: "them in a unit 1000 times larger"}


class CommandReading(NamedTuple):
    """What commands may be meant as."""

    matrix: np.ndarray  # (m, m), of the commands as they stand
    words: str
    mended: str  # in the configuration


def readings(names: Sequence[str], columns: Mapping[str, Column]) -> Iterator[CommandReading]:
    """Every other reading: units, then all orders and signs, those with the fewest changes first."""
    eye, places, moves = np.eye(len(names)), [columns.get(name, Column(name)) for name in names], []
    for factor, words in UNITS.items():
        yield CommandReading(factor * eye, words, _spelled(names, places, [factor] * len(names)))
    for order in itertools.permutations(range(len(names))):
        for signs in itertools.product((1.0, -1.0), repeat=len(names)):
            moved = [name for i, name in enumerate(names) if order[i] != i]
            turned = [name for name, sign in zip(names, signs, strict=True) if sign < 0]
            parts = [f"{' and '.join(moved)} exchanged"] if moved else []
            parts += [f"{' and '.join(turned)} of the other sign"] if turned else []
            mended = _spelled(names, [places[k] for k in order], signs)
            reading = CommandReading(np.diag(signs) @ eye[list(order)], " and ".join(parts), mended)
            moves.append((len(moved) + len(turned), reading))
    yield from (reading for changes, reading in sorted(moves, key=lambda row: row[0]) if changes)


def misread(
    names: Sequence[str], columns: Mapping[str, Column], missed: float, fitted: Callable[[np.ndarray], float]
) -> list[Fault]:
    """The reading under which the commands explain a log that they do not explain as they are taken.

    Args:
        names: of the commands, m of them.
        columns: where the configuration says that they stand in the file.
        missed: root mean square of what the best fit leaves, in standard deviations of the log's own noise.
        fitted: the same with the commands that a matrix (m, m) makes of the given ones.
    """
    if missed < FAR:
        return []
    for reading in readings(names, columns):
        if (left := fitted(reading.matrix)) * CLOSER < missed:
            rule = (
                f"in the unit, sign and order they are taken for: the best fit misses the log by {missed:.3g} times its"
                f" noise, and by {left:.3g} times with {reading.words}; if that is so, say {reading.mended}"
                " in [identify.columns]"
            )
            return [Fault("identify.columns", ", ".join(columns.get(n, Column(n)).column for n in names), rule)]
    return []


def _spelled(names: Sequence[str], places: Sequence[Column], factors: Sequence[float]) -> str:
    """Lines of [identify.columns] for what is not as it stands."""
    lines = []
    for name, place, factor in zip(names, places, factors, strict=True):
        unit = f', unit = "{place.unit}"' if place.unit else ""
        times = f", factor = {factor * place.factor:g}" if factor * place.factor != 1 else ""
        if times or place.column != name:
            lines.append(f'{name} = {{ column = "{place.column}"{unit}{times} }}')
    return " and ".join(lines)
