"""What a log has driven, before anything is fitted: speeds, turns, directions, small commands; and what it lacks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

import agvjax
from agvjax.leaves import leaves

from .log import Log, columns_of
from .plain import twists

STANDS = 0.05  # of the usual speed, and of the usual yaw rate: less is standing, and straight on
PAST = 0.02  # share of an end of the vehicle's by which a command is beyond it
LITTLE = 0.03  # share of the time: less of something is hardly any
SMALL = 2.0  # thresholds that are assumed: commands up to that are small
FEW = 10  # times that a command goes up or down, by which a delay is told


class Covered(NamedTuple):
    """How much of each kind logs have driven."""

    shares: Mapping[str, float]  # of the time, by what
    commands: Sequence[tuple[str, float, float, float, int]]  # name, least, most, share of small ones, times up or down
    lacks: Sequence[str]  # in words, what a drive should have and these have not


def covered(scenario: agvjax.Scenario, logs: Sequence[Log]) -> Covered:
    """What logs have driven, by what is measured, and what they were sent."""
    moved = np.concatenate([twists(log) for log in logs])
    v, w = moved[:, 0], moved[:, 2]
    usual = [STANDS * max(float(np.quantile(np.abs(x), 0.9)), 1e-9) if x.size else 0.0 for x in (v, w)]
    shares = {name: float(np.mean(there)) if there.size else 0.0 for name, there in motions(v, w, *usual).items()}
    lacks = [f"drives {name}" for name in ("backwards", "to the left", "to the right") if shares[name] < LITTLE]
    commands = []
    for actuator in scenario.plant.actuators:
        u = np.concatenate([log.inputs[:, columns_of(log.commands, actuator)].ravel() for log in logs])
        threshold = {side: _threshold(scenario, actuator, side) for side in ("right", "left")}
        small = (u != 0) & (u < SMALL * threshold["right"]) & (u > -SMALL * threshold["left"])
        turns = sum(_swings(log.inputs[:, i]) for log in logs for i in columns_of(log.commands, actuator))
        commands.append((actuator, float(u.min()), float(u.max()), float(small.mean()), turns))
        for sign, side in (("positive", "right"), ("negative", "left")):
            way = u if sign == "positive" else -u
            if np.mean(way > threshold[side]) < LITTLE:
                lacks.append(f"{sign} commands of {actuator} beyond its deadzone")
        if max(threshold.values()) > 0 and small.mean() < LITTLE:
            lacks.append(f"small commands of {actuator}, up to {SMALL * max(threshold.values()):.3g}")
        if turns < FEW:
            lacks.append(f"commands of {actuator} that rise and fall")
    return Covered(shares, commands, lacks)


def beyond(scenario: agvjax.Scenario, covered: Covered) -> list[str]:
    """Commands that the assumed vehicle cannot follow, as it ends sooner: no fit of the rest makes up for that."""
    plant, said = scenario.plant, []
    for actuator, *ends, _, _ in covered.commands:
        given = np.asarray(scenario.deadzone[actuator](jnp.array(ends)), float)
        reach = np.array(plant.reach().get(actuator, (-np.inf, np.inf)))
        if np.any(over := np.sign(reach) * (given - reach) > PAST * np.abs(reach)):
            side, unit = int(np.argmax(over)), plant.units.get(actuator, "")
            said.append(
                f"{actuator} was sent up to {ends[side]:.3g} {unit}, and the assumed vehicle ends at {reach[side]:.4g}"
                f" {unit}: if yours goes further, set it (scenario.plant, largest_angle of an ackermann), or other"
                " numbers are found wrong in its place."
            )
    return said


def motions(v: np.ndarray, w: np.ndarray, stands: float, straight: float) -> dict[str, np.ndarray]:
    """By what a vehicle does, when it does it (N,).

    Args:
        v: its speed (N,) [m/s]; what is not known, NaN, is nothing of it.
        w: its yaw rate (N,) [rad/s].
        stands: the speed below which it stands [m/s].
        straight: the yaw rate below which it drives straight on [rad/s].
    """
    return {
        "forwards": v > stands,
        "backwards": v < -stands,
        "to the left": w > straight,
        "to the right": w < -straight,
        "straight on": (np.abs(w) <= straight) & (np.abs(v) > stands),
    }


def _swings(u: np.ndarray) -> int:
    """How often a command (N,) goes from its lower half to its upper one or back, by a fifth of its range at least."""
    off, clear = u - (u.max() + u.min()) / 2, 0.1 * float(np.ptp(u))
    side = np.sign(off[np.abs(off) > clear])
    return int((np.diff(side) != 0).sum()) if clear else 0


def _threshold(scenario: agvjax.Scenario, actuator: str, side: str) -> float:
    """The deadzone that is assumed of an actuator to a side; 0 where none is."""
    zone = leaves(scenario.deadzone[actuator]) if actuator in scenario.deadzone else {}
    return float(zone.get(f"threshold_{side}", 0.0))
