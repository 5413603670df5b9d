"""A program of scalar operations on many rows of numbers at once, and how near each of its decisions was."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..operations import LOOKUP, Choice, Least, Operand, Operation, Statement
from ..program import Program

Row = np.ndarray
COMPARED = {"gt": 1, "ge": 1, "lt": -1, "le": -1}
MATHS: dict[str, Callable[..., Row]] = {
    "add": np.add, "add_any": np.add, "sub": np.subtract, "mul": np.multiply, "div": np.divide, "exp": np.exp,
    "agvjax_exp": np.exp, "exp2": np.exp2, "expm1": np.expm1, "log": np.log, "log1p": np.log1p, "sin": np.sin,
    "cos": np.cos, "tan": np.tan, "sinh": np.sinh, "cosh": np.cosh, "tanh": np.tanh, "sqrt": np.sqrt, "abs": np.abs,
    "floor": np.floor, "ceil": np.ceil, "atan2": np.arctan2, "pow": np.power, "rem": np.fmod, "atan": np.arctan,
    "asin": np.arcsin, "acos": np.arccos, "neg": np.negative, "square": np.square, "sign": np.sign,
    "gt": np.greater, "ge": np.greater_equal, "lt": np.less, "le": np.less_equal, "eq": np.equal, "ne": np.not_equal,
    "and": np.logical_and, "or": np.logical_or, "not": np.logical_not, "xor": np.logical_xor, "max": np.maximum,
    "min": np.minimum, "is_finite": np.isfinite, "rsqrt": lambda x: 1 / np.sqrt(x),
    "logistic": lambda x: 1 / (1 + np.exp(-x)), "clamp": lambda low, x, high: np.clip(x, low, high),
    "select_n": lambda c, no, yes: np.where(c, yes, no),
}  # fmt: skip


class Site(NamedTuple):
    """A place where the code may go two ways."""

    name: str
    reached: Row  # of each row, whether the code comes here
    holds: Row  # whether the condition holds
    margin: Row  # how far from where it would not


class Values:
    """What a program makes of rows of numbers; `sites` are its decisions in their order."""

    def __init__(self, tables: Mapping[str, np.ndarray], dtype: type[np.floating], count: int) -> None:
        self.tables, self.dtype, self.count = tables, dtype, count
        self.values: dict[str, Row] = {}
        self.margins: dict[str, Row] = {}
        self.sites: list[Site] = []

    def run(self, program: Program, arguments: Mapping[str, Row]) -> None:
        """All of it; `arguments` has a row of numbers for each variable that the program is given."""
        self.values |= {name: np.asarray(x, self.dtype) for name, x in arguments.items()}
        with np.errstate(all="ignore"):
            self._block(program.operations, np.ones(self.count, bool))

    def of(self, operand: Operand) -> Row:
        """Of a variable or a constant."""
        if isinstance(operand, str):
            return self.values[operand]
        kind = bool if isinstance(operand, bool) else self.dtype
        return np.full(self.count, operand, kind)

    def _block(self, operations: Sequence[Statement], reached: Row) -> None:
        for one in operations:
            if isinstance(one, Operation):
                self._operation(one, reached)
            elif isinstance(one, Choice):
                self._choice(one, reached)
            else:
                self._least(one, reached)

    def _choice(self, one: Choice, reached: Row) -> None:
        holds = self.of(one.condition)
        self._site(one.names[0], reached, holds, self._margin(one.condition))
        self._block(one.yes.operations, reached & holds)
        self._block(one.no.operations, reached & ~holds)
        for name, yes, no in zip(one.names, one.yes.results, one.no.results, strict=True):
            self.values[name] = np.where(holds, self.of(yes), self.of(no))

    def _least(self, one: Least, reached: Row) -> None:
        count = self.of(one.beyond)
        best, lowest = np.zeros(self.count, self.dtype), np.full(self.count, np.inf, self.dtype)
        most = int(min(np.nanmax(np.where(reached & np.isfinite(count), count, 0), initial=0), 10_000))
        (score,) = one.score.results
        for number in range(most):
            inside = reached & (number < np.trunc(count))
            self.values[one.number] = np.full(self.count, number, self.dtype)
            self._block(one.score.operations, inside)
            found = self.of(score)
            better = inside & (found < lowest)
            self._site(f"{one.name} better", inside, found < lowest, lowest - found)
            best, lowest = np.where(better, self.dtype(number), best), np.where(better, found, lowest)
        self.values[one.name] = best

    def _operation(self, one: Operation, reached: Row) -> None:
        name, x = one.primitive, [self.of(operand) for operand in one.inputs]
        self._decisions(one, x, reached)
        if name == LOOKUP:
            row = self.tables[one.params["table"]][one.params["row"]]
            at = np.where(x[0] >= 1, np.minimum(x[0], len(row) - 1), 0)
            made = row[at.astype(int)].astype(self.dtype)
        elif name == "integer_pow":
            made = x[0] ** self.dtype(one.params["y"])
        elif name == "round":
            made = np.rint(x[0]) if int(one.params["rounding_method"]) else np.trunc(x[0] + np.copysign(0.5, x[0]))
        elif name == "convert_element_type":
            made = x[0].astype(self.dtype)
        elif name in MATHS:
            made = MATHS[name](*x)
        else:
            raise ValueError(f"no vectors are searched for a law that uses {name}")
        self.values[one.name] = made
        if one.flag:
            self.margins[one.name] = self._margin_of(one, x)

    def _margin_of(self, one: Operation, x: list[Row]) -> Row:
        """Above 0 where a truth value holds, by how much what it compares would have to change."""
        name = one.primitive
        if name in COMPARED:
            return COMPARED[name] * (x[0] - x[1])
        if name in ("and", "or"):
            return (np.minimum if name == "and" else np.maximum)(*(self._margin(operand) for operand in one.inputs))
        if name == "not":
            return -self._margin(one.inputs[0])
        if name in ("eq", "ne"):
            away = np.abs(x[0].astype(self.dtype) - x[1].astype(self.dtype))
            return away if name == "ne" else -away
        return np.where(self.values[one.name], self.dtype(1), self.dtype(-1))

    def _margin(self, operand: Operand) -> Row:
        if isinstance(operand, str) and operand in self.margins:
            return self.margins[operand]
        return np.where(self.of(operand), self.dtype(1), self.dtype(-1))

    def _decisions(self, one: Operation, x: list[Row], reached: Row) -> None:
        """Where C branches in this operation."""
        name, made = one.primitive, one.name
        if name == "select_n":
            self._site(made, reached, x[0], self._margin(one.inputs[0]))
        elif name == "convert_element_type":
            self._site(made, reached, x[0].astype(bool), self._margin(one.inputs[0]))
        elif name in ("and", "or"):
            first = x[0].astype(bool)
            self._site(f"{made} first", reached, first, self._margin(one.inputs[0]))
            there = reached & (first if name == "and" else ~first)
            self._site(f"{made} second", there, x[1], self._margin(one.inputs[1]))
        elif name in ("max", "min"):
            away = x[0] - x[1] if name == "max" else x[1] - x[0]
            self._site(made, reached, away >= 0, away)
            if "sure" not in one.params:
                lost = np.isnan(x[0])
                self._site(f"{made} no number", reached & ~(away >= 0), lost, np.where(lost, 1.0, -1.0))
        elif name == "clamp":
            self._site(f"{made} low", reached, x[1] < x[0], x[0] - x[1])
            self._site(f"{made} high", reached & ~(x[1] < x[0]), x[1] > x[2], x[1] - x[2])
        elif name == "sign":
            self._site(f"{made} above", reached, x[0] > 0, x[0])
            self._site(f"{made} below", reached & ~(x[0] > 0), x[0] < 0, -x[0])

    def _site(self, name: str, reached: Row, holds: Row, margin: Row) -> None:
        self.sites.append(Site(name, reached, holds.astype(bool), margin))
