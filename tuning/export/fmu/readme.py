"""What lies beside the FMUs for whoever imports them."""

from __future__ import annotations

from ..artefact import Artefact, filled
from .archive import TEMPLATES
from .description import Model


def readme(model: Model, artefact: Artefact, kind: str) -> str:
    """README.md of a controller or a plant."""
    rows = []
    for variable in model.variables:
        role = variable.role
        what = role.causality if role.causality != "parameter" else f"{role.variability} parameter"
        start = "" if variable.start is None else f"{variable.start:g}"
        about = variable.about if variable.rule is None else variable.rule.text
        rows.append(f"| `{variable.name}` | {what} | {start} | {variable.unit} | {about} |")
    parts = {
        "NAME": model.name,
        "TITLE": model.about,
        "STEP": f"{model.step:g}",
        "ROWS": "\n".join(rows),
        "SOURCES": " ".join([*model.units, f"{model.name}_fmi2.c"]),
    }
    parts["STEPS"] = filled(TEMPLATES / f"{kind}.md.txt", parts)
    return filled(TEMPLATES / "README.md.txt", parts)
