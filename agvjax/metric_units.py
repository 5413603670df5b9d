"""The units of metrics in a scenario: commands and what actuators deliver have those of the vehicle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from .metric_table import METRICS
from .scenario import Scenario

COMMANDED = ("rms_command", "peak_command", "chatter")  # fields in the units of a law's command
PLAIN: Mapping[str, str] = {name: row.unit for name, row in METRICS.items()}  # of the paper's plant


def units_in(scenario: Scenario) -> dict[str, str]:
    """The units of all metrics in a scenario: those of commands are its plant's, and so are those of its outputs."""
    plant = scenario.plant
    asked = plant.command_units
    delivered = [plant.units.get(part, "") for name in plant.actuators for part in plant.parts(name)]
    units = {name: row.unit for name, row in METRICS.items()}  # those of one's own metrics too, which come later
    for name, row in METRICS.items():
        if (row.field or name) in COMMANDED and row.channel is not None and row.channel < len(asked):
            units[name] = asked[row.channel]
    units["peak_position"] = _together(asked[:2], " or ")
    if all(delivered):
        units["delivered_peak"] = _together(delivered, " or ")
        units |= dict.fromkeys(("delivered_effort", "delivered_variation"), _together(delivered, ", "))
    everything = asked if plant.commands_heading else asked[:2]
    units |= dict.fromkeys(("effort", "total_chatter"), _together(everything, ", "))
    if not plant.commands_heading:  # x and y alone
        units |= {"total_rmse": "m", "total_iae": "m s", "total_ise": "m^2 s", "total_itae": "m s^2"}
    return units


def _together(units: Sequence[str], joined: str) -> str:
    return joined.join(dict.fromkeys(units))
