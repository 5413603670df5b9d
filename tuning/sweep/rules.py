"""What is wrong with a sweep."""

from __future__ import annotations

import numpy as np

import agvjax
from agvjax.metric_table import metrics_of

from ..config import rules
from ..config.settings import Config
from ..ensemble.draws import Draw
from ..ensemble.rules import beyond_rules, ends_beyond_rules, near, undrawable
from .design import LAW, SENSITIVITY, design, element_of

MOST_SCENARIOS = 10**9


FEW = 8  # samples of which sensitivities say something


def faults(config: Config) -> list[agvjax.Fault]:
    """What is wrong with a configuration that is to be swept."""
    found = rules.faults(config)
    found += _swept(config) if not found else []
    found += rules.timing_faults(config, "sweep") if not found else []
    return rules.unique(found + _wished(config))


def _swept(config: Config) -> list[agvjax.Fault]:
    """Axes that cannot be swept, and wishes that name nothing."""
    sweep, found, seen = config.sweep, [], []
    if sweep.ensemble and config.ensemble.correlation is not None and sweep.design in SENSITIVITY:
        rule = "random, sobol or latin: this method takes leaves for independent that ensemble.correlation ties"
        found.append(agvjax.Fault("sweep.design", sweep.design, rule))
    for table in sweep.over:
        if len({span.points for span in table.values()}) != 1:
            shown = {name: span.points for name, span in table.items()}
            found.append(
                agvjax.Fault("sweep.over", shown, "as many points for every leaf of one table: they move as one")
            )
        for name, span in table.items():
            leaf, element = element_of(name)
            found += _axis(config, name, span.draw)
            if any(
                leaf == other and None in (element, which) or (leaf, element) == (other, which) for other, which in seen
            ):
                found.append(agvjax.Fault("sweep.over", name, "named once"))
            seen.append((leaf, element))
    grid = [table for table in sweep.over if next(iter(table.values())).points]
    if sweep.ensemble:
        unknown = undrawable(config.scenario, config.ensemble.draws)
        found += unknown or beyond_rules(config.scenario, config.ensemble.draws)
    elif not sweep.over:
        found.append(agvjax.Fault("sweep.over", "[]", "at least one leaf, or ensemble = true"))
    if sweep.design in SENSITIVITY and (grid or not (sweep.ensemble or sweep.over)):
        rule = f"random, sobol or latin where there is a grid: {sweep.design} needs every leaf without points"
        found.append(agvjax.Fault("sweep.design", sweep.design, rule))
    if sweep.design in SENSITIVITY:
        few, even = sweep.samples < FEW, sweep.samples & (sweep.samples - 1)
        if few or (even and sweep.design == "saltelli"):
            rule = f"at least {FEW}" + (" and a power of two" if sweep.design == "saltelli" else "")
            found.append(agvjax.Fault("sweep.samples", sweep.samples, f"{rule}, for {sweep.design}"))
    if not found and design(config).size > MOST_SCENARIOS:
        found.append(agvjax.Fault("sweep", design(config).size, f"at most {MOST_SCENARIOS:g} scenarios in all"))
    return found


def _wished(config: Config) -> list[agvjax.Fault]:
    """Names that a sweep asks for and nobody knows."""
    sweep, found, metrics = config.sweep, [], metrics_of(config.scenario.plant)
    for key, given, known in (
        ("metrics", sweep.metrics, metrics),
        ("fails", tuple(sweep.fails), metrics),
    ):
        found += [
            agvjax.Fault(f"sweep.{key}", x, f"one of those known{near(x, known)}") for x in given if x not in known
        ]
    return found


def _axis(config: Config, name: str, draw: Draw) -> list[agvjax.Fault]:
    """What is wrong with one leaf of an axis."""
    leaf, element = element_of(name)
    lawful = leaf.startswith(LAW)
    tree, inner = (config.controller, leaf.removeprefix(LAW)) if lawful else (config.scenario, leaf)
    known = agvjax.leaves(tree)
    if inner not in known:
        every = [*agvjax.leaves(config.scenario), *(LAW + gain for gain in agvjax.leaves(config.controller))]
        return [
            agvjax.Fault("sweep.over", name, f"a leaf of the scenario, or controller. and a gain{near(leaf, every)}")
        ]
    nominal = np.asarray(known[inner], float)
    if element is not None and (nominal.ndim != 1 or element >= nominal.size):
        return [agvjax.Fault("sweep.over", name, f"an element of {leaf}, which has the shape {nominal.shape}")]
    part = nominal if element is None else nominal[element]
    ends = draw.box(part)
    if element is not None:
        ends = tuple(np.where(np.arange(nominal.size) == element, end, nominal) for end in ends)
    found = ends_beyond_rules(tree, inner, ends, f"sweep.over.{name}")
    if found or not lawful:
        return found
    step, method = config.sweep.dt, agvjax.INTEGRATORS[config.sweep.integrator]
    for end in ends:
        moved = agvjax.replace(tree, {inner: end})
        found += agvjax.step_faults(moved, step, config.simulate.horizon, method)
    return [p._replace(key=f"sweep.dt, with {name} at an end of its axis") for p in found[:1]]
