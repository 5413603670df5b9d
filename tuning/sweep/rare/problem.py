"""What fails, as a function of normal numbers: the form in which failures are searched for and counted."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

FARTHEST = 6.361340902404056  # of a normal number, either way: 1e-10 of the draws lie beyond
BEYOND = 1e-10  # share of the draws of one number beyond it, on one side
NEAREST = 1e-12  # level of what is told to fail while its level is not above 0


@dataclasses.dataclass
class Problem:
    """Levels of vehicles by the D normal numbers u behind their draws: above 0 a vehicle fails, infinite: it diverges.

    Attributes:
        size: D.
        look: levels (n,) of u (n, D).
        climb: levels (n,) and slopes (n, D); None where there are none.
        tick: called with the number of vehicles that were rolled out.
        rollouts: of single vehicles, so far; a gradient counts 1 + its tangents.
    """

    size: int
    look: Callable[[np.ndarray], np.ndarray]
    climb: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None
    tick: Callable[[int], None] = lambda vehicles: None
    rollouts: int = 0

    def levels(self, u: np.ndarray) -> np.ndarray:
        """Levels (n,) of u (n, D); minus infinity, and nothing rolled out, where a number lies beyond `FARTHEST`."""
        inside = within(u)
        levels = np.full(len(u), -np.inf)
        if inside.any():
            levels[inside] = self.look(u[inside])
        self._count(int(inside.sum()))
        return levels

    def slopes(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Levels (n,) and slopes (n, D), 0 where there is none."""
        if self.climb is None:
            return self.levels(u), np.zeros_like(u)
        levels, slopes = self.climb(u)
        self._count(len(u) * (1 + self.size))
        return levels, np.where(np.isfinite(levels)[:, None] & np.isfinite(slopes), slopes, 0.0)

    def _count(self, rollouts: int) -> None:
        self.rollouts += rollouts
        self.tick(rollouts)

    @property
    def tail(self) -> float:
        """Probability of a draw that is not rolled out, which bounds count as failing."""
        return -float(np.expm1(self.size * np.log1p(-2 * BEYOND)))


def within(u: np.ndarray) -> np.ndarray:
    """Which draws are rolled out, (n,)."""
    return np.all(np.abs(u) <= FARTHEST, axis=1)
