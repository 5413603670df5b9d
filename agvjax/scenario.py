"""A scenario: all that the controller does not know. Its defaults are the paper's section 4, written here once."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from ._pytree import POSITIVE, Real, number, pytree
from .disturbance import Cosine
from .messages import Start
from .paths.shapes import Dumbbell
from .plants import Decoupled
from .protocols import Disturbance, Element, Heading, Path, Plant, Sensor


@pytree
class Scenario:
    """Vehicle, actuators, disturbance, path and start; the paper's by default.

    `deadzone` holds the deadzone of each actuator that the plant names; what else the signal runs through after it,
    limits and delays for one, is in `actuators`, a `Chain` for each that has any. `heading` None asks for the path's
    own reading (`agvjax.default_heading`). A run whose vehicle state leaves the ball of radius `limit`, its
    position counted from where the path is and its heading without whole turns, has diverged and is latched.

    Attributes:
        plant: the vehicle.
        deadzone: of each actuator that the plant names.
        actuators: what else the signal of an actuator runs through after its deadzone: limits, delays, lags.
        disturbance: what pushes the vehicle.
        path: what is to be followed.
        heading: which heading is asked for; none: the path's own reading.
        sensor: noise on what is measured; none: all is measured exactly.
        start: where, how fast and in which direction a vehicle begins.
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
