"""The step as StableHLO, for whatever runs that: a reproducible artefact, on a processor or a GPU."""

from __future__ import annotations

import calendar
import datetime
from importlib import metadata

import jax
import numpy as np
from jaxtyping import PyTree

from ..io.files import Json, as_json
from . import guard, program, tables
from .artefact import Artefact
from .program import Field

NAME = "agv_controller"
RESULTS = ("state", "inputs", "limited", "status")  # groups, in this order
PLATFORMS = ("cpu", "cuda")
MONTHS = 6  # for which JAX promises to read what it has written
PROMISE = (
    "a jaxlib built up to six months after the one that wrote a module reads it"
    " (https://docs.jax.dev/en/latest/export/export.html#compatibility-guarantees). The date counts from the day of"
    " writing, as if jaxlib had been built that day: the promise ends sooner by as much as it was older."
    " The versions that wrote it go on reading it"
)


def files(artefact: Artefact, name: str = NAME) -> dict[str, str | bytes]:
    """Serialised module, its text, and what its flat arguments and results are; in double precision.

    Its provenance says how long the module can be read.
    """
    artefact = artefact._replace(provenance=artefact.provenance | {"expires": expiry(datetime.date.today())})
    law, route = artefact.controller, artefact.route

    def flat(*leaves: PyTree) -> PyTree:  # XLA's module has its name
        gains, state, measurement, given = jax.tree.unflatten(treedef, leaves)
        computed = guard.step(gains, state, measurement, given if route is None else tables.followed(route, given))
        return tuple(x for group in RESULTS for x in jax.tree.leaves(computed[group]))

    state, seen, given = program.examples(law)
    given = given if route is None else tables.numbers(route)
    leaves, treedef = jax.tree.flatten((law, state, seen, given))
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
        "signature.json": as_json(signature(artefact)),
        "provenance.json": as_json(artefact.provenance),
    }


def expiry(written: datetime.date) -> Json:
    """When the promise of JAX ends for a module written that day with the JAX that runs."""
    years, month = divmod(written.month - 1 + MONTHS, 12)
    year = written.year + years
    day = min(written.day, calendar.monthrange(year, month + 1)[1])
    ends = datetime.date(year, month + 1, day)
    versions = {"jax": jax.__version__, "jaxlib": metadata.version("jaxlib")}
    return {"date": ends.isoformat(), "written": written.isoformat(), **versions, "promise": PROMISE}


def signature(artefact: Artefact) -> Json:
    """Names, shapes and units of the module's arguments and results, in their order."""
    step, facts = program.step(artefact.controller), artefact.provenance["gains"]
    units = {("gains", name): fact["unit"] for name, fact in facts.items()}

    def entries(groups: dict[str, tuple[Field, ...]]) -> list[Json]:
        fields = [(group, field) for group, fields in groups.items() for field in fields]
        return [
            {"group": g, "name": f.name, "shape": [*f.shape], "unit": units.get((g, f.name), "")} for g, f in fields
        ]

    numbers = {} if artefact.route is None else tables.numbers(artefact.route)
    about = {name: tables.UNITS[name] for name in numbers if name in tables.UNITS}
    about |= {table.name: table.meaning for table in tables.TABLES.values()}
    laid = [
        {"group": "route", "name": name, "shape": [*np.shape(x)], "unit": about[name]} for name, x in numbers.items()
    ]
    arguments = {group: fields for group, fields in step.arguments.items() if group != "route"}
    return {
        "dtype": "float64",
        "arguments": entries(arguments) + laid,
        "results": entries({group: step.results[group] for group in RESULTS}),
        "gains": {name: fact["value"] for name, fact in facts.items()},
        "route": {name: x.tolist() for name, x in numbers.items()},
        "status": {"not_finite": guard.STATUS["NOT_FINITE"], "started": guard.STATUS["STARTED"]},
        "provenance": artefact.provenance,
    }
