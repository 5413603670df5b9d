"""Operations on scalars, and how they are taken from a jaxpr: calls inlined, nothing written twice or for nothing."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.extend import core
from jaxtyping import PyTree

from ..io.files import Json

SAME = frozenset({"copy", "copy_p", "stop_gradient", "optimization_barrier"})
INLINED = frozenset({"jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "custom_vjp_call"})
PARAMETERS = ("y", "rounding_method", "table", "row")  # of primitives, that say what is computed
LOOKUP = "agvjax_lookup"  # a number of a route
Operand = str | float | bool


class Operation(NamedTuple):
    """One scalar operation: name = primitive(inputs)."""

    name: str
    primitive: str
    inputs: tuple[Operand, ...]
    params: Json  # `sure` of max and min: the number of an input that is never NaN
    flag: bool  # whether it is a truth value; else a real number

    @property
    def names(self) -> tuple[str, ...]:
        """What it makes."""
        return (self.name,)

    @property
    def taken(self) -> set[Operand]:
        """What it reads."""
        return set(self.inputs)

    @property
    def blocks(self) -> tuple[Block, ...]:
        """What stands inside."""
        return ()


class Block(NamedTuple):
    """Operations of their own within another, and their results."""

    operations: tuple[Statement, ...]
    results: tuple[Operand, ...]

    @property
    def taken(self) -> set[Operand]:
        """What it reads, its own variables among it."""
        return set(self.results).union(*(operation.taken for operation in self.operations))


class Choice(NamedTuple):
    """One of two blocks is computed: names = results of `yes` if the condition holds, of `no` otherwise."""

    names: tuple[str, ...]
    flags: tuple[bool, ...]  # of each name, whether it is a truth value
    condition: Operand
    yes: Block
    no: Block

    @property
    def taken(self) -> set[Operand]:
        """What it reads."""
        return {self.condition} | self.yes.taken | self.no.taken

    @property
    def blocks(self) -> tuple[Block, ...]:
        """Its two."""
        return self.yes, self.no


class Least(NamedTuple):
    """name = the whole number from 0 on, below `beyond`, for which the score is least: the first of them."""

    name: str
    beyond: Operand
    number: str  # the variable of the score
    score: Block  # of one result

    @property
    def names(self) -> tuple[str, ...]:
        """What it makes."""
        return (self.name,)

    @property
    def taken(self) -> set[Operand]:
        """What it reads."""
        return {self.beyond} | self.score.taken

    @property
    def blocks(self) -> tuple[Block, ...]:
        """Its loop's."""
        return (self.score,)


Statement = Operation | Choice | Least


def flat(operations: Iterable[Statement]) -> Iterator[Operation]:
    """Every single operation, those inside of others too."""
    for operation in operations:
        if isinstance(operation, Operation):
            yield operation
        for block in operation.blocks:
            yield from flat(block.operations)


def kept(operations: Sequence[Statement], results: Iterable[Operand]) -> tuple[Statement, ...]:
    """The operations that something comes of."""
    wanted, found = set(results), []
    for operation in reversed(operations):
        if wanted.isdisjoint(operation.names):
            continue
        if isinstance(operation, Choice):
            operation = _narrowed(operation, [name in wanted for name in operation.names])
        wanted |= operation.taken
        found.append(operation)
    return tuple(found[::-1])


def _narrowed(choice: Choice, wanted: Sequence[bool]) -> Choice:
    """Without the results that nothing comes of."""

    def some(values: Iterable[PyTree]) -> tuple[PyTree, ...]:
        return tuple(itertools.compress(values, wanted))

    yes, no = (some(block.results) for block in choice.blocks)
    blocks = Block(kept(choice.yes.operations, yes), yes), Block(kept(choice.no.operations, no), no)
    return Choice(some(choice.names), some(choice.flags), choice.condition, *blocks)


def constant(value: PyTree) -> Operand:
    """A number of a jaxpr."""
    array = np.asarray(value)
    return bool(array) if array.dtype == bool else float(array)


