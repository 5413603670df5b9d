"""What a parameter file must satisfy: types as Nav2 takes them, numbers as the law does."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from agvjax import Fault

from ..yaml_text import Document, Leaf, plain
from .names import DOUBLES, FREQUENCY, NEWER, PARAMETERS, Parameter
from .section import Section, placed


def wrong(
    document: Document, section: Section, found: Mapping[str, Leaf], frequency: Leaf | None, file: str
) -> list[Fault]:
    """Everything that is wrong with a section and its server's frequency, each once."""
    faults = malformed(document, section, found, file)
    known = PARAMETERS | {name: PARAMETERS[law] for name, law in NEWER.items()}
    known |= {name: Parameter(0.0) for name in DOUBLES}
    for name in found:
        faults += _of_value(f"{section.name}.{name}", found[name], known[name], file) if name in known else []
    if frequency is not None:
        node = "/".join(placed(frequency)[0])
        faults += _of_value(f"{node}.controller_frequency", frequency, FREQUENCY, file)
    return list(dict.fromkeys(faults)) or crossed(section, found, file)


def malformed(document: Document, section: Section, found: Mapping[str, Leaf], file: str) -> list[Fault]:
    """Parameters that are named twice, or are lists or tables, whatever they hold."""
    names = {*PARAMETERS, *NEWER}
    tables = {
        name.partition(".")[0]: leaf.line for name, leaf in found.items() if name.partition(".")[0] in names - {name}
    }
    rule = "a single value"
    faults = [Fault(f"{section.name}.{x}", "a list or table", rule, f"{file}, line {tables[x]}") for x in tables]
    return _twice(document, section, file) + faults


def _twice(document: Document, section: Section, file: str) -> list[Fault]:
    """Parameters of the section that are named more than once, by one table or as dotted names too."""
    seen, faults, start = {}, [], section.controller + "."
    for leaf in document.leaves:
        node, name = placed(leaf)
        if node == section.node and name.startswith(start):
            if first := seen.get(name):
                rule = f"named once; line {first.line} says {first.node.value}"
                faults.append(
                    Fault(
                        f"{section.name}.{name.removeprefix(start)}", leaf.node.value, rule, f"{file}, line {leaf.line}"
                    )
                )
            seen[name] = leaf
    return faults


def _of_value(key: str, leaf: Leaf, parameter: Parameter, file: str) -> list[Fault]:
    """What is wrong with a value as Nav2 and the law take it."""
    value, source = plain(leaf.node), f"{file}, line {leaf.line}"
    if isinstance(parameter.default, bool):
        return [] if isinstance(value, bool) else [Fault(key, leaf.node.value, "true or false, not in quotes", source)]
    if isinstance(value, int) and not isinstance(value, bool):
        return [Fault(key, value, f"a double, {value}.0: Nav2 refuses a whole number when it starts", source)]
    if not isinstance(value, float):
        return [Fault(key, leaf.node.value, "a number with a point, not in quotes", source)]
    if not np.isfinite(value):
        return [Fault(key, value, "finite", source)]
    wrong = parameter.rule is not None and not parameter.rule.holds(np.asarray(value))
    return (
        [Fault(key, leaf.node.value, f"{parameter.rule.text} {parameter.unit}", source)]
        if wrong and parameter.rule
        else []
    )


def crossed(section: Section, found: Mapping[str, Leaf], file: str) -> list[Fault]:
    """Limits of the look-ahead that lie the wrong way round, where it is scaled by speed."""
    low, high, scaled = (
        plain(found[name].node) if name in found else PARAMETERS[name].default
        for name in ("min_lookahead_dist", "max_lookahead_dist", "use_velocity_scaled_lookahead_dist")
    )
    if not scaled or float(str(low)) <= float(str(high)):
        return []
    rule = f"at most max_lookahead_dist, {high}, for a look-ahead that is scaled by speed"
    return [Fault(f"{section.name}.min_lookahead_dist", low, rule, file)]


def untold(tuned: Mapping[str, float | bool]) -> list[Fault]:
    """Tuned values that cannot be written."""
    faults = []
    for name, value in tuned.items():
        parameter = PARAMETERS.get(name)
        if parameter is None:
            faults.append(Fault(name, value, f"one of {', '.join(PARAMETERS)}"))
        elif isinstance(parameter.default, bool) != isinstance(value, (bool, np.bool_)):
            faults.append(Fault(name, value, "true or false" if isinstance(parameter.default, bool) else "a number"))
        elif parameter.rule is not None and not (np.isfinite(value) and parameter.rule.holds(np.asarray(value))):
            faults.append(Fault(name, value, f"{parameter.rule.text} {parameter.unit} and finite"))
    return faults
