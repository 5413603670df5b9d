"""A scenario: all that the controller does not know. Its defaults are the paper's section 4, written here once."""

from __future__ import annotations

import dataclasses
from typing import Any

from ._pytree import POSITIVE, number, pytree
from .deadzone import Deadzone
from .disturbance import Cosine
from .path import Dumbbell
from .plant import Decoupled, Start


def paper_deadzones() -> dict[str, Deadzone]:
    """Section 4: one deadzone for x and y, one for the heading."""
    return {
        "position": Deadzone(slope_right=0.6, slope_left=0.8, threshold_right=0.5, threshold_left=0.4),
        "heading": Deadzone(slope_right=0.91, slope_left=0.72, threshold_right=0.66, threshold_left=0.53),
    }


@pytree
class Scenario:
    """Vehicle, actuators, disturbance, path and start; the paper's by default.

    `deadzone` holds one actuator for each channel that the plant names. `heading` None asks for the path's own reading
    (`agvjax.default_heading`). A run whose vehicle state leaves the ball of radius `limit` has diverged and is latched.
    """

    plant: Any = Decoupled()
    deadzone: dict[str, Any] = dataclasses.field(default_factory=paper_deadzones)
    disturbance: Any = Cosine()
    path: Any = Dumbbell()
    heading: Any = None
    sensor: Any = None
    start: Start = dataclasses.field(default_factory=Start)
    limit: float = number(1e3, "norm of the vehicle's state", POSITIVE)
