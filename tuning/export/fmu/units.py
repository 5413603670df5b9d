"""Units as FMI takes them: powers of the base units of SI."""

from __future__ import annotations

import re

KNOWN = {  # what units here are made of
    "m": {"m": 1},
    "s": {"s": 1},
    "kg": {"kg": 1},
    "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Nm": {"kg": 1, "m": 2, "s": -2},
}


def powers(unit: str) -> dict[str, int] | None:
    """Of the base units: `kg m^2/s` -> kg 1, m 2, s -1; None of any other, as fractional powers or words."""
    above, stroke, below = unit.partition("/")
    below = below.removeprefix("(").removesuffix(")")
    found: dict[str, int] = {}
    for text, sign in ((above, 1), *([(below, -1)] if stroke else [])):
        for word in text.split(" "):
            factor = re.fullmatch(r"([A-Za-z]+)(?:\^([1-9]))?", word)
            if word == "1" and sign > 0:
                continue
            if factor is None or factor[1] not in KNOWN:
                return None
            for base, power in KNOWN[factor[1]].items():
                found[base] = found.get(base, 0) + sign * power * int(factor[2] or 1)
    return {base: power for base, power in found.items() if power}
