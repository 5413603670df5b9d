"""The most likely failures: the points nearest to the middle of the ensemble, from several starts.

Hasofer and Lind (1974), Rackwitz and Fiessler (1978): to where the linearised level is 0, as near as can be; shorter
steps where the merit does not improve (Zhang and Der Kiureghian, 1995). What is returned has been seen to fail.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .problem import FARTHEST, Problem

Seen = Callable[[np.ndarray, np.ndarray, np.ndarray], None]  # is told places, levels and whose they are
STEPS = 10  # of every search
FEW = 2  # searches that are always made
LENGTHS = (1.0, 0.5, 0.25, 0.1)  # tried, as shares of the full step
OUTWARD = (1.0, 1.01, 1.03, 1.1, 1.25, 1.5)  # where a failure is looked for behind the end of a search
HALVINGS = 7  # of the way to the boundary
APART = 1.0  # points nearer to each other than this count as one
SURE = 1e-6  # level from which a failure stays one whatever the rounding, so that it can be shown again
FLAT = 1e-16  # squared slopes that lead nowhere
FAINT = 14.0  # of the squared distances: failures e^-7 times as likely as the most likely one are left out


def starts(u: np.ndarray, levels: np.ndarray, count: int) -> np.ndarray:
    """The most likely of failures u (n, D), and those of the others that are likely and lie in other directions.

    Where none fails, the highest.
    """
    failing = u[levels > 0]
    if not len(failing):
        return u[np.argsort(-levels, kind="stable")[:count]]
    square = (failing**2).sum(axis=1)
    failing = failing[square <= square.min() + 2 * FAINT]
    far = np.maximum(np.linalg.norm(failing, axis=1), 1e-9)
    ways = failing / far[:, None]
    chosen = [int(np.argmin(far))]
    while len(chosen) < min(count, len(failing)):
        nearest = (ways @ ways[chosen].T).max(axis=1)
        chosen.append(int(np.argmin(nearest)))
    return failing[chosen]


def search(problem: Problem, u: np.ndarray, rollouts: int) -> np.ndarray:
    """Failures (k, D) as near to the middle as the searches from u (n, D) come; k <= 2 n, the nearest first.

    Args:
        problem: what fails.
        u: where to begin.
        rollouts: about so many are spent on gradients; of more searches than that allows the first go on.
    """
    best, place = np.full(len(u), np.inf), u.copy()
    first = max(FEW, rollouts // (STEPS * (1 + problem.size + len(LENGTHS))))

    def seen(at: np.ndarray, levels: np.ndarray, lanes: np.ndarray) -> None:
        far = np.linalg.norm(at, axis=1)
        for i in np.flatnonzero((levels > 0) & (far < best[lanes])):
            if far[i] < best[lanes[i]]:
                best[lanes[i]], place[lanes[i]] = far[i], at[i]

    for _ in range(STEPS if problem.climb is not None else 0):
        levels, slopes = problem.slopes(u[:first])
        seen(u[:first], levels, np.arange(len(levels)))
        lanes = np.flatnonzero((slopes**2).sum(axis=1) > FLAT)
        if not len(lanes):
            break
        u = u.copy()
        u[lanes] = _step(problem, u[lanes], levels[lanes], slopes[lanes], lambda x, y, i, n=lanes: seen(x, y, n[i]))
    return _behind(problem, np.concatenate([u, place[np.isfinite(best)]]))


def _step(problem: Problem, u: np.ndarray, levels: np.ndarray, slopes: np.ndarray, seen: Seen) -> np.ndarray:
    """The best of some lengths of the step of every search."""
    steep = (slopes**2).sum(axis=1)
    full = (((slopes * u).sum(axis=1) - levels) / steep)[:, None] * slopes
    price = 2 * np.maximum(np.linalg.norm(u, axis=1), 1.0) / np.sqrt(steep)  # of the level, in the merit
    tried = np.concatenate([np.clip(u + length * (full - u), -FARTHEST, FARTHEST) for length in LENGTHS])
    lanes = np.tile(np.arange(len(u)), len(LENGTHS))
    found = problem.levels(tried)
    seen(tried, found, lanes)
    with np.errstate(invalid="ignore"):
        merit = (tried**2).sum(axis=1) / 2 + np.where(np.isfinite(found), price[lanes] * np.abs(found), np.inf)
    best = np.argmin(merit.reshape(len(LENGTHS), -1), axis=0)
    return tried.reshape(len(LENGTHS), *u.shape)[best, np.arange(len(u))]


def _behind(problem: Problem, ends: np.ndarray) -> np.ndarray:
    """Along the ray of every end the first failure behind it, brought as near as halving finds."""
    outward = np.asarray(OUTWARD)
    tried = (outward[:, None, None] * ends).reshape(-1, ends.shape[1])
    failing = (problem.levels(tried) > SURE).reshape(len(outward), -1)
    met = failing.any(axis=0)
    first = np.argmax(failing, axis=0)
    high = outward[first]
    low = np.where(first > 0, outward[np.maximum(first - 1, 0)], 0.0)
    low, high, ends = low[met], high[met], ends[met]
    for _ in range(HALVINGS if met.any() else 0):
        middle = (low + high) / 2
        fails = problem.levels(middle[:, None] * ends) > SURE
        low, high = np.where(fails, low, middle), np.where(fails, middle, high)
    points = high[:, None] * ends
    return points[np.argsort(np.linalg.norm(points, axis=1), kind="stable")]


def distinct(points: np.ndarray, most: int, known: np.ndarray | None = None) -> np.ndarray:
    """Those of the points (n, D), in their order, that lie apart, after the `known`, and are not far less likely."""
    kept = [] if known is None else list(known)
    square = (points**2).sum(axis=1)
    least = min([*square.tolist(), *(float(x @ x) for x in kept)], default=0.0)
    for point, far in zip(points, square, strict=True):
        near = any(np.linalg.norm(point - other) < APART for other in kept)
        if len(kept) < most and far <= least + FAINT and not near:
            kept.append(point)
    return np.array(kept).reshape(-1, points.shape[1])
