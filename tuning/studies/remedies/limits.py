"""One command budget for laws whose commands do not mean the same: counted behind the deadzone, at the vehicle."""

from __future__ import annotations

import dataclasses

import numpy as np

from ...config.settings import Config, Limit

AT_ACTUATORS = {  # what a law asks for is not what an inverse sends for it
    "effort": "delivered_effort",
    "peak_position": "delivered_peak",
    "peak_heading": "delivered_peak",
    "total_chatter": "delivered_variation",
    **{f"rms_command_{axis}": "delivered_effort" for axis in ("x", "y", "heading")},
    **{f"peak_command_{axis}": "delivered_peak" for axis in ("x", "y")},
    **{f"chatter_{axis}": "delivered_variation" for axis in ("x", "y", "heading")},
}
LEAST = ("delivered_effort", "delivered_variation")  # limited where a configuration limits no command


def at_actuators(limits: dict[str, Limit]) -> dict[str, Limit]:
    """The limits, those on commands as the same multiples of what is delivered; the tightest where several meet.

    Where none is left on what is delivered, effort and variation may not exceed what they are without a remedy.
    """
    made: dict[str, Limit] = {}
    for name, limit in limits.items():
        if all(np.isinf(value) for value in (limit.mean, limit.worst, limit.cvar)):
            continue
        place = AT_ACTUATORS.get(name, name)
        made[place] = _tighter(made[place], limit) if place in made else limit
    if not any(name.startswith("delivered") for name in made):
        made |= dict.fromkeys(LEAST, Limit(mean=1.0, worst=1.0))
    return made


def _tighter(one: Limit, other: Limit) -> Limit:
    parts = {part: min(getattr(one, part), getattr(other, part)) for part in ("mean", "worst", "cvar")}
    return dataclasses.replace(one, **parts)


def budgeted(config: Config) -> Config:
    """The configuration with its limits at the actuators."""
    tune = dataclasses.replace(config.tune, limits=at_actuators(config.tune.limits))
    return dataclasses.replace(config, tune=tune)
