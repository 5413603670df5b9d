"""Quadratic programmes by clarabel."""

from __future__ import annotations

from typing import Any, NamedTuple

import clarabel
import numpy as np


class Columns(NamedTuple):
    """A matrix as clarabel reads it, column by column without zeros: `scipy.sparse` takes long to import."""

    data: np.ndarray
    indices: np.ndarray  # the row of each
    indptr: np.ndarray  # where columns begin, and the end
    shape: tuple[int, ...]

    @classmethod
    def of(cls, matrix: np.ndarray) -> Columns:
        """Of a dense one."""
        columns, rows = np.nonzero(matrix.T)
        begin = np.searchsorted(columns, np.arange(matrix.shape[1] + 1))
        return cls(matrix[rows, columns], rows, begin, matrix.shape)

    @property
    def has_canonical_format(self) -> bool:
        """Rows rise within each column, and none comes twice."""
        return True

    @property
    def nnz(self) -> int:
        """How many entries there are."""
        return len(self.data)


class Unsolved(RuntimeError):
    """A problem that the solver gave up: slopes of runs that chatter may be 1e10."""


def quadratic(
    hessian: np.ndarray, cost: np.ndarray, matrix: np.ndarray, room: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Unknowns, duals and value of: minimise x' hessian x / 2 + cost' x subject to matrix x <= room.

    Raises:
        Unsolved: no solution was found.
    """
    solver: Any = clarabel  # its stubs lack these names
    settings = solver.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    cones = [solver.NonnegativeConeT(len(room))]
    upper, rows = Columns.of(np.triu(hessian)), Columns.of(matrix)
    found = solver.DefaultSolver(upper, cost, rows, room, cones, settings).solve()
    if str(found.status) not in ("Solved", "AlmostSolved"):
        raise Unsolved(f"the linearised tuning problem could not be solved: {found.status}")
    return np.array(found.x), np.array(found.z), float(found.obj_val)
