"""What a proof needs of a configuration: what is wrong with it, and what nothing can be proved of."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import agvjax
from agvjax import Fault
from agvjax.controllers.backstepping import KnownSlopes
from agvjax.controllers.filters import CommandFilter, LiteralFilter
from agvjax.plants.decoupled import DeliveredYawRate, TurnedVelocity
from agvjax.schedule import schedules

from ...config import rules
from ...config.ends import LAW, Moving, element_of
from ...config.settings import Config
from ...ensemble.draws import Range
from ...ensemble.rules import near
from .checker import JUMPS, LEAVES
from .problem import box, over

LINEAR = (agvjax.NeuroBackstepping, agvjax.DFC, agvjax.OSFC)  # but for the deadzone, and what is bounded
NOT_LINEAR = {
    agvjax.ASMC: "its command jumps with the sign of an error within `eps`: no small rest of a linear one",
    agvjax.FTSMC: "its command has an unbounded slope at a small error: no small rest of a linear one",
}


def faults(config: Config) -> list[Fault]:
    """What is wrong with a configuration of which something is to be proved."""
    wrong = rules.faults(config) or rules.timing_faults(config, "sweep") or list(_sides(config))
    if not wrong and not config.criteria.late < config.simulate.horizon:
        wrong = [Fault("criteria.late", config.criteria.late, f"before the horizon, {config.simulate.horizon:g} s")]
    return wrong or list(_signs(config))


def moving(config: Config) -> list[Moving]:
    """What differs between the scenarios of the box."""
    return [Moving("certify.over", {name: span}) for name, span in over(config).items()]


def _sides(config: Config) -> Iterator[Fault]:
    known = agvjax.leaves(config.scenario)
    seen: set[tuple[str, int | None]] = set()
    for table in config.certify.over:
        for name, span in table.items():
            leaf, element = element_of(name)
            if leaf.startswith(LAW) or leaf not in known:
                yield Fault("certify.over", name, f"a leaf of the scenario{near(leaf, list(known))}")
            elif element is not None and (np.ndim(known[leaf]) != 1 or element >= np.size(known[leaf])):
                yield Fault("certify.over", name, f"an element of {leaf}, of shape {np.shape(known[leaf])}")
            elif not isinstance(span.draw, Range) or span.points:
                yield Fault(f"certify.over.{name}", span.draw, "a range LOW:HIGH, without a number of points")
            elif (leaf, element) in seen or (leaf, None) in seen:
                yield Fault("certify.over", name, "named once")
            seen.add((leaf, element))


def _signs(config: Config) -> Iterator[Fault]:
    """Sides along which a deadzone would be none."""
    for name, (low, _) in box(config).items() if not unproved(config) else ():
        slope = "slope" in name
        if name.startswith("deadzone") and (low < 0 or slope and low == 0):
            key = f"certify.over.{name}" if config.certify.over else "ensemble.draws"
            yield Fault(key, low, f"{'above' if slope else 'at least'} 0, all along the side {name}")


def unproved(config: Config) -> str:
    """Why nothing can be proved of a law and a scenario; empty where something can."""
    return next((why for why in (*_law(config.controller), *_scenario(config), *_box(config)) if why), "")


def _law(law: agvjax.Law) -> Iterator[str]:
    name = type(law).__name__
    if isinstance(law, agvjax.Sampled | agvjax.EventTriggered):
        yield f"{name} holds its command between instants: the proof is of the loop in continuous time"
    elif law.follows():
        yield f"{name} follows a route by where the vehicle is: its error has no linear part, the same everywhere"
    elif type(law) in NOT_LINEAR:
        yield f"{name}: {NOT_LINEAR[type(law)]}"
    elif type(law) not in LINEAR:
        yield f"{name} is not among the laws whose linear part is known: {', '.join(c.__name__ for c in LINEAR)}"
    elif curves := schedules(law):
        yield f"{', '.join(curves)}: a gain that is a curve over something measured makes the command no linear one"
    elif isinstance(law, agvjax.NeuroBackstepping):
        if any(isinstance(x, KnownSlopes) or np.ndim(np.asarray(x)) for x in (law.Pi_hat, law.Pi_psi_hat)):
            yield "the law assumes slopes by sign or by axis (Pi_hat): its command is not linear"
        if not isinstance(law.filter, CommandFilter | LiteralFilter):
            yield "without a command filter the law has no state for its virtual command"


def _scenario(config: Config) -> Iterator[str]:
    scenario = config.scenario
    plant, wave, path = scenario.plant, scenario.disturbance, scenario.path
    if not isinstance(plant, agvjax.Decoupled):
        yield f"{type(plant).__name__}: position and heading do not separate as they do in the decoupled plant"
    elif not isinstance(plant.yaw_rate, DeliveredYawRate) or not isinstance(plant.coupling, TurnedVelocity):
        yield "the coupling F is bounded only where it is the delivered yaw rate times the velocity turned (reading R9)"
    if not all(isinstance(part, agvjax.Deadzone) for part in scenario.deadzone.values()):
        yield "an actuator has another element in the place of a deadzone"
    if scenario.actuators:
        yield "elements after the deadzone (limits, delays, lags) have a memory that the tube does not carry"
    if scenario.sensor is not None:
        yield "noise of a sensor has no bound"
    if not isinstance(wave, agvjax.Cosine) or any(map(np.ndim, (wave.amplitude, wave.omega, wave.phase))):
        yield "the disturbance is not one cosine for all channels"
    elif float(wave.phase) < 0:
        yield "the phase of the disturbance is below 0"
    usual = scenario.heading is None
    if isinstance(path, agvjax.Dumbbell):
        usual |= isinstance(scenario.heading, agvjax.Bearing)
    elif isinstance(path, agvjax.Circle):
        usual |= isinstance(scenario.heading, agvjax.Tangent)
    else:
        yield f"the path {type(path).__name__} is not among those that the checker computes by itself: dumbbell, circle"
    if isinstance(config.controller, agvjax.NeuroBackstepping) and not config.controller.wrapped:
        if not isinstance(path, agvjax.Dumbbell):
            yield JUMPS
    if not usual:
        yield "the checker computes only the path's own heading (heading = none)"


def _box(config: Config) -> Iterator[str]:
    for name in over(config):
        leaf, element = element_of(name)
        if not any(known == name or (element is None and known.startswith(f"{leaf}[")) for known in LEAVES):
            yield f"{name} cannot be a side of the box: deadzones, the disturbance's amplitude and starts can"
