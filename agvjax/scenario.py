"""A scenario: all that the controller does not know. Its defaults are the paper's section 4, written here once."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from ._pytree import POSITIVE, Real, number, pytree
from .disturbance import Cosine
from .leaves import unit_of
from .messages import Start
from .paths.shapes import Dumbbell
from .plants import Decoupled
from .protocols import Disturbance, Element, Heading, Path, Plant, Sensor


@pytree
class Scenario:
    """Vehicle, actuators, disturbance, path and start; the paper's by default.

    `deadzone` holds the deadzone of each actuator that the plant names. The elements after it, such as limits and
    delays, are in `actuators`, a `Chain` for each actuator that has any. With `heading` None the path's own reading is
    used (`agvjax.default_heading`). A run diverges when its vehicle state leaves the ball of radius `limit`, with
    the position relative to the path and the heading without whole turns; its state is frozen from then on.

    Attributes:
        plant: the vehicle.
        deadzone: the deadzone of each actuator that the plant names.
        actuators: the elements after the deadzone of each actuator: limits, delays, lags.
        disturbance: the disturbance that acts on the vehicle.
        path: the reference path.
        heading: the reference heading; none: the path's own reading.
        sensor: measurement noise; none: exact measurements.
        start: initial position, velocity and heading.
    """

    plant: Plant = Decoupled()
    deadzone: Mapping[str, Element] = dataclasses.field(default_factory=lambda: Decoupled().deadzones())
    actuators: Mapping[str, Element] = dataclasses.field(default_factory=dict)
    disturbance: Disturbance = Cosine()
    path: Path = Dumbbell()
    heading: Heading | None = None
    sensor: Sensor | None = None
    start: Start = dataclasses.field(default_factory=Start)
    limit: Real = number(1e3, "norm of the vehicle's state, relative to the path", POSITIVE)

    @classmethod
    def of(cls, plant: Plant, **fields: Any) -> Scenario:
        """The scenario of another plant: with that plant's nominal deadzones, and these `fields`."""
        return dataclasses.replace(cls(plant=plant, deadzone=plant.deadzones()), **fields)


def unit_in(scenario: Scenario, name: str) -> str:
    """The unit of a leaf of a scenario; of a number of an actuator in the unit of that actuator's command."""
    unit, actuator = unit_of(scenario, name), (*name.split("."), "")[1]
    units = scenario.plant.units
    parts = (actuator, *scenario.plant.parts(actuator)) if actuator in scenario.plant.actuators else ()
    own = next((units[part] for part in parts if part in units), "")
    return unit.replace("unit of the command", own) if own else unit
