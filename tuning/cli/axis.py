"""How `--over` spells an axis of a sweep."""

from __future__ import annotations

import re

from agvjax import Fault, InputError

from ..config.codecs import Toml


def axis(text: str) -> dict[str, Toml]:
    """`a+b=0:1.5:101` -> an axis on which both move as one; `*=` is times nominal, without a count it is sampled."""
    rule = "LEAF=LOW:HIGH[:POINTS], LEAF*=LOW:HIGH[:POINTS] or LEAF=A,B,C; LEAF+LEAF moves both"
    try:
        match = re.fullmatch(r"([^=*]+)(\*?)=(.+)", text)
        if match is None:
            raise ValueError
        names, times, values = match[1].split("+"), match[2], match[3]
        if "," in values or ":" not in values:
            if times:
                raise ValueError
            span: dict[str, Toml] = {"one_of": [float(x) for x in values.split(",")]}
        else:
            low, high, *points = values.split(":")
            span = {"times" if times else "between": [float(low), float(high)]}
            span |= {"points": int(*points)} if points else {}
    except (ValueError, TypeError) as error:
        raise InputError([Fault("--over", text, rule)]) from error
    return {name.strip(): span for name in names}
