"""modelDescription.xml of FMI 2.0 and 3.0, and buildDescription.xml of FMI 3.0."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from .units import powers
from .variables import HELD, OUTPUT, Variable

KINDS = {"Real": "Float64", "Integer": "Int32", "Boolean": "Boolean"}  # of FMI 2.0 -> of FMI 3.0
ONCE = {"canBeInstantiatedOnlyOncePerProcess": "false", "canHandleVariableCommunicationStepSize": "false"}
CATEGORIES = {"warnings": "what a step says of itself", "errors": "why something was refused"}


class Model(NamedTuple):
    """An FMU of either version, without what only one has."""

    name: str
    about: str
    generator: str
    step: float  # s
    variables: Sequence[Variable]
    sources: dict[str, str]  # texts of files by their names
    units: Sequence[str]  # files of it that are compiled


def fmi2(model: Model, token: str, compiled: Sequence[str]) -> str:
    """Of FMI 2.0; `compiled` names the sources of a binary."""
    root = _root(model, "2.0", guid=token, numberOfEventIndicators="0")
    able = {
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "canNotUseMemoryManagementFunctions": "true",
    }
    slave = SubElement(root, "CoSimulation", {"modelIdentifier": model.name} | ONCE | able)
    files = SubElement(slave, "SourceFiles")
    for file in compiled:
        SubElement(files, "File", name=file)
    _before(root, model)
    variables = SubElement(root, "ModelVariables")
    for reference, variable in enumerate(model.variables):
        scalar = SubElement(variables, "ScalarVariable", _said(variable, reference))
        SubElement(scalar, variable.kind, _number(variable))
    structure, outputs = SubElement(root, "ModelStructure"), _outputs(model)
    for kind in ("Outputs", "InitialUnknowns"):
        group = SubElement(structure, kind)
        for reference in outputs:
            known = {"dependencies": ""} if kind == "Outputs" else {}
            SubElement(group, "Unknown", {"index": str(reference + 1)} | known)
    return _text(root)


def fmi3(model: Model, token: str) -> str:
    """Of FMI 3.0."""
    root = _root(model, "3.0", instantiationToken=token)
    able = {"canGetAndSetFMUState": "true", "canSerializeFMUState": "true", "fixedInternalStepSize": repr(model.step)}
    SubElement(root, "CoSimulation", {"modelIdentifier": model.name} | ONCE | able)
    _before(root, model)
    variables = SubElement(root, "ModelVariables")
    for reference, variable in enumerate(model.variables):
        SubElement(variables, KINDS[variable.kind], _said(variable, reference) | _number(variable))
    structure, outputs = SubElement(root, "ModelStructure"), _outputs(model)
    for reference in outputs:
        SubElement(structure, "Output", valueReference=str(reference), dependencies="")
    for reference in outputs:
        SubElement(structure, "InitialUnknown", valueReference=str(reference))
    return _text(root)


def build(model: Model, compiled: Sequence[str]) -> str:
    """How FMI 3.0 says what is compiled."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = SubElement(root, "BuildConfiguration", modelIdentifier=model.name)
    files = SubElement(configuration, "SourceFileSet", language="C99")
    for file in compiled:
        SubElement(files, "SourceFile", name=file)
    return _text(root)


def _root(model: Model, version: str, **attributes: str) -> Element:
    said = {"modelName": model.name, "description": model.about, "generationTool": model.generator}
    said["variableNamingConvention"] = "structured"
    return Element("fmiModelDescription", {"fmiVersion": version} | said | attributes)


def _before(root: Element, model: Model) -> None:
    """What stands between the kind of FMU and its variables."""
    used = {variable.unit: powers(variable.unit) for variable in model.variables}
    units = {unit: exponents for unit, exponents in sorted(used.items()) if exponents}
    if units:
        group = SubElement(root, "UnitDefinitions")
        for unit, exponents in units.items():
            SubElement(SubElement(group, "Unit", name=unit), "BaseUnit", {b: str(p) for b, p in exponents.items()})
    group = SubElement(root, "LogCategories")
    for name, about in CATEGORIES.items():
        SubElement(group, "Category", name=name, description=about)
    SubElement(root, "DefaultExperiment", startTime="0.0", stepSize=repr(model.step))


def _said(variable: Variable, reference: int) -> dict[str, str]:
    """What is said of a variable of any type."""
    role, rule = variable.role, variable.rule
    exotic = variable.unit if not powers(variable.unit) and variable.unit not in ("", "1") else ""
    about = "; ".join(filter(None, (variable.about, exotic, rule.text if rule is not None else "")))
    found = {"name": variable.name, "valueReference": str(reference), "causality": role.causality}
    found |= {"variability": role.variability} | ({"description": about} if about else {})
    return found | ({"initial": role.initial} if role.initial else {})


def _number(variable: Variable) -> dict[str, str]:
    """What is said of a variable of its type."""
    low, high = variable.bounds
    found = {"unit": variable.unit} if powers(variable.unit) else {}
    for key, bound in (("min", low), ("max", high), ("start", variable.start)):
        found |= {} if bound is None or variable.kind != "Real" else {key: repr(float(bound))}
    return found


def _outputs(model: Model) -> list[int]:
    return [i for i, variable in enumerate(model.variables) if variable.role in (OUTPUT, HELD)]


def _text(root: Element) -> str:
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"
