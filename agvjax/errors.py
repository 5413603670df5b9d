"""What is wrong with a value, and the error that lists it."""

from __future__ import annotations

import re
import reprlib
import warnings
from typing import NamedTuple

LONGEST, DIGITS = 200, 1000  # letters of a value that are shown, bits of an integer


def shown(value: object) -> str:
    """A value for a person, in one short line whatever it is."""
    if isinstance(value, int) and value.bit_length() > DIGITS:
        return f"a whole number of {value.bit_length()} bits"
    try:
        text = str(value)
    except (RecursionError, ValueError):  # tables in tables without end, integers that Python does not print
        text = reprlib.repr(value)
    return text if len(text) <= LONGEST else f"{text[:LONGEST]} ... ({len(text)} characters)"


def told_apart(bound: float, value: float) -> str:
    """A bound that a value breaks, in as few digits, at least three, as a reader needs to see that."""
    for digits in range(3, 17):
        text = f"{bound:.{digits}g}"
        if (float(text) > value) == (bound > value) and float(text) != value:
            return text
    return repr(float(bound))


class Fault(NamedTuple):
    """One fault: the key, its value, the rule that it breaks and the source of the rule."""

    key: str
    value: object
    rule: str
    source: str = ""

    def __str__(self) -> str:
        """One line for a person; of a value no more than what it takes to know it again."""
        rule = re.sub(rf"\S{{{LONGEST},}}", lambda match: shown(match[0]), self.rule)  # that quotes the value
        return f"{shown(self.key)} = {shown(self.value)}: must be {rule}" + (f" [{self.source}]" if self.source else "")


class InputError(ValueError):
    """Bad input; the message names every fault, `faults` lists them."""

    def __init__(self, faults: list[Fault]):
        self.faults = faults
        count = f"{len(faults)} bad value" + ("s" if len(faults) > 1 else "")
        super().__init__("\n  ".join([f"{count}:", *map(str, faults)]))

    @property
    def problems(self) -> list[Fault]:
        """The earlier name of `faults`."""
        warnings.warn("InputError.problems is now InputError.faults", DeprecationWarning, stacklevel=2)
        return self.faults
