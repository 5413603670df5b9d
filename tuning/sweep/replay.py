"""One vehicle of a sweep, to be rolled out again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import agvjax
from agvjax import Fault, InputError
from agvjax.timing import whole

from ..config.settings import Config, Simulate, Tune
from . import points, results, shards
from .design import Design, scene
from .laws import CONFIGURED


class Vehicle(NamedTuple):
    """A scenario of a sweep, one of the sweep's controllers, and the sweep's configuration with both of them."""

    controller: agvjax.Law
    scenario: agvjax.Scenario
    config: Config


def vehicle(folder: str, index: int | None, name: str | None = None, imports: Sequence[str] = ()) -> Vehicle:
    """The vehicle of number `index` with the controller of this name, by default the first one.

    Args:
        folder: of the sweep, or of a search for rare failures, whose vehicles are the most likely of them.
        index: number of the scenario.
        name: of the controller.
        imports: files of the classes of one's own that the sweep names.

    Raises:
        InputError: no folder of a sweep, or there is no such number or name in it.
    """
    if points.there(Path(folder)):
        return _point(folder, index, name, imports)
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
    tune = config.tune if type(controller) is type(config.controller) else Tune()  # its gains are those of a law
    controller = agvjax.replace(controller, swept)
    return Vehicle(controller, scenario, replace(config, controller=controller, scenario=scenario, tune=tune))


def _point(folder: str, index: int | None, name: str | None, imports: Sequence[str]) -> Vehicle:
    """One of the failures that a search for rare ones kept."""
    try:
        config, kept = points.read(Path(folder), imports)
    except ValueError as error:
        raise _no_sweep(folder, error) from error
    if index is None or not 0 <= index < len(kept):
        rule = f"from 0 to {len(kept) - 1}, the failures found" if kept else "left out: no failure was found"
        raise InputError([Fault("--index", "none" if index is None else index, rule)])
    if name not in (None, CONFIGURED):
        raise InputError([Fault("--controller", name, f"{CONFIGURED}, the only one")])
    swept, values = Design.split(kept[index])
    controller, scenario = agvjax.replace(config.controller, swept), agvjax.replace(config.scenario, values)
    return Vehicle(controller, scenario, replace(config, controller=controller, scenario=scenario))


def retimed(swept: Simulate, given: Mapping[str, Any]) -> Simulate:
    """A sweep's settings of a run with others `given` by name; law and sensor look as often, unless that is given too.

    Raises:
        InputError: the step divides the sweep's control interval into no whole number.
    """
    timing = replace(swept, **given)
    if swept.control_every == 1 or "control_every" in given:
        return timing
    interval = swept.control_every * swept.dt
    if not whole(interval / timing.dt):
        rule = f"a whole fraction of the sweep's control interval, {interval:g} s, or given with simulate.control_every"
        raise InputError([Fault("simulate.dt", timing.dt, rule)])
    return replace(timing, control_every=round(interval / timing.dt))


def _no_sweep(folder: str, error: ValueError) -> InputError:
    return InputError([Fault("--from", folder, f"the folder of a sweep ({error})")])
