"""What is exported: a sampled controller, and where it comes from."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
import tomllib
import unicodedata
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

import agvjax
from agvjax import Fault, InputError, Route, Sampled
from agvjax.leaves import leaves, rule_of, unit_of
from agvjax.paths.heading import reference

from .. import config as configuration
from ..config import mapped
from ..config.settings import Config
from ..io.files import Json, finite, text
from ..io.plain import toml

INSTANTS = 1001  # of the path, at which its speed is looked at
MET = "tuning met all its limits"
CHANGED = "not known: the gains are others than those that worst.json beside them judges"
UNJUDGED = "not known: no worst.json of `agvjax tune` beside the gains says whether tuning met its limits"
UNSTATED = "not stated: no config.toml beside the gains"


class Artefact(NamedTuple):
    """A controller and its provenance, which every form of export carries."""

    controller: agvjax.Sampled  # in float64
    provenance: Json  # plain, for JSON
    route: Route | None = None  # that the configuration has, of a law that follows one
    config: Config | None = None  # that says what the vehicle is
    note: Callable[[str], None] = print  # who is told what came out otherwise than one may think


def read(
    gains_file: str,
    config_files: Sequence[str] = (),
    overrides: Sequence[str] = (),
    imports: Sequence[str] = (),
    note: Callable[[str], None] | None = None,
) -> Artefact:
    """A `gains.toml`, with the configuration that it was tuned under: `config.toml` beside it unless others are given.

    Overrides, imports and note are those of `tuning.config.load`.

    Raises:
        agvjax.InputError: a file cannot be read or its content is wrong, or the controller has no period.
    """
    path = Path(gains_file)
    try:
        content = text(path)
        table = toml(content)
    except (OSError, ValueError) as error:
        raise InputError([Fault("GAINS.toml", gains_file, f"a readable TOML file of gains ({error})")]) from error
    law = table.get("controller")
    if not isinstance(law, dict):
        raise InputError([Fault("GAINS.toml", gains_file, "a file with a [controller], as `agvjax tune` writes it")])
    beside, whole = path.with_name("config.toml"), "scenario" in table  # a configuration, which says all itself
    files = [*config_files] or ([str(beside)] if beside.is_file() and not whole else [])
    alone = {"scenario.plant": law["vehicle"]} if not (files or whole) and "vehicle" in law else {}
    config = configuration.load([*files, gains_file], overrides, more=alone, imports=imports, note=note)
    controller = _exportable(config.controller)
    known = bool(files) or whole
    stated = configuration.dump(config) if known else content
    verdict = {"verdict": _verdict(path.with_name("worst.json"), controller)}
    provenance = finite(_provenance(config, controller, path.name, stated, known) | verdict)
    said = {} if note is None else {"note": note}
    return Artefact(controller, provenance, _route(config, controller), config if known else None, **said)


def _exportable(law: agvjax.Law) -> Sampled:
    """The law, if it has a period."""
    if not isinstance(law, Sampled):
        rule = "sampled: only a controller with a period can be exported; tune one with controller.type = 'sampled'"
        raise InputError([Fault("controller", type(law).__name__, rule)])
    return agvjax.check(law)


def _route(config: Config, controller: Sampled) -> Route | None:
    """The route that the law is to follow; a corridor is left out, which no law looks at."""
    path = config.scenario.path
    if not controller.follows():
        return None
    if not isinstance(path, Route):
        law = type(controller.inner).__name__
        rule = f"a route, type = 'route', which {law} follows: it lies in the configuration beside the gains (--config)"
        raise InputError([Fault("scenario.path", type(path).__name__, rule)])
    return dataclasses.replace(mapped.laid(path), half_widths=None)


def _provenance(config: Config, controller: Sampled, source: str, stated: str, known: bool) -> Json:
    return {
        "generator": f"agvjax {agvjax.__version__}",
        "source": source,
        "configuration_sha256": hashlib.sha256(stated.encode()).hexdigest(),
        "law": [type(controller).__name__, type(controller.inner).__name__],
        "vehicle": type(controller.vehicle).__name__,
        "period": {"value": float(controller.period), "unit": "s"},
        "speed": {"value": _speed(config) if known else None, "unit": "m/s"},
        "gains": {name: _gain(controller, name, value) for name, value in leaves(controller).items()},
        "route": _laid(config) if controller.follows() and known else None,
        "inputs": {name: controller.vehicle.units.get(name, "") for name in controller.vehicle.actuators},
        "uncertainty": _uncertainty(config) if known else UNSTATED,
    }


def _verdict(file: Path, controller: Sampled) -> str:
    """What `agvjax tune` said of these gains, in the file beside them."""
    try:
        table = json.loads(file.read_text(encoding="utf-8"))
        failure, judged = str(table["verdict"]), dict(table["gains"])
        cautions = "; ".join(map(str, table.get("cautions", [])))
    except (OSError, ValueError, KeyError, TypeError):
        return UNJUDGED
    gains = {name: np.asarray(value, float) for name, value in leaves(controller).items()}
    if judged.keys() != gains.keys():
        return CHANGED
    for name, value in gains.items():
        if np.shape(judged[name]) != value.shape or not np.allclose(np.asarray(judged[name], float), value, 1e-6, 0.0):
            return CHANGED
    return " ".join(filter(None, [failure or MET, cautions and f"(before using these gains, note: {cautions})"]))


def _laid(config: Config) -> Json:
    """What the route is that the gains were tuned on."""
    path = config.scenario.path
    if not isinstance(path, Route):
        return {}
    length = {"value": float(np.asarray(path.length)), "unit": "m"}
    return {"length": length, "legs": path.legs.shape[1], "pieces": path.squares.shape[1], "closed": path.closed}


def _speed(config: Config) -> float | None:
    """The one speed [m/s] that most of the path tuned on is driven at, to three digits; None of one that has none."""
    scene = config.scenario
    if isinstance(scene.path, Route):
        speeds = np.sqrt(np.asarray(scene.path.squares)[0])
    else:
        times = jnp.linspace(0.0, config.simulate.horizon, INSTANTS)
        velocities = jax.vmap(lambda t: reference(scene.path, scene.heading, t).velocity)(times)
        speeds = np.linalg.norm(velocities, axis=-1)
    moving = speeds[speeds > 0.01 * speeds.max()]
    usual = np.median(moving) if moving.size else 0.0
    alike = np.abs(moving - usual) < 0.05 * usual
    return float(f"{usual:.3g}") if alike.sum() > moving.size / 2 else None


def _gain(controller: Sampled, name: str, value: PyTree) -> Json:
    rule, number = rule_of(controller, name), np.asarray(value, float).tolist()
    text, low, high = ("", None, None) if rule is None else (rule.text, float(rule.low), float(rule.high))
    return {"value": number, "unit": unit_of(controller, name), "rule": text, "low": low, "high": high}


def _uncertainty(config: Config) -> Json:
    """The ensemble's draws and what of the scenario they vary, as they stand in TOML."""
    table = tomllib.loads(configuration.dump(config))
    scenario = {name: table["scenario"][name] for name in ("plant", "deadzone", "actuators", "disturbance")}
    return {"nominal": scenario, "ensemble": table["ensemble"]}


def version(artefact: Artefact) -> str:
    """The version of the generator, as package.xml takes it: three numbers."""
    numbers = re.search(r"\d+\.\d+\.\d+", artefact.provenance["generator"])
    return numbers[0] if numbers else "0.1.0"


def plain(text: str) -> str:
    """In one line, without what could end a literal of C++ or Python, or be seen as what it is not."""
    shown = (" " if unicodedata.category(x)[0] == "C" or x in '"`\\' else x for x in text)
    return " ".join("".join(shown).split())


def filled(template: Path, parts: dict[str, str]) -> str:
    """The text of a template with each @KEY@ replaced by the part of that key; what a part says stays as it is."""
    text = template.read_text(encoding="utf-8")
    return re.sub(r"@([A-Z_]+)@", lambda match: parts.get(match[1], match[0]), text)
