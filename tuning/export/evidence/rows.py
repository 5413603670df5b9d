"""Rows of numbers that the exported step is run on: how they are laid out, and what a drive and broken numbers give."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from agvjax import Route, SpeedLimits

from .. import guard, program, tables, vectors
from ..artefact import Artefact
from ..program import Program

FIRST = ("todo", "route", "tuned")  # columns before the numbers; the last: whether with the tuned gains of the file
STEP, START, ON = 0.0, 1.0, 2.0  # what a row asks for: a step, a start, a step from the state that the row before left
GROUPS = ("gains", "state", "measurement", "reference")
HUGE = 1e306  # nearly as large as can be; at the very end XLA rounds otherwise
BROKEN = (np.nan, np.inf, -np.inf, HUGE)
ODD = 3  # the number of the first route that no planner makes
USUAL = 1e4  # in size: below it are numbers that a robot can have
ANOTHER, BESIDE = 1.37, 0.01  # times a number, and beside it
FAR = 9000.0  # m, where a float no longer tells 1 mm


class Layout(NamedTuple):
    """The columns of a row."""

    columns: dict[str, list[str]]  # by group the variables
    results: list[str]  # of a step, then whether limited, the status

    @classmethod
    def of(cls, step: Program) -> Layout:
        """Of the step of a law."""
        columns = {
            group: [str(v) for field in step.arguments.get(group, ()) for v in field.variables] for group in GROUPS
        }
        inputs = [f"input_{f.member}{place}" for f in step.results["inputs"] for place, _ in f.elements]
        return cls(columns, [f"later_{v}" for v in columns["state"]] + inputs)

    @property
    def names(self) -> list[str]:
        """All columns."""
        return [*FIRST, *(name for group in GROUPS for name in self.columns[group])]

    def split(self, row: np.ndarray) -> dict[str, np.ndarray]:
        """A row, or rows, by group."""
        cuts = np.cumsum([len(FIRST), *(len(self.columns[group]) for group in GROUPS)])
        return {group: row[..., a:b] for group, a, b in zip(GROUPS, cuts[:-1], cuts[1:], strict=True)}


def routes(artefact: Artefact) -> list[Route]:
    """That of the configuration; others, that code for routes takes its other ways on.

    One over 50 m of three legs with stops, one under 10 m that is closed; and two that no planner makes, which the code
    guards against all the same: squared speeds below 0, pieces straight up and a leg of no direction; legs of a closed
    route.
    """
    if artefact.route is None:
        return []
    points = np.array([[0, 0, 1], [20, 0, 1], [30, 4, 1], [40, 12, -1], [32, 7, -1], [20, 6, -1]], float)
    stops = np.array([0.0, 0.0, 2.0, 1.0, 0.0, 0.0])
    legs = Route.through(points, dwell=stops, limits=SpeedLimits(acceleration=0.4, deceleration=0.3))
    closed = Route.corners(np.array([[1, 0], [2, 0], [2, 2], [0, 2], [0, 0]], float), 0.5, radius=0.3, closed=True)
    table, squares, each = (np.array(x, float) for x in (legs.table, legs.squares, legs.legs))
    third = squares.shape[1] // 3
    squares[:, :third], table[1:6, third : 2 * third], each[3, -1] = -1.0, 0.0, 0.0
    odd = dataclasses.replace(legs, table=jnp.asarray(table), squares=jnp.asarray(squares), legs=jnp.asarray(each))
    more = [legs, closed, odd, dataclasses.replace(legs, closed=True)]
    return [artefact.route, *(dataclasses.replace(route, half_widths=None) for route in more)]


def usual(artefact: Artefact, step: Program, layout: Layout) -> np.ndarray:
    """The rows of the export's own self-test, with the tuned gains."""
    header, rows = vectors.table(artefact, step)
    gains = dict(zip(layout.columns["gains"], flat(artefact.controller), strict=True))
    known = dict(zip(header, rows.T, strict=True))
    told = {"todo": STEP, "route": 0.0, "tuned": 1.0} | gains
    return np.stack([np.broadcast_to(known.get(n, told.get(n)), len(rows)) for n in layout.names], axis=1)


def flat(tree: PyTree) -> np.ndarray:
    """All numbers of a tree, one after the other."""
    leaves = [np.ravel(np.asarray(x, float)) for x in jax.tree.leaves(tree)]
    return np.concatenate(leaves) if leaves else np.zeros(0)


def drive(usual: np.ndarray) -> np.ndarray:
    """A start and then steps that each go on from the state before."""
    rows = usual[: vectors.DRIVEN].copy()
    rows[:, 0] = ON
    return np.concatenate([[_with(rows[0], 0, START)], rows])


