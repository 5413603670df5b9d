"""What can only be said of a configuration as a whole: names that name nothing, steps that do not fit, empty wishes."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable

import jax
import numpy as np

import agvjax
from agvjax import Fault, InputError
from agvjax.errors import told_apart
from agvjax.protocols import Element
from agvjax.schedule import MEASURED, extremes, schedules
from agvjax.timing import whole

from ..ensemble.draws import correlated
from .complete import complete
from .imports import PLACES, classes
from .old import present, warned
from .read import Reader
from .settings import Config
from .write import table_of

WHERE = " (where "  # before the corner at which a rule is broken
NO_ROUTE = "it needs a route, and scenario.path is not one"
MOST_STEPS, MOST_SEED = 1e8, 2**31
Rules = Callable[[Config], list[Fault]]  # what is wrong with a configuration, of a room
BASES = {"scenario": agvjax.Scenario} | {places[0]: base for base, places in PLACES.items() if base is not Element}
OPTIONAL = ("scenario.heading", "scenario.sensor")


def faults(config: Config) -> list[Fault]:
    """What is wrong with law, scenario and step, whatever is done with them."""
    every = config.simulate.control_every
    wrong = vehicle_faults(config)
    if config.controller.control_period() is not None and every != 1:
        wrong.append(Fault("simulate.control_every", every, "1: a sampled law has a period of its own"))
    wrong += _correlation(config) + _seeds(config)
    return wrong or timing_faults(config, "simulate")


def vehicle_faults(config: Config) -> list[Fault]:
    """Numbers that break their rule, and what of the law or of a heading does not suit the scenario."""
    scenario, wrong = config.scenario, agvjax.faults(config)
    if scenario.heading is not None:
        wrong += [fault._replace(key=f"scenario.{fault.key}") for fault in scenario.heading.faults(scenario.path)]
    if any(fault.key.startswith("controller") for fault in wrong):  # of numbers that are none, nothing can be asked
        return wrong
    found = [fault for law in extremes(config.controller) for fault in law.faults(scenario.plant)]
    found += _unmeasured(config.controller, scenario.plant)
    return wrong + unique(fault._replace(key=f"controller.{fault.key}") for fault in found)


def _unmeasured(law: agvjax.Law, plant: agvjax.Plant) -> list[Fault]:
    """Schedules over what a plant does not measure."""
    nothing = dict.fromkeys(plant.actuators, jax.ShapeDtypeStruct((), float))
    seen = jax.eval_shape(plant.output, jax.eval_shape(plant.start, agvjax.Start()), nothing)  # computes nothing
    known = [name for name in MEASURED if name != "steering_angle" or seen.steering_angle is not None]
    rule = f"what the vehicle measures: {', '.join(known)}"
    return [Fault(f"{key}.over", x.over, rule) for key, x in schedules(law).items() if x.over not in known]


def check(config: Config, rules: Rules = faults) -> Config:
    """A configuration made in Python, completed and found usable by the `rules` of a room.

    Its settings are read once more from the table that would be written of them, so that a wrong one is refused with
    the words that a file would get, and numbers of NumPy and lists are what they are after a file.

    Raises:
        agvjax.InputError: lists every bad key, its value and the rule.
    """
    if wrong := _foreign(config):
        raise InputError(wrong)
    table, writer = table_of(config, settings=True)
    reader = Reader(classes(config.imports))
    bare = Config(controller=config.controller, scenario=config.scenario, imports=config.imports)
    settings, reported = reader.config(present(table, warned), bare), {fault.key for fault in writer.faults}
    return checked(settings, rules, writer.faults + [fault for fault in reader.faults if fault.key not in reported])


def checked(config: Config, rules: Rules, wrong: list[Fault]) -> Config:
    """A configuration with what is `wrong` with its table so far, completed and found usable.

    Raises:
        agvjax.InputError: lists every bad key, its value and the rule.
    """
    config = complete(config)
    found = rules(config)
    if any(fault.key.startswith("scenario.path") for fault in wrong):  # what follows from that is not said again
        found = [fault for fault in found if NO_ROUTE not in fault.rule]
    if wrong := wrong + found:
        raise InputError(wrong)
    return config


def _foreign(config: Config) -> list[Fault]:
    """Law and scenario, and the parts of a scenario, that are of another class."""
    has_parts = isinstance(config.scenario, agvjax.Scenario)
    parts = {key: operator.attrgetter(key)(config) for key in BASES if has_parts or "." not in key}
    return [
        Fault(key, repr(part), f"an agvjax.{BASES[key].__name__}: of a class that derives from it")
        for key, part in parts.items()
        if not isinstance(part, BASES[key]) and not (part is None and key in OPTIONAL)
    ]


def unique(faults: Iterable[Fault]) -> list[Fault]:
    """Each fault once; one at an end of what moves only where it is none at the configured values too."""
    every = {str(fault): fault for fault in faults}
    everywhere = {(f.key, str(f.value), f.rule) for f in every.values()}
    return [f for f in every.values() if WHERE not in f.rule or _plain(f) not in everywhere]


def _plain(fault: Fault) -> tuple[str, str, str]:
    return fault.key, str(fault.value), fault.rule.partition(WHERE)[0]


def _seeds(config: Config) -> list[Fault]:
    """Seeds of noise and jitter that are no whole numbers; drawn ones may be: of those the whole part counts."""
    seeds = {n: x for n, x in agvjax.leaves(config.scenario).items() if n.endswith(".seed") and np.ndim(x) == 0}
    bad = {n: float(x) for n, x in seeds.items() if not (x == np.floor(x) and x < MOST_SEED)}
    return [Fault(f"scenario.{n}", x, "a whole number below 2^31") for n, x in bad.items()]


def _correlation(config: Config) -> list[Fault]:
    """Correlations between leaves that are not single numbers, or numbers that are no correlations."""
    correlation, draws = config.ensemble.correlation, config.ensemble.draws or {}
    if correlation is None:
        return []
    several = [n for n in correlation.leaves if np.ndim(agvjax.leaves(config.scenario).get(n, 0.0))]
    try:
        if several:
            raise ValueError(f"{', '.join(several)} must each be a single number")
        correlated(draws, correlation)
    except ValueError as error:
        rule = f"correlations of leaves in [ensemble.draws] ({error})"
        return [Fault("ensemble.correlation", f"{len(correlation.leaves)} leaves", rule)]
    return []


def timing_faults(config: Config, label: str) -> list[Fault]:
    """A step of "simulate", "tune" or "sweep" that does not suit the law, the actuators, the horizon or the control."""
    section, simulate, key = getattr(config, label), config.simulate, f"{label}.dt"
    dt, horizon = section.dt, simulate.horizon
    if dt > 0 and horizon / dt > MOST_STEPS:
        least = told_apart(horizon / MOST_STEPS, dt)
        return [Fault(key, dt, f"at least {least} s: at most {MOST_STEPS:.0g} steps")]
    if wrong := step_faults(config, label):
        return wrong
    steps, interval = horizon / dt, simulate.control_every * simulate.dt
    if not whole(steps):
        return [Fault(key, dt, f"a whole fraction of the horizon, {horizon:g} s")]
    if simulate.control_every > 1 and not whole(interval / dt):
        rule = f"a whole fraction of the control interval, simulate.control_every * simulate.dt = {interval:g} s"
        return [Fault(key, dt, rule)]
    if label == "simulate" and round(steps) % simulate.save_every:
        return [Fault("simulate.save_every", simulate.save_every, f"a divisor of the number of steps, {round(steps)}")]
    return []


def step_faults(config: Config, label: str) -> list[Fault]:
    """A step of "simulate", "tune" or "sweep" that the law or an actuator cannot do with."""
    section, keys = getattr(config, label), {"horizon": "simulate.horizon", "dt": f"{label}.dt"}
    method = agvjax.INTEGRATORS[section.integrator]
    wrong = agvjax.step_faults(config.controller, section.dt, config.simulate.horizon, method, config.scenario)
    return [fault._replace(key=keys.get(fault.key, f"scenario.{fault.key}")) for fault in wrong]
