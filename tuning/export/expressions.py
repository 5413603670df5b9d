"""Operations of a program as text: what C and Python write alike, and what each calls by a name of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from ..io.files import Json
from .operations import LOOKUP, Block, Choice, Least, Operand, Operation, Statement

INFIX = {"add": "+", "add_any": "+", "sub": "-", "mul": "*", "div": "/"}
INFIX |= {"gt": ">", "lt": "<", "ge": ">=", "le": "<=", "eq": "==", "ne": "!="}
FUNCTIONS = {  # primitive -> name in C's math.h
    "exp": "exp", "agvjax_exp": "exp", "exp2": "exp2", "expm1": "expm1", "log": "log", "log1p": "log1p", "sin": "sin",
    "cos": "cos", "tan": "tan", "sinh": "sinh", "cosh": "cosh", "tanh": "tanh", "sqrt": "sqrt", "abs": "fabs",
    "floor": "floor", "ceil": "ceil", "atan2": "atan2", "pow": "pow", "rem": "fmod", "atan": "atan", "asin": "asin",
    "acos": "acos",
}  # fmt: skip


class Language(NamedTuple):
    """How one language says what differs."""

    number: Callable[[float], str]
    truth: Callable[[bool], str]
    choose: Callable[[str, str, str], str]  # condition, if so, if not
    call: Callable[[str], str]  # name in math.h -> name of the function
    both: str
    either: str
    negate: Callable[[str], str]
    define: Callable[[str, str, bool], str]  # name, its value, whether that is a truth value
    assign: Callable[[str, str], str]
    lookup: Callable[[str, int, str], str]  # table of a route, row, number of the column
    either_block: Callable[[Choice, str, list[str], list[str]], list[str]]  # condition, lines if so, if not
    loop: Callable[[Least, str, list[str], str], list[str]]  # count, lines of a round, its score


def lines(operations: Sequence[Statement], language: Language) -> list[str]:
    """Operations, one after the other.

    Raises:
        ValueError: as `expression`.
    """
    return [line for operation in operations for line in _statement(operation, language)]


def _statement(operation: Statement, language: Language) -> list[str]:
    if isinstance(operation, Choice):
        blocks = [_assigned(block, operation.names, language) for block in operation.blocks]
        return language.either_block(operation, text(operation.condition, language), *blocks)
    if isinstance(operation, Least):
        inner, (score,) = lines(operation.score.operations, language), operation.score.results
        return language.loop(operation, text(operation.beyond, language), inner, text(score, language))
    return [language.define(operation.name, expression(operation, language), operation.flag)]


def _assigned(block: Block, names: Sequence[str], language: Language) -> list[str]:
    results = [text(value, language) for value in block.results]
    return lines(block.operations, language) + [language.assign(*pair) for pair in zip(names, results, strict=True)]


def text(operand: Operand, language: Language) -> str:
    """A variable or a constant."""
    if isinstance(operand, str):
        return operand
    return language.truth(operand) if isinstance(operand, bool) else language.number(operand)


def expression(operation: Operation, language: Language) -> str:
    """The right-hand side.

    Raises:
        ValueError: a primitive that no law has used so far; the message names it.
    """
    name, x = operation.primitive, [text(operand, language) for operand in operation.inputs]
    if name == LOOKUP:
        return language.lookup(operation.params["table"], operation.params["row"], x[0])
    if name in INFIX:
        return f"{x[0]} {INFIX[name]} {x[1]}"
    if name in FUNCTIONS:
        return f"{language.call(FUNCTIONS[name])}({', '.join(x)})"
    if name == "integer_pow":
        return _power(x[0], operation.params["y"], language)
    if name == "select_n" and len(x) == 3:
        return language.choose(x[0], x[2], x[1])
    if name in ("and", "or") and operation.flag:
        return f"{x[0]} {language.both if name == 'and' else language.either} {x[1]}"
    if name in ("max", "min"):
        return _extreme(operation, x, language)
    if name in SPECIAL:
        return SPECIAL[name](x, operation.params, language)
    raise ValueError(f"the law uses {name}, for which no code can be written yet")


def _extreme(operation: Operation, x: list[str], language: Language) -> str:
    """Of two the larger, or the smaller; NaN goes on. Of a number that never is none nothing is asked."""
    beyond, at_least = (">", ">=") if operation.primitive == "max" else ("<", "<=")
    if operation.params.get("sure") == 1:
        return language.choose(f"{x[1]} {beyond} {x[0]}", x[1], x[0])
    if operation.params.get("sure") == 0:
        return language.choose(f"{x[0]} {at_least} {x[1]}", x[0], x[1])
    return language.choose(f"({x[0]} {at_least} {x[1]}) {language.either} ({x[0]} != {x[0]})", x[0], x[1])


def _power(x: str, y: int, language: Language) -> str:
    product = " * ".join([x] * abs(y)) or language.number(1.0)
    if y >= 0:
        return product
    return f"{language.number(1.0)} / {product if y == -1 else f'({product})'}"


def _round(x: list[str], params: Json, language: Language) -> str:
    return f"{language.call('rint' if int(params['rounding_method']) else 'round')}({x[0]})"


def _sign(x: list[str], params: Json, language: Language) -> str:
    one, zero = language.number(1.0), language.number(0.0)
    below = language.choose(f"{x[0]} < {zero}", language.number(-1.0), x[0])
    return language.choose(f"{x[0]} > {zero}", one, f"({below})")


SPECIAL: dict[str, Callable[[list[str], Json, Language], str]] = {
    "neg": lambda x, p, o: f"-{x[0]}",
    "square": lambda x, p, o: f"{x[0]} * {x[0]}",
    "rsqrt": lambda x, p, o: f"{o.number(1.0)} / {o.call('sqrt')}({x[0]})",
    "logistic": lambda x, p, o: f"{o.number(1.0)} / ({o.number(1.0)} + {o.call('exp')}(-{x[0]}))",
    "not": lambda x, p, o: o.negate(x[0]),
    "xor": lambda x, p, o: f"{x[0]} != {x[1]}",
    "is_finite": lambda x, p, o: f"({x[0]} - {x[0]}) == {o.number(0.0)}",
    "clamp": lambda x, p, o: o.choose(f"{x[1]} < {x[0]}", x[0], f"({o.choose(f'{x[1]} > {x[2]}', x[2], x[1])})"),
    "convert_element_type": lambda x, p, o: o.choose(x[0], o.number(1.0), o.number(0.0)),
    "agvjax_uniform": lambda x, p, o: f"{o.call('uniform')}({x[0]}, {x[1]})",  # a function of the exported code
    "round": _round,
    "sign": _sign,
}
