"""The section of a controller in a parameter file, whatever node it belongs to and however its keys are nested."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from agvjax import Fault, InputError

from ..yaml_text import Document, Leaf, plain
from .names import IGNORED, NEWER, OF_SHIM, PARAMETERS, PLUGIN, SHIM

NODE = "ros__parameters"  # the key below which the parameters of a node stand
SOURCE = "nav2_regulated_pure_pursuit_controller"
KEY = "NAV2_PARAMS.yaml"


class Section(NamedTuple):
    """Where a controller's parameters stand: its node, its name there, and the value that says which plugin it is."""

    node: tuple[str, ...]
    controller: str
    plugin: Leaf

    @property
    def name(self) -> str:
        """Node and controller, as one asks for them."""
        return f"{'/'.join(self.node)}.{self.controller}"


def section_of(document: Document, controller: str | None, file: str) -> Section:
    """The section asked for, or the only one."""
    sections = {section.name: section for section in _sections(document)}
    rule = f'a file with a controller below {NODE} whose plugin is "{SOURCE}::RegulatedPurePursuitController"'
    if not sections:
        raise InputError([Fault(KEY, file, rule)])
    if controller is None and len(sections) > 1:
        raise InputError([Fault("controller", "not given", f"one of {', '.join(sections)}: {file} has several")])
    asked = [x for x in sections.values() if controller in (None, x.name, x.controller)]
    exact = [x for x in asked if x.name == controller] or asked
    if len(exact) != 1:
        several = "in full, " if exact else ""
        raise InputError([Fault("controller", controller, f"{several}one of {', '.join(sections)} of {file}")])
    return exact[0]


def _sections(document: Document) -> Iterable[Section]:
    for leaf in document.leaves:
        node, name = placed(leaf)
        controller, _, last = name.rpartition(".")
        says = last in ("plugin", "primary_controller") and re.fullmatch(PLUGIN, str(leaf.node.value))
        if says and controller:
            yield Section(node, controller, leaf)


def placed(leaf: Leaf) -> tuple[tuple[str, ...], str]:
    """Node of a value, and its dotted name there, which is empty where it is no parameter of a node."""
    if NODE not in leaf.path:
        return (), ""
    at = leaf.path.index(NODE)
    return leaf.path[:at], ".".join(leaf.path[at + 1 :])


def found_in(document: Document, section: Section) -> dict[str, Leaf]:
    """The parameters of a section by their names in it."""
    start, values = section.controller + ".", {}
    for leaf in document.leaves:
        node, name = placed(leaf)
        if node == section.node and name.startswith(start):
            values[name.removeprefix(start)] = leaf
    return values


def spelled(found: Mapping[str, Leaf]) -> dict[str, str]:
    """Names of the file that are parameters of the law: the law's name of each. Nav2 prefers the older one."""
    newer = {name: law for name, law in NEWER.items() if name in found and law not in found}
    return {name: name for name in found if name in PARAMETERS} | newer


def frequency_of(document: Document, section: Section) -> Leaf | None:
    """The controller_frequency of the server, or of all nodes (`/**`)."""
    found = {placed(leaf)[0]: leaf for leaf in document.leaves if placed(leaf)[1] == "controller_frequency"}
    return found.get(section.node, found.get(("/**",)))


def ignored(found: Mapping[str, Leaf], section: Section) -> dict[str, str]:
    """Parameters that mean nothing to one robot on one path, and why."""
    reasons = IGNORED | (OF_SHIM if _shim(section) else {})
    beside = "desired_linear_vel stands beside it, which Nav2 takes."
    double = {name: beside for name, law in NEWER.items() if name in found and law in found}
    return {name: reasons[name] for name in found if name in reasons} | double


def _shim(section: Section) -> bool:
    return section.plugin.path[-1].endswith("primary_controller")


def remarks(document: Document, section: Section, found: Mapping[str, Leaf]) -> tuple[str, ...]:
    """What a person should know of the section before it is tuned."""
    loaded = [str(leaf.node.value) for leaf in document.leaves if _loads(leaf, section)]
    window, outer = found.get("use_dynamic_window"), found.get("plugin")
    name = section.controller.removesuffix(".primary_controller")
    said = []
    if loaded and name not in loaded:
        said.append(f"controller_plugins names {', '.join(loaded)}: the server will not load {name}.")
    if window is not None and plain(window.node) is True:
        said.append("use_dynamic_window is true: from Lyrical on that is another law than the one tuned here.")
    if _shim(section) and outer is not None and re.fullmatch(SHIM, str(outer.node.value)):
        said.append("The rotation shim around it reads rotate_to_heading_angular_vel and max_angular_accel too.")
    if "max_linear_vel" in found and "desired_linear_vel" not in found:
        said.append(
            "max_linear_vel is the name of desired_linear_vel from Lyrical on; earlier releases do not read it."
        )
    return tuple(said)


def _loads(leaf: Leaf, section: Section) -> bool:
    """Whether a value is one of the server's list of controllers."""
    node, name = placed(leaf)
    return node == section.node and re.fullmatch(r"controller_plugins(\.\d+)?", name) is not None
