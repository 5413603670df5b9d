"""Axes of a sweep as options say them."""

from __future__ import annotations

import argparse
import re

from agvjax import Fault, InputError

from ..config.codecs import Toml
from ..io.numbers import integer, real


def axis(text: str) -> dict[str, Toml]:
    """`a+b=0:1.5:101` -> an axis on which both move as one; `*=` is times nominal, without a count it is sampled."""
    rule = "LEAF=LOW:HIGH[:POINTS], LEAF*=LOW:HIGH[:POINTS] or LEAF=A,B,C; LEAF+LEAF moves both"
    try:
        if match := re.fullmatch(r"([^=*]+)=([^:]+)", text):
            span: dict[str, Toml] = {"one_of": [real(x) for x in match[2].split(",")]}
        elif match := re.fullmatch(r"([^=*]+)(\*?)=([^:,]+):([^:,]+)(?::([^:,]+))?", text):
            span = {"times" if match[2] else "between": [real(match[3]), real(match[4])]}
            span |= {"points": integer(match[5])} if match[5] else {}
        else:
            raise ValueError
    except ValueError as error:
        raise InputError([Fault("--over", text, rule)]) from error
    return {name.strip(): span for name in match[1].split("+")}


def swept(arguments: argparse.Namespace) -> dict[str, Toml]:
    """Settings of the options that only `agvjax sweep` has, by dotted key."""
    options = {"ensemble": arguments.ensemble or None, "controllers": arguments.controller or None}
    options |= {"samples": arguments.samples, "design": arguments.design}
    if arguments.over or arguments.ensemble:
        options["over"] = [axis(text) for text in arguments.over]
    return {f"sweep.{name}": value for name, value in options.items() if value is not None}