class Writer:
    """Collects operations, each distinct one once; a block within another knows what is written before it."""

    def __init__(self, outer: Writer | None = None, data: Iterable[str] = ()) -> None:
        self.written: list[Statement] = []
        self.seen: dict[PyTree, str] = {} if outer is None else dict(outer.seen)
        self.count: Iterator[int] = itertools.count() if outer is None else outer.count
        self.data: set[str] = set(data) if outer is None else outer.data  # of a route alone: never NaN

    def run(self, closed: core.ClosedJaxpr, inputs: Sequence[Operand]) -> list[Operand]:
        """All equations of a jaxpr on scalars, calls inlined; its results."""
        return self._run(closed.jaxpr, list(map(constant, closed.consts)), inputs)

    def _run(self, jaxpr: core.Jaxpr, consts: Sequence[Operand], inputs: Sequence[Operand]) -> list[Operand]:
        values: dict[PyTree, Operand] = dict(zip(jaxpr.invars, inputs, strict=True))
        values |= zip(jaxpr.constvars, consts, strict=True)

        def read(atom: core.Var | core.Literal) -> Operand:
            return constant(atom.val) if isinstance(atom, core.Literal) else values[atom]

        for equation in jaxpr.eqns:
            values |= zip(equation.outvars, self._results(equation, [read(v) for v in equation.invars]), strict=True)
        return [read(v) for v in jaxpr.outvars]

    def _results(self, equation: core.JaxprEqn, inputs: list[Operand]) -> Sequence[Operand]:
        name, params = equation.primitive.name, equation.params
        if name in INLINED:
            return self.run(params["jaxpr"] if "jaxpr" in params else params["call_jaxpr"], inputs)
        if name in SAME:
            return inputs
        if name == "cond":
            return self._choice(equation, inputs)
        if name == "agvjax_least":
            return [self._least(equation, inputs)]
        if _is_choice(equation):
            return [inputs[name == "clamp"]]
        if (known := _known(name, inputs)) is not None:
            return [known]
        return [self._operation(equation, name, inputs)]

    def _name(self) -> str:
        return f"v{next(self.count)}"

    def _operation(self, equation: core.JaxprEqn, name: str, inputs: list[Operand]) -> Operand:
        """One operation; what is there already is not computed again."""
        aval: PyTree = equation.outvars[0].aval
        if aval.shape != () or len(equation.outvars) > 1:
            raise ValueError(f"the law uses {name} on arrays, which cannot be taken apart into numbers")
        flag = aval.dtype == bool
        if not flag and not jnp.issubdtype(aval.dtype, jnp.floating):
            raise ValueError(f"the law uses {name} with a result of type {aval.dtype}, where only real numbers can be")
        source: PyTree = equation.invars[0].aval if equation.invars else aval
        if name == "convert_element_type" and flag == (source.dtype == bool):
            return inputs[0]
        params = {key: equation.params[key] for key in PARAMETERS if key in equation.params}
        key = name, tuple(map(repr, inputs)), tuple(map(repr, params.items()))
        if key not in self.seen:
            self.seen[key] = self._name()
            sure = [not isinstance(x, str) or x in self.data for x in inputs]
            if name == LOOKUP or all(sure[name == "select_n" :]):
                self.data.add(self.seen[key])
            if name in ("max", "min") and any(sure):
                params["sure"] = sure.index(True)
            self.written.append(Operation(self.seen[key], name, tuple(inputs), params, bool(flag)))
        return self.seen[key]

    def _choice(self, equation: core.JaxprEqn, inputs: list[Operand]) -> Sequence[Operand]:
        """`lax.cond`, or `lax.switch` of two."""
        condition, *rest = inputs
        blocks = [
            self._block(branch.jaxpr, list(map(constant, branch.consts)), rest)
            for branch in equation.params["branches"]
        ]
        if len(blocks) != 2:
            raise ValueError(f"the law uses cond with {len(blocks)} branches, where only two can be")
        avals: list[PyTree] = [v.aval for v in equation.outvars]
        if odd := [x for x in avals if x.shape != () or not (x.dtype == bool or jnp.issubdtype(x.dtype, jnp.floating))]:
            raise ValueError(f"the law uses cond with a result of type {odd[0]}, where only real numbers can be")
        names = tuple(self._name() for _ in avals)
        no, yes = blocks
        self.written.append(Choice(names, tuple(aval.dtype == bool for aval in avals), condition, yes, no))
        return names

    def _least(self, equation: core.JaxprEqn, inputs: list[Operand]) -> Operand:
        beyond, *captured = inputs
        number, name = self._name(), self._name()
        block = self._block(equation.params["score"], captured, [number])
        self.written.append(Least(name, beyond, number, block))
        return name

    def _block(self, jaxpr: core.Jaxpr, consts: Sequence[Operand], inputs: Sequence[Operand]) -> Block:
        inner = Writer(self)
        results = inner._run(jaxpr, consts, inputs)
        return Block(kept(inner.written, results), tuple(results))


def _known(name: str, inputs: Sequence[Operand]) -> Operand | None:
    """What comes of it where a constant truth value decides, so that no branch is written that is never taken."""
    first, rest = inputs[0] if inputs else None, inputs[1:]
    if name == "select_n" and isinstance(first, bool) and len(rest) == 2:
        return rest[first]
    if name == "not" and isinstance(first, bool):
        return not first
    if name in ("and", "or") and (fixed := [x for x in inputs if isinstance(x, bool)]):
        decides = name == "or"  # True of `or`, False of `and`
        return decides if decides in fixed else next((x for x in inputs if not isinstance(x, bool)), not decides)
    return None


def _is_choice(equation: core.JaxprEqn) -> bool:
    """Whether it makes the number of a branch of `lax.cond` from a truth value, or keeps that between 0 and 1."""
    name = equation.primitive.name
    into: PyTree = equation.outvars[0].aval
    if not np.issubdtype(into.dtype, np.integer):
        return False
    source: PyTree = equation.invars[0].aval
    low_high = [v.val for v in equation.invars[::2] if isinstance(v, core.Literal)] if name == "clamp" else None
    return (name == "convert_element_type" and source.dtype == bool) or low_high == [0, 1]
