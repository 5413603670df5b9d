"""The variables of an FMU: how each is called, what may be done with it, and where it lies in C."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import ArrayLike

from agvjax._pytree import ANY, Rule
from agvjax.protocols import Plant

from ..c import UNITS
from ..c_language import double
from ..program import Field

AXES = ("x", "y")  # of the pairs that measurements, references and commands have


class Role(NamedTuple):
    """What a variable is, in the words of FMI, and the word for what may be done with it in C."""

    causality: str
    variability: str
    initial: str | None
    word: str


TIME = Role("independent", "continuous", None, "KEPT")
INPUT = Role("input", "continuous", None, "INPUT")
TUNABLE = Role("parameter", "tunable", "exact", "TUNABLE")
FIXED = Role("parameter", "fixed", "exact", "FIXED")
CONSTANT = Role("local", "constant", "exact", "KEPT")
OUTPUT = Role("output", "continuous", "calculated", "KEPT")
HELD = Role("output", "discrete", "calculated", "KEPT")


class Variable(NamedTuple):
    """One number of an FMU; its value reference is its place among all."""

    name: str
    place: str  # of the model `m` in C
    role: Role
    start: float | None = None
    unit: str = ""
    about: str = ""
    rule: Rule | None = None
    kind: str = "Real"  # or Integer, Boolean

    @property
    def bounds(self) -> tuple[float | None, float | None]:
        """Least and most, where its rule has them."""
        low, high = (-np.inf, np.inf) if self.rule is None else (self.rule.low, self.rule.high)
        return (low if np.isfinite(low) else None), (high if np.isfinite(high) else None)

    def allows(self, x: str) -> str:
        """Its rule as a condition in C; empty where it has none."""
        if self.rule is None:
            return ""
        conditions = []
        for bound, sign in zip(self.bounds, "><", strict=True):
            if bound is not None:
                included = np.all(self.rule.holds(np.asarray(bound)))
                conditions.append(f"{x} {sign}{'=' * bool(included)} {double(bound)}")
        return " && ".join(conditions)


clock = Variable("time", "m->time", TIME, unit="s", about="as the importer told it last")


def of_field(
    group: str,
    field: Field,
    role: Role,
    *,
    called: str = "",
    values: ArrayLike | None = None,
    unit: str | Callable[[int], str] = "",
    about: str = "",
    rule: Rule | None = None,
    pairs: bool = True,
) -> list[Variable]:
    """The numbers of a field of a structure `group` of the model; with `pairs` two of them are called x and y."""
    starts = np.zeros(len(field.variables)) if values is None else np.ravel(np.asarray(values, float))
    found = []
    for i, ((place, _), start) in enumerate(zip(field.elements, starts.tolist(), strict=True)):
        end = f"_{AXES[i]}" if pairs and field.shape == (2,) else re.sub(r"\]\[", ",", place)
        within = unit if isinstance(unit, str) else unit(i)
        member = f"m->{group}.{field.member}{place}"
        known = start if role.initial != "calculated" else None
        found.append(Variable(f"{called or field.name}{end}", member, role, known, within, about, rule))
    return found


def seen(group: str, fields: Sequence[Field], role: Role, prefix: str) -> list[Variable]:
    """Measurement or reference."""
    found = []
    for field in fields:
        unit, _, about = UNITS[field.name].partition(", ")
        found += of_field(group, field, role, called=prefix + field.name, unit=unit, about=about)
    return found


def commands(group: str, fields: Sequence[Field], plant: Plant, role: Role, prefix: str = "command.") -> list[Variable]:
    """What actuators are asked for, or deliver."""
    found = []
    for field in fields:
        parts = plant.parts(field.name)
        each = [plant.units.get(part, plant.units.get(field.name, "")) for part in parts]
        units = [each[min(i, len(each) - 1)] for i in range(len(field.variables))]
        found += of_field(group, field, role, called=prefix + field.name, unit=units.__getitem__)
    return found


def capped(rule: Rule | None, most: float) -> Rule:
    """A rule that ends at `most` too."""
    known = ANY if rule is None else rule
    text = f"{known.text}, at most {most:g}"
    return Rule(text, lambda x: known.holds(x) & (x <= most), known.low, min(known.high, most))


def check(variables: Sequence[Variable]) -> None:
    """Raise a ValueError where two have one name, or a name is none of FMI's structured ones."""
    names = [variable.name for variable in variables]
    for name in names:
        if not re.fullmatch(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*(\[\d+(,\d+)*\])?", name, re.ASCII):
            raise ValueError(f"the name {name[:40]!r} is none of a variable of FMI")
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ValueError(f"the FMU would have the variable {twice[0]} twice")


def cases(variables: Sequence[Variable]) -> dict[str, str]:
    """The cases of model.h, by the key of its template."""
    numbered = list(enumerate(variables))

    def places(kind: str) -> str:
        return _lines(f"case {i}: return &{v.place};" for i, v in numbered if v.kind == kind)

    conditions = {i: v.allows("x") for i, v in numbered if v.role.word in ("TUNABLE", "FIXED")}
    return {
        "REALS": places("Real"),
        "INTEGERS": places("Integer"),
        "FLAGS": places("Boolean"),
        "KINDS": _lines(f"case {i}: return {v.role.word};" for i, v in numbered if v.role.word != "KEPT"),
        "RULES": _lines(f"case {i}: return {condition};" for i, condition in conditions.items() if condition),
    }


def _lines(each: Iterable[str]) -> str:
    return "\n".join(f"    {line}" for line in each)
