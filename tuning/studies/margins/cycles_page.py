"""What predicted limit cycles say: sentences and rows of a table."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .cycles import Cycle, Predicted
from .study import Found

HEADER = ["vehicle", "t [s]", "input", "amplitude", "frequency [rad/s]", "mean", "stable", "harmonics", "of"]
SENT, WANTED = "input", "wanted"  # what an amplitude is of


def sentences(predicted: Predicted, found: Found, units: Mapping[str, str]) -> list[str]:
    """By input what is predicted, in the unit of the input."""
    said, told, looked = [], [], ~found.left_out & found.ok[:, None]
    for i, name in enumerate(predicted.names):
        if name in predicted.missing:
            said.append(f"Limit cycles of {name} are not predicted: {predicted.missing[name]} is not covered.")
            continue
        stable = [(c, v, k) for v, k, j, c in _each(predicted) if j == i and c.stable]
        if not stable:
            told.append(name)
            continue
        (c, v, k), vehicles = max(stable, key=lambda one: one[0].amplitude), len({v for _, v, _ in stable})
        unit = units.get(name.split("[")[0], "")
        of = f"the law's demand for {name}" if predicted.inverted[name] else name
        whose = f"vehicle {v}" if v else "the configured vehicle"
        said.append(
            f"A limit cycle of {of} is predicted for {vehicles} of {len(found.ok)} vehicles; the largest, of {whose} at"
            f" {found.t[k]:.4g} s, has an amplitude of {c.amplitude:.3g} {unit}".rstrip()
            + f" and {c.frequency:.3g} rad/s, a period of {2 * np.pi / c.frequency:.3g} s."
        )
        alone = sum(not c.harmonics for c, _, _ in stable)
        if alone:
            said.append(f"For {alone} of its {len(stable)} no harmonics were found: by the describing function alone.")
    if told:
        said.append(
            f"No limit cycle of {', '.join(told)} is predicted, at {int(looked.sum())} instants of all vehicles."
        )
    return said


def rows(predicted: Predicted, t: np.ndarray) -> list[list[object]]:
    """Every limit cycle that is predicted, also those that are not stable."""
    return [
        [v, float(t[k]), predicted.names[i], c.amplitude, c.frequency, c.mean, c.stable, c.harmonics]
        + [WANTED if predicted.inverted[predicted.names[i]] else SENT]
        for v, k, i, c in _each(predicted)
    ]


def _each(predicted: Predicted) -> list[tuple[int, int, int, Cycle]]:
    return [
        (v, k, i, c)
        for v, vehicle in enumerate(predicted.cycles)
        for k, now in enumerate(vehicle)
        for i, several in enumerate(now)
        for c in several
    ]
