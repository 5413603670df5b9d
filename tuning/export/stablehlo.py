"""The step as StableHLO, for whatever runs that: a reproducible artefact, on a processor or a GPU."""

from __future__ import annotations

import json

import jax
import numpy as np
from jaxtyping import PyTree

from agvjax import Measurement, Reference

from ..io.files import Json
from . import program
from .artefact import Artefact

NAME = "agv_controller"
PLATFORMS = ("cpu", "cuda")


def files(artefact: Artefact, name: str = NAME) -> dict[str, str | bytes]:
    """Serialised module, its text, and what its flat arguments and results are; in double precision."""
    law = artefact.controller

    def step(gains: PyTree, state: PyTree, measurement: Measurement, reference: Reference) -> PyTree:
        done = gains.step(state, measurement, reference)
        flat = jax.tree.leaves((done.law, done.command.inputs, done.limited))
        return tuple(flat)

    def flat(*leaves: PyTree) -> PyTree:
        return step(*jax.tree.unflatten(treedef, leaves))

    leaves, treedef = jax.tree.flatten((law, *program.examples(law)))
    shapes = [jax.ShapeDtypeStruct(np.shape(x), np.float64) for x in leaves]
    depth = jax.config.values["jax_traceback_in_locations_limit"]
    jax.config.update("jax_traceback_in_locations_limit", 0)  # no folders of this machine in it
    try:
        exported = jax.export.export(jax.jit(flat), platforms=PLATFORMS)(*shapes)
    finally:
        jax.config.update("jax_traceback_in_locations_limit", depth)
    return {
        f"{name}.bin": bytes(exported.serialize()),
        f"{name}.mlir": exported.mlir_module(),
        "signature.json": json.dumps(signature(artefact), indent=2) + "\n",
    }


def signature(artefact: Artefact) -> Json:
    """Names, shapes and units of the module's arguments and results, in their order."""
    made, facts = program.step(artefact.controller), artefact.provenance["gains"]

    def told(group: str, fields: PyTree) -> list[Json]:
        return [
            {
                "group": group,
                "name": f.name,
                "shape": list(f.shape),
                "unit": facts.get(f.name, {}).get("unit", "") if group == "gains" else "",
            }
            for f in fields
        ]

    arguments = [entry for group, fields in made.arguments.items() for entry in told(group, fields)]
    results = [entry for group, fields in made.results.items() for entry in told(group, fields)]
    values = {name: fact["value"] for name, fact in facts.items()}
    return {
        "dtype": "float64",
        "arguments": arguments,
        "results": results,
        "gains": values,
        "provenance": artefact.provenance,
    }
