"""What can be asked of a log: leaves of a scenario, by group or by name, with where to look for them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

import agvjax
from agvjax.leaves import get, leaves, rule_of
from agvjax.protocols import Element
from agvjax.scenario import unit_in

from .log import Log, columns_of

GROUPS = ("deadzone", "delay", "lag", "disturbance", "vehicle", "sensor")
# What of a plant a drive can tell. Masses, wheels' sizes and wheelbases go with the slopes of the deadzones: they are
# weighed and measured instead.
VEHICLE = {
    agvjax.Unicycle: ("L",),
    agvjax.DifferentialDrive: ("L", "inertia", "friction", "viscous", "caster_friction", "creep"),
    agvjax.KinematicSingleTrack: ("L",),
    agvjax.Base: ("track", "time_constant", "acceleration", "drift"),
    agvjax.TwistBase: ("drift",),
    agvjax.Ackermann: ("time_constant", "acceleration", "steering_time", "steering_rate", "drift"),
}
LAGS = {  # of plants whose motors lag by themselves: no further lag can be told from theirs
    agvjax.Base: ("time_constant",),
    agvjax.Ackermann: ("time_constant", "steering_time"),
}
ALIKE = {"plant.drift": "disturbance.heading.constant"}  # both add to the yaw rate: a group asks for the first alone
# Of a sensor, what a drive tells: how far off it is looked for, and what counts as little.
MOUNTING = {"sensor.ahead": (5.0, 5e-3), "sensor.left": (5.0, 5e-3), "sensor.turned": (np.pi / 2, 5e-3)}
SINUSOID = ("cosine", "sine")
LONGEST = 2.0  # memories, of a lag; of a delay one
ELEMENTS = {"delay": (agvjax.Delay, "time"), "lag": (agvjax.Lag, "time_constant")}  # the group's class and its number
OMEGA = "disturbance.omega"
DRIFT = 5e-3  # rad/s, by which a yaw rate may be unknown: a third of a degree per second


class Parameter(NamedTuple):
    """One number to be found."""

    name: str
    unit: str
    nominal: float  # what is believed without the log
    low: float
    high: float
    width: float  # how surely: a standard deviation, wide
    floor: float  # an uncertainty below this is small whatever the value
    least: str = ""  # what a value at `low` means, and what moves that edge; empty where no lower one can be
    most: str = ""  # the same at `high`


def parts_of(chain: Element) -> dict[str, Element]:
    """The elements that stand behind one another in an actuator, by name; a single one is called `element`."""
    return dict(chain.items()) if isinstance(chain, agvjax.Chain) else {"element": chain}


def prepared(scenario: agvjax.Scenario, fit: Sequence[str], period: float, memory: float) -> agvjax.Scenario:
    """The scenario with all that the groups ask for: an element in every actuator, a disturbance of one frequency.

    Delays can be looked for up to `memory` [s], in commands that change every `period` [s].
    """
    chains = dict(scenario.actuators)
    for group, (element, number) in ELEMENTS.items():
        for name in scenario.plant.actuators:
            parts = parts_of(chains[name]) if name in chains else {}
            asked = group in fit and not (group == "lag" and type(scenario.plant) in LAGS)
            asked |= f"actuators.{name}.{group}.{number}" in fit
            if asked and not any(isinstance(part, element) for part in parts.values()):
                parts = {group: element()} | parts
            for key, part in parts.items():
                if isinstance(part, agvjax.Delay):  # long enough a memory for the longest delay that is tried
                    wanted = 2 + int(np.ceil(memory / period))
                    there = name in scenario.actuators and key in parts_of(scenario.actuators[name])
                    start = float(part.time) if there else period
                    parts[key] = dataclasses.replace(part, slots=max(part.slots, wanted), time=start)
            if parts:
                chains[name] = agvjax.Chain(**parts)
    disturbance = scenario.disturbance
    if not any(name.startswith("disturbance") for name in fit):
        disturbance = agvjax.NoDisturbance()
    elif not isinstance(disturbance, agvjax.Harmonic):
        disturbance = agvjax.Harmonic()
    sought = "sensor" in fit or any(name in MOUNTING for name in fit)
    given = scenario.sensor if isinstance(scenario.sensor, agvjax.Mounted) else agvjax.Mounted()
    sensor = given if sought or scenario.sensor is given else None
    return dataclasses.replace(scenario, actuators=chains, disturbance=disturbance, sensor=sensor)


def named(scenario: agvjax.Scenario, fit: Sequence[str]) -> tuple[str, ...]:
    """The leaves that groups and names mean, each once."""
    groups = {
        "deadzone": [name for name in leaves(scenario) if name.startswith("deadzone.")],
        "disturbance": [
            name for name in leaves(scenario) if name.startswith("disturbance.") and name != "disturbance.phase"
        ],
        "vehicle": [f"plant.{name}" for name in VEHICLE.get(type(scenario.plant), ())],
        "sensor": [name for name in MOUNTING if not (name == "sensor.ahead" and "plant.L" in leaves(scenario))],
    }
    for group, (element, number) in ELEMENTS.items():
        parts = [(name, parts_of(chain)) for name, chain in scenario.actuators.items()]
        keys = [(name, key) for name, chain in parts for key, part in chain.items() if isinstance(part, element)]
        groups[group] = [f"actuators.{name}.{key}.{number}" for name, key in keys]
    groups["lag"] += [f"plant.{name}" for name in LAGS.get(type(scenario.plant), ())]
    names = dict.fromkeys(name for entry in fit for name in groups.get(entry, [entry]))
    twice = {other for name, other in ALIKE.items() if name in names and other not in fit}
    return tuple(name for name in names if name not in twice)


def unknown(scenario: agvjax.Scenario, fit: Sequence[str]) -> list[str]:
    """Entries of `identify.fit` that name nothing that can be fitted."""
    outside = ("start.", "path.", "sensor.", "limit")  # a log says nothing of these, but where its sensor is mounted
    numbers = {n for n, x in leaves(scenario).items() if not (n.startswith(outside) or np.ndim(x))} | {*MOUNTING}
    return [name for name in fit if name not in numbers and name not in GROUPS]


def parameters(
    scenario: agvjax.Scenario, names: Sequence[str], logs: Sequence[Log], substep: float, memory: float
) -> tuple[Parameter, ...]:
    """Where to look for each, by what it is, by what was commanded and by how long actuators remember it."""
    return tuple(_parameter(scenario, name, logs, substep, memory) for name in names)


def largest(logs: Sequence[Log], name: str) -> float:
    """The largest command that a deadzone's number is about: on its side, of its actuator."""
    columns = columns_of(logs[0].commands, name.split(".")[1])
    sign = -1.0 if name.endswith("left") else 1.0
    return float(max(0.0, *((sign * log.inputs[:, columns]).max() for log in logs)))


