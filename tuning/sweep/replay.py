"""One vehicle of a sweep, to be rolled out again."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import agvjax
from agvjax import Fault, InputError

from . import results, shards
from .design import scene


class Vehicle(NamedTuple):
    """A scenario of a sweep, one of the sweep's controllers, and how long it was rolled out."""

    controller: agvjax.Law
    scenario: agvjax.Scenario
    horizon: float  # s


def vehicle(folder: str, index: int | None, name: str | None = None, imports: Sequence[str] = ()) -> Vehicle:
    """The vehicle of number `index` with the controller of this name, by default the first one.

    Args:
        folder: of the sweep.
        index: number of the scenario.
        name: of the controller.
        imports: files of the classes of one's own that the sweep names.

    Raises:
        InputError: no folder of a sweep, or there is no such number or name in it.
    """
    try:
        manifest = shards.read_manifest(Path(folder))
    except ValueError as error:
        raise _no_sweep(folder, error) from error
    if index is None or not 0 <= index < manifest.size:
        rule = f"from 0 to {manifest.size - 1}, the scenarios of the sweep"
        raise InputError([Fault("--index", "none" if index is None else index, rule)])
    if name is not None and name not in manifest.names:
        raise InputError([Fault("--controller", name, f"one of the sweep's: {', '.join(manifest.names)}")])
    config = results.config_of(manifest, imports)
    try:
        plan = results.plan_of(manifest, config)
    except ValueError as error:
        raise _no_sweep(folder, error) from error
    swept, scenario = scene(plan, index)
    controller = results.controller_of(manifest, manifest.names.index(name) if name is not None else 0, imports)
    return Vehicle(agvjax.replace(controller, swept), scenario, config.simulate.horizon)


def _no_sweep(folder: str, error: ValueError) -> InputError:
    return InputError([Fault("--from", folder, f"the folder of a sweep ({error})")])
