"""What can only be said of a configuration as a whole: names that name nothing, steps that do not fit, empty wishes."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

import agvjax
from agvjax.protocols import Disturbance, Heading, Law, Path, Plant, Sensor

from ..ensemble.draws import correlated
from .complete import complete
from .imports import classes
from .old import present, warned
from .read import Reader
from .settings import Config
from .write import table_of

MOST_STEPS = 1e8
Rules = Callable[[Config], list[agvjax.Fault]]  # what is wrong with a configuration, of a room


def faults(config: Config) -> list[agvjax.Fault]:
    """What is wrong with law, scenario and step, whatever is done with them."""
    found = agvjax.faults(config)
    scenario, law = config.scenario, config.controller
    heading = [] if scenario.heading is None else scenario.heading.faults(scenario.path)
    found += [fault._replace(key=f"scenario.{fault.key}") for fault in heading]
    found += [fault._replace(key=f"controller.{fault.key}") for fault in law.faults(scenario.plant)]
    if law.control_period() is not None and config.simulate.control_every != 1:
        rule = "1: a sampled law has a period of its own"
        found.append(agvjax.Fault("simulate.control_every", config.simulate.control_every, rule))
    found += _correlation(config)
    return found or timing_faults(config, "simulate")


def check(config: Config, rules: Rules = faults) -> Config:
    """A configuration made in Python, completed and found usable by the `rules` of a room.

    Its settings are read once more from the table that would be written of them, so that a wrong one is refused with
    the words that a file would get, and numbers of NumPy and lists are what they are after a file.

    Raises:
        agvjax.InputError: lists every bad key, its value and the rule.
    """
    if wrong := _foreign(config):
        raise agvjax.InputError(wrong)
    table, writer = table_of(config, settings=True)
    reader = Reader(classes(config.imports))
    bare = Config(controller=config.controller, scenario=config.scenario, imports=config.imports)
    settings, said = reader.config(present(table, warned), bare), {fault.key for fault in writer.faults}
    return checked(settings, rules, writer.faults + [fault for fault in reader.faults if fault.key not in said])


def checked(config: Config, rules: Rules, wrong: list[agvjax.Fault]) -> Config:
    """A configuration with what is `wrong` with its table so far, completed and found usable.

    Raises:
        agvjax.InputError: lists every bad key, its value and the rule.
    """
    config = complete(config)
    if wrong := wrong + rules(config):
        raise agvjax.InputError(wrong)
    return config


def _foreign(config: Config) -> list[agvjax.Fault]:
    """Law and scenario, and the parts of it, that are no such thing."""
    bases = {"controller": Law, "scenario": agvjax.Scenario}
    parts = {name: getattr(config, name) for name in bases}
    if isinstance(config.scenario, agvjax.Scenario):
        more = {"plant": Plant, "path": Path, "disturbance": Disturbance, "heading": Heading, "sensor": Sensor}
        bases |= {f"scenario.{name}": base for name, base in more.items()}
        parts |= {f"scenario.{name}": getattr(config.scenario, name) for name in more}
    none = ("scenario.heading", "scenario.sensor")
    return [
        agvjax.Fault(name, repr(part), f"an agvjax.{bases[name].__name__}: of a class that derives from it")
        for name, part in parts.items()
        if not isinstance(part, bases[name]) and not (part is None and name in none)
    ]


def unique(found: Iterable[agvjax.Fault]) -> list[agvjax.Fault]:
    """Each once."""
    return list({str(fault): fault for fault in found}.values())


def _correlation(config: Config) -> list[agvjax.Fault]:
    """Correlations of what is no single number, or that are none."""
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
        return [agvjax.Fault("ensemble.correlation", f"{len(correlation.leaves)} leaves", rule)]
    return []


def timing_faults(config: Config, label: str) -> list[agvjax.Fault]:
    """A step of "simulate", "tune" or "sweep" that does not suit the law, the actuators, the horizon or the control."""
    section, horizon = getattr(config, label), config.simulate.horizon
    dt, method = section.dt, agvjax.INTEGRATORS[section.integrator]
    found = agvjax.step_faults(config.controller, dt, horizon, method, config.scenario)
    if found:
        keys = {"horizon": "simulate.horizon", "dt": f"{label}.dt"}
        return [p._replace(key=keys.get(p.key, f"scenario.{p.key}")) for p in found]
    count = horizon / dt
    if count > MOST_STEPS:
        return [
            agvjax.Fault(f"{label}.dt", dt, f"at least {horizon / MOST_STEPS:.3g} s: at most {MOST_STEPS:.0g} steps")
        ]
    if abs(count - round(count)) > 1e-6 * count:
        return [agvjax.Fault(f"{label}.dt", dt, f"a whole fraction of the horizon, {horizon:g} s")]
    interval = config.simulate.control_every * config.simulate.dt
    if config.simulate.control_every > 1 and abs(interval / dt - max(round(interval / dt), 1)) > 1e-6 * interval / dt:
        rule = f"a whole fraction of the control interval, simulate.control_every * simulate.dt = {interval:g} s"
        return [agvjax.Fault(f"{label}.dt", dt, rule)]
    if label == "simulate" and round(count) % config.simulate.save_every:
        rule = f"a divisor of the number of steps, {round(count)}"
        return [agvjax.Fault("simulate.save_every", config.simulate.save_every, rule)]
    return []
