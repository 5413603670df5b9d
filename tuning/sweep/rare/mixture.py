"""What rare failures are drawn from: the ensemble itself, a wider one, and normal draws about points that fail.

All in the space of normal numbers u (n, D) behind the draws, in which the ensemble is the standard normal.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...ensemble.draws import LEAST, uniform

PLAIN = 0.5  # share of the draws that come of the ensemble itself: a weight is at most 1 over it
WIDE = 0.1  # share of those of the wider one
FLOOR = 0.02  # least share of a point, of what is left for the points


class Mixture(NamedTuple):
    """A mixture of normals: standard, `wide` times as wide, and about every point with the standard covariance."""

    points: np.ndarray  # (K, D)
    shares: np.ndarray  # (K,), of the points among each other
    wide: float

    @classmethod
    def about(cls, points: np.ndarray, shares: np.ndarray | None = None) -> Mixture:
        """About points that fail, nearer ones more often unless their `shares` are known."""
        size = points.shape[1]
        far = np.linalg.norm(points, axis=1)
        near = np.exp(-(far**2 - far.min() ** 2) / 2) if shares is None else shares
        kept = np.maximum(near / np.sum(near), FLOOR)
        return cls(points, kept / np.sum(kept), max(1.0, float(far.min()) / np.sqrt(size)))

    @property
    def parts(self) -> np.ndarray:
        """Shares of the plain draws, the wide ones, and those about every point."""
        return np.concatenate([[PLAIN, WIDE], (1 - PLAIN - WIDE) * self.shares])

    def draw(self, seed: int, stream: str, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Draws u (count, D) from number `first`, and which are plain (count,); keyed by seed, stream and number."""
        size = self.points.shape[1]
        shares = uniform(seed, f"{stream}#rare", count, size + 1, first)
        part = np.searchsorted(np.cumsum(self.parts)[:-1], shares[:, 0], side="right")
        u = normal(shares[:, 1:])
        centers = np.concatenate([np.zeros((2, size)), self.points])
        return centers[part] + np.where(part == 1, self.wide, 1.0)[:, None] * u, part == 0

    def ratios(self, u: np.ndarray) -> np.ndarray:
        """By part, how much denser it is than the ensemble, logarithms (2 + K, n)."""
        square = (u**2).sum(axis=1)
        size = u.shape[1]
        wide = -size * np.log(self.wide) + square * (1 - self.wide**-2) / 2
        near = self.points @ u.T - (self.points**2).sum(axis=1)[:, None] / 2
        return np.concatenate([np.zeros((1, len(u))), wide[None], near])

    def weights(self, u: np.ndarray) -> np.ndarray:
        """Density of the ensemble over that of the mixture, (n,): at most 1 / PLAIN."""
        ratios = self.ratios(u)
        largest = ratios.max(axis=0)  # so that nothing overflows
        return np.exp(-largest) / (self.parts @ np.exp(ratios - largest))

    def learned(self, u: np.ndarray, weights: np.ndarray) -> Mixture:
        """With the shares that failures u (n, D) of these `weights` come from (a step of the cross-entropy method)."""
        ratios = self.ratios(u)[2:]
        parts = np.exp(ratios - ratios.max(axis=0)) * self.shares[:, None]
        return Mixture.about(self.points, (parts / parts.sum(axis=0)) @ weights)


def normal(shares: np.ndarray) -> np.ndarray:
    """Standard normal numbers of shares in [0, 1)."""
    from scipy.special import ndtri

    return ndtri(np.clip(shares, LEAST, 1 - LEAST))