def unrolled(layout: Layout, rows: np.ndarray, made: np.ndarray) -> np.ndarray:
    """A drive's steps, each from the state that `made`, the results of the rows, has after the row before.

    A law that amplifies rounding drives apart from itself: what is compared are its steps.
    """
    rows, driven = rows.copy(), np.flatnonzero(rows[:, 0] == ON)
    begin, count = len(FIRST) + len(layout.columns["gains"]), len(layout.columns["state"])
    rows[driven, 0], rows[driven, begin : begin + count] = STEP, made[driven - 1, :count]
    return rows


def broken(layout: Layout, usual: np.ndarray) -> np.ndarray:
    """Each number of state, measurement and reference in turn NaN, infinite, huge; starts with such ones."""
    first = len(FIRST) + len(layout.columns["gains"])
    seen = first + len(layout.columns["state"])
    rows = [_with(usual[i % vectors.DRIVEN], i, x) for i in range(first, usual.shape[1]) for x in BROKEN]
    starts = [_with(_with(usual[0], 0, START), i, np.nan) for i in range(seen, usual.shape[1])]
    return np.array(rows + starts)


def singly(layout: Layout, usual: np.ndarray) -> np.ndarray:
    """Each number in turn another, on a row of the drive and on one from anywhere: what takes one for one, shows."""
    rows = []
    for i in range(len(FIRST), usual.shape[1]):
        for row in (usual[i % vectors.DRIVEN], usual[-1 - i % vectors.ANYWHERE]):
            rows.append(_with(_with(row, i, ANOTHER * row[i] + BESIDE), layout.names.index("tuned"), 0.0))
    return np.array(rows)


def far(layout: Layout, usual: np.ndarray) -> np.ndarray:
    """Positions, of vehicle and reference alike, that single precision does not tell to 1 mm, on each side."""
    rows = []
    for axis in (0, 1):
        for place in (FAR, -FAR):
            row = usual[1].copy()
            for name in (f"m_position_{axis}", f"r_position_{axis}"):
                if name in layout.names:
                    row[layout.names.index(name)] += place
            rows.append(row)
    return np.array(rows)


def _with(row: np.ndarray, column: int, value: float) -> np.ndarray:
    row = row.copy()
    row[column] = value
    return row


def strange(layout: Layout, rows: np.ndarray) -> np.ndarray:
    """Of each row whether no step and no planner makes it: a place on a leg that is none, or one of the odd routes."""
    odd = rows[:, 1] >= ODD
    for i, name in enumerate(layout.names):
        if name.endswith("place_leg"):
            odd |= (rows[:, i] != np.floor(rows[:, i])) | (rows[:, i] < 0) | (rows[:, i] >= 1)
    return odd


class Wanted(NamedTuple):
    """What the JAX step makes of rows."""

    numbers: np.ndarray  # state, inputs
    flags: np.ndarray  # limited, status: 0 taken, 1 not finite, 2 started


def by_jax(artefact: Artefact, layout: Layout, rows: np.ndarray) -> Wanted:
    """Results of the same steps and starts in JAX, of the law itself with its own routes, in double precision.

    A step of a drive begins in the state that stands in its row: `unrolled` rows have the right one there.
    """
    law, laid = artefact.controller, routes(artefact)
    state, seen, asked = program.examples(law)
    numbers, flags = [], []
    for row in rows:
        parts = layout.split(row)
        controller, measurement = _tree(law, parts["gains"]), _tree(seen, parts["measurement"])
        given = tables.to_follow(laid[int(row[1])]) if laid else _tree(asked, parts["reference"])
        if row[0] == START:
            begun, inputs, flag = _start(controller, measurement, given), np.zeros(_inputs(layout)), (0.0, 0.0)
        else:
            made = vectors.step(controller, _tree(state, parts["state"]), measurement, given)
            begun, inputs = made["state"], flat(made["inputs"])
            status = 1.0 if made["status"]["not_finite"] else 2.0 * float(made["status"]["started"])
            flag = float(made["limited"]["limited"]), status
        numbers.append(np.concatenate([flat(begun), inputs]))
        flags.append(flag)
    return Wanted(np.array(numbers), np.array(flags))


_start = jax.jit(guard.start)


def _inputs(layout: Layout) -> int:
    return len(layout.results) - len(layout.columns["state"])


def _tree(like: PyTree, numbers: np.ndarray) -> PyTree:
    leaves, treedef = jax.tree.flatten(like)
    cuts = np.cumsum([int(np.size(x)) for x in leaves])[:-1]
    parts = np.split(numbers, cuts) if leaves else []
    made = [jnp.asarray(part.reshape(np.shape(x))) for part, x in zip(parts, leaves, strict=True)]
    return jax.tree.unflatten(treedef, made)
