"""Rows of numbers for each side of each decision: found at random, and by getting nearer to what is missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from .. import tables as route_tables
from ..program import Program
from .rows import FIRST, START, STEP, USUAL, Layout
from .values import Values

COUNT, LEAST, ROUNDS = 256, 12, 120  # rows tried at once, how often at least and at most
IDLE = 60  # rounds without a find after which it ends
SPECIAL = np.array([0.0, np.nan, np.inf, -np.inf, 1e-300, 1e154, -1e154, 1e300, -1e300, 1e307, -1e307])
CLEAR = 1e-3  # a margin from which a row is as good as any


class Found(NamedTuple):
    """Rows that take both ways wherever that was found, and the ways that were not."""

    rows: np.ndarray
    missing: tuple[str, ...]
    goals: int


class _Search:
    def __init__(self, program: Program, layout: Layout, dtype: type[np.floating], seeds: np.ndarray) -> None:
        self.program, self.layout, self.dtype, self.rng = program, layout, dtype, np.random.default_rng(0)
        self.seeds, self.found, self.near, self.clear = seeds, {}, {}, {}
        given = {v for group in program.arguments.values() for field in group for v in field.variables}
        self.used = [i for i, name in enumerate(layout.names) if name in given and name in program.read]
        self.goals: dict[tuple[str, bool], None] = {}

    def look(self, rows: np.ndarray, laid: Mapping[str, np.ndarray], sizes: Mapping[str, float]) -> bool:
        """Take what is new of these rows, all on one route."""
        values = Values(laid, self.dtype, len(rows))
        known = dict(zip(self.layout.names, rows.T, strict=True))
        values.run(self.program, known | {name: np.full(len(rows), x) for name, x in sizes.items()})
        new, usual = False, (np.abs(rows[:, len(FIRST) :]) < USUAL).all(axis=1)
        for site in values.sites:
            for way in (True, False):
                key = site.name, way
                self.goals.setdefault(key)
                if key not in self.found:
                    new |= self._take(key, rows, site.reached, site.holds == way, site.margin)
                self._keep_clear(key, rows, site.reached & (site.holds == way) & usual, site.margin)
        return new

    def _keep_clear(self, key: tuple[str, bool], rows: np.ndarray, right: np.ndarray, margin: np.ndarray) -> None:
        """Of rows of usual numbers the one that goes this way most clearly: there the other way would show."""
        away = np.where(right & np.isfinite(margin), np.abs(margin), -1.0)
        best = int(np.argmax(away))
        if away[best] > self.clear.get(key, (0.0, None))[0]:
            self.clear[key] = float(away[best]), rows[best].copy()

    def _take(
        self, key: tuple[str, bool], rows: np.ndarray, reached: np.ndarray, right: np.ndarray, m: np.ndarray
    ) -> bool:
        away = np.abs(np.where(np.isfinite(m), m, 0.0 if key in self.near else np.inf))
        if (hits := np.flatnonzero(reached & right)).size:
            self.found[key] = rows[hits[np.argmax(np.minimum(away[hits], CLEAR))]].copy()
            self.near.pop(key, None)
            return True
        there = np.flatnonzero(reached & np.isfinite(m))
        if there.size:
            best = there[np.argmin(np.abs(m[there]))]
            if key not in self.near or abs(m[best]) < self.near[key][0]:
                self.near[key] = float(abs(m[best])), rows[best].copy()
        return False

    def candidates(self) -> np.ndarray:
        """Half of them near a row that nearly does what is missing, the others from anywhere."""
        rng, rows = self.rng, self.seeds[self.rng.integers(len(self.seeds), size=COUNT)].copy()
        near = [row for _, row in self.near.values()]
        for i in range(COUNT if near else 0):
            if i % 2:
                rows[i] = near[rng.integers(len(near))]
        for i in range(COUNT):
            self._change(rows[i])
        return rows.astype(self.dtype).astype(float)

    def _change(self, row: np.ndarray) -> None:
        rng = self.rng
        chosen = (
            self.used
            if rng.random() < 0.15
            else rng.choice(self.used, size=min(1 + rng.geometric(0.5), len(self.used)))
        )
        for i in chosen:
            kind = rng.random()
            if kind < 0.35:
                row[i] += rng.normal() * max(abs(row[i]), 1e-3) * 10 ** rng.uniform(-6, 1)
            elif kind < 0.6:
                row[i] = rng.normal() * 10 ** rng.uniform(-3, 3)
            elif kind < 0.7:
                row[i] *= 10 ** rng.uniform(-3, 3)
            elif kind < 0.8:
                row[i] = rng.choice(SPECIAL)
            elif kind < 0.9:
                row[i] = np.sign(rng.normal()) * 10 ** rng.uniform(-300, 307)
            else:
                row[i] = row[rng.choice(self.used)]


def search(
    program: Program,
    layout: Layout,
    seeds: np.ndarray,
    laid: Sequence[route_tables.Route],
    dtype: type[np.floating],
    start: bool,
) -> Found:
    """Rows for both sides of every decision of a step, or of a start.

    Args:
        program: whose decisions they are.
        layout: of rows.
        seeds: rows to begin from; all of them are looked at first.
        laid: routes that rows are run on by their number; none of a law that follows none.
        dtype: in which the code computes.
        start: whether the program is the start.
    """
    found = _Search(program, layout, dtype, seeds)
    places = [({}, {})] if not laid else [(route_tables.arrays(r), _sizes(r)) for r in laid]
    idle = 0
    with np.errstate(all="ignore"):
        for number in range(ROUNDS):
            new = False
            if number == 0:
                new = any([found.look(_on(seeds, k), *place) for k, place in enumerate(places)])
            else:
                k = number % len(places)
                new = found.look(_on(found.candidates(), k), *places[k])
            idle = 0 if new else idle + 1
            if (len(found.found) == len(found.goals) and number >= LEAST) or idle > IDLE:
                break
    kept = [*found.found.values(), *(row for _, row in found.clear.values())]
    rows = np.unique(np.array(kept), axis=0) if kept else seeds[:1].copy()
    rows[:, 0], rows[:, 2] = START if start else STEP, 0.0
    missing = tuple(f"{name}: never {str(way).lower()}" for name, way in found.goals if (name, way) not in found.found)
    return Found(rows, missing, len(found.goals))


def _on(rows: np.ndarray, route: int) -> np.ndarray:
    rows = rows.copy()
    rows[:, 1] = float(route)
    return rows


def _sizes(route: route_tables.Route) -> dict[str, float]:
    return {f"r_{name}": float(x) for name, x in route_tables.Sizes.of(route)._asdict().items()}
