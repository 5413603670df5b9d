"""Parameters of an exported node or plugin as generate_parameter_library states them: type, default, text, bounds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import yaml
from jaxtyping import PyTree

import agvjax
from agvjax import leaves
from agvjax.schedule import extremes

from ..io.files import Json
from ..tune.meanings import of_gains
from . import names
from .artefact import Artefact, plain
from .ros2_node.vehicles import VEHICLES, Accelerations

PARTS = {"track": "track", "wheel_radius": "radius of the wheels", "L": "wheelbase", "wheelbase": "wheelbase"}
LEAST = 1e-12  # makes "> 0" of an array's elements: generate_parameter_library has only inclusive bounds for them


class Dumper(yaml.SafeDumper):
    """Lists in one line, nothing abbreviated: parsers of ROS know no aliases."""

    def ignore_aliases(self, data: PyTree) -> bool:
        """Every one."""
        return True


Dumper.add_representer(list, lambda dumper, x: dumper.represent_sequence("tag:yaml.org,2002:seq", x, flow_style=True))


def of_law(artefact: Artefact) -> dict[str, Json]:
    """Those of the law, by names that begin with `controller.`."""
    highest = {name: float(x) for name, x in extremes(artefact.controller)[1].upper_bounds(_stable).items()}
    return {f"controller.{name}": _gain(artefact, name, highest.get(name)) for name in artefact.provenance["gains"]}


def _stable(poles: np.ndarray) -> bool:
    """No integrator steps the exported law: a sampled law's bounds are those of its period."""
    return True


def _gain(artefact: Artefact, name: str, highest: float | None) -> Json:
    """A leaf of the controller; period and vehicle must not change while it runs."""
    facts = artefact.provenance["gains"][name]
    value = facts["value"]
    if np.ndim(value) > 1:
        raise ValueError(f"{name} has shape {np.shape(value)}, and a parameter of ROS 2 is a number or a list of them")
    words = [of_gains(artefact.controller, [name])[name], f"unit {facts['unit'] or '1'}", facts["rule"]]
    title = f"{name} of {type(artefact.controller.inner).__name__}" if name.startswith("inner.") else name
    rule = {"bounds<>": [value, value]} if name == "period" else _validation(facts, value, highest)
    fixed = name == "period" or name.startswith("vehicle.")
    return table(value, f"{title}: {', '.join(filter(None, words))}", rule, fixed)


def table(default: PyTree, description: str, validation: dict[str, list[PyTree]], read_only: bool) -> Json:
    """A parameter as generate_parameter_library states it; that writes texts into C++, quotes and all, as they are."""
    kind = {float: "double", list: "double_array", str: "string", bool: "bool"}[type(default)]
    table: Json = {"type": kind, "default_value": default, "description": plain(description)}
    return table | ({"read_only": True} if read_only else {}) | ({"validation": validation} if validation else {})


def _validation(facts: Json, value: PyTree, highest: float | None) -> dict[str, list[PyTree]]:
    """The rule beside a leaf, and what a period can hold, unless the tuned value is beyond that already."""
    low, high = facts["low"], facts["high"]
    open_low, open_high = ">=" not in facts["rule"], "<=" not in facts["rule"]
    if isinstance(value, list):
        ends = {} if low is None else {"lower": low + LEAST * open_low}
        ends |= {} if high is None else {"upper": high - LEAST * open_high}
        rules = {f"{side}_element_bounds<>": [end] for side, end in ends.items()}
        return {"fixed_size<>": [len(value)]} | (rules if len(ends) < 2 else {"element_bounds<>": [*ends.values()]})
    if highest is not None and value <= highest and (high is None or highest < high):
        high, open_high = highest, False
    if low is not None and high is not None and not (open_low or open_high):
        return {"bounds<>": [low, high]}
    ends = {"gt<>" if open_low else "gt_eq<>": low, "lt<>" if open_high else "lt_eq<>": high}
    return {rule: [end] for rule, end in ends.items() if end is not None}


def numbers(rows: Json) -> dict[str, Json]:
    """Of numbers that can be set while it runs: by name default, unit, rule and text."""
    return {
        name: table(float(f"{default:.6g}"), f"{text} [{unit}]", {f"{rule}<>": [0.0]}, read_only=False)
        for name, (default, unit, rule, text) in rows.items()
    }


def of_base(artefact: Artefact) -> dict[str, Json]:
    """Parameters that are numbers of the robot's own base; by default the vehicle's."""
    numbers = leaves(artefact.controller.vehicle).items()
    vehicle = vehicle_kind(artefact)({part: float(x) for part, x in numbers if np.ndim(x) == 0})
    text = "The {} by which the robot's base turns cmd_vel into what it does [m]"
    rows = {key: (float(vehicle.of[part]), text.format(PARTS[part])) for key, part in vehicle.base.items()}
    return {key: table(default, words, {"gt<>": [0.0]}, read_only=False) for key, (default, words) in rows.items()}


def inputs(artefact: Artefact, name: str, known: Sequence[type[Accelerations]]) -> tuple[str, ...]:
    """The inputs of the vehicle.

    Raises:
        agvjax.InputError: the name is none of a package, or no velocity can be made of them by any of what is `known`.
    """
    faults, inputs = names.faults(name), tuple(artefact.provenance["inputs"])
    kind = type(artefact.controller.vehicle).__name__
    if inputs not in [kind.inputs for kind in known]:
        rule = f"with inputs a velocity can be made of: {'; '.join(', '.join(kind.inputs) for kind in known)}"
        faults.append(agvjax.Fault("controller.vehicle", f"{kind} ({', '.join(inputs)})", rule))
    else:
        lacks = [part for part in VEHICLES[inputs].parts if f"vehicle.{part}" not in artefact.provenance["gains"]]
        rule = f"with the numbers {', '.join(VEHICLES[inputs].parts)}; it has no {', '.join(lacks)}"
        faults += [agvjax.Fault("controller.vehicle", kind, rule)] if lacks else []
    if faults:
        raise agvjax.InputError(faults)
    return inputs


def vehicle_kind(artefact: Artefact) -> type[Accelerations]:
    """What makes a velocity of the inputs of the vehicle."""
    kinds: dict[tuple[str, ...], type[Accelerations]] = {**VEHICLES}
    return kinds[tuple(artefact.provenance["inputs"])]


def nested(flat: Json) -> Json:
    """Dotted names as tables in tables."""
    tree: Json = {}
    for name, value in flat.items():
        *parents, last = name.split(".")
        part = tree
        for parent in parents:
            part = part.setdefault(parent, {})
        part[last] = value
    return tree


def dumped(tree: Json) -> str:
    """As YAML."""
    return yaml.dump(tree, Dumper=Dumper, sort_keys=False, default_flow_style=False, width=120, allow_unicode=True)