# long: one kind of number after the other
def _parameter(scenario: agvjax.Scenario, name: str, logs: Sequence[Log], substep: float, memory: float) -> Parameter:
    value, last, unit = float(get(scenario, name)), name.rpartition(".")[2], unit_in(scenario, name)
    around = f"assume another scenario.{name} than {value:.4g}, around which it is looked for, or check units and model"
    if last.startswith("slope_"):
        low, high = min(0.02, 0.1 * value), max(50.0, 10 * value)
        return Parameter(name, unit, value, low, high, max(1.0, value), 0.0, around, around)
    if last.startswith("threshold_"):
        most = max(largest(logs, name), 1e-3)
        beyond = (
            f"no command of the log goes clearly beyond it, the largest being {most:.4g}: a bound at best, no value"
        )
        return Parameter(name, unit, min(value, 0.9 * most), 0.0, most, 0.5 * most, 0.05 * most, "", beyond)
    if name.startswith("disturbance.") and last != "omega":
        high = 10.0 * max(1.0, abs(value))
        return Parameter(name, unit, value, -high, high, 1.0, 0.02, around, around)
    if name in MOUNTING:
        high, little = MOUNTING[name]
        return Parameter(name, unit, value, -high, high, 0.1, little, around, around)
    if name == OMEGA:
        return Parameter(name, unit, value, min(0.01, 0.1 * value), max(30.0, 3 * value), 1.0, 0.0, around, around)
    if name.startswith("actuators.") and last in ("time", "time_constant"):
        late = last == "time"
        low, high = (0.0, memory) if late else (substep / 2, LONGEST * memory)
        rule = _beyond(high, 1.0 if late else LONGEST)
        nominal = float(np.clip(value, low + 1e-4 * (high - low), high))  # that an assumed delay fits in, the rules say
        return Parameter(name, unit, nominal, low, high, 0.1, 0.5 * logs[0].step, "", rule)
    rule = rule_of(scenario, name)
    sign = rule is not None and rule.low >= 0
    size = abs(value) or 1.0
    above = sign and rule is not None and rule.text == "> 0"
    shift = ": shift the pose to a point further ahead of the axle (identify.ahead, m)" if last == "L" else ""
    least = f"it must be above 0{shift}; or {around}" if above else "" if sign else around
    low = value - 20 * size if not sign else 0.02 * size if above else 0.0
    if name in {f"plant.{lag}" for lags in LAGS.values() for lag in lags}:
        low = max(low, substep / 2)  # the shortest that a substep integrates
        if value < (high := LONGEST * memory):  # of a longer one it is not known how fast motors were before a stretch
            return Parameter(name, unit, value, low, high, size, 0.0, least, _beyond(high, LONGEST))
    high = min(value + 20 * size, np.inf if rule is None else rule.high)
    floor = DRIFT if name == "plant.drift" else 0.0
    return Parameter(name, unit, value, low, high, size, floor, least, "" if rule and high == rule.high else around)


def _beyond(longest: float, times: float) -> str:
    """What it means that a time ends at the longest that can be looked for, so many memories."""
    more = "" if times == 1 else f" times {times:g}"
    return f"longer than {longest:g} s, identify.memory{more}; a longer one moves it"


def values(parameters: Sequence[Parameter]) -> np.ndarray:
    """Nominal values (P,)."""
    return np.array([p.nominal for p in parameters])


def widths(parameters: Sequence[Parameter]) -> np.ndarray:
    """How surely they are believed without the log (P,), as standard deviations."""
    return np.array([p.width for p in parameters])


def sinusoidal(name: str) -> bool:
    """Whether a parameter is about the disturbance's sinusoid."""
    return name == OMEGA or (name.startswith("disturbance.") and name.endswith(SINUSOID))
