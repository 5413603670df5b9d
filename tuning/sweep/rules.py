"""What is wrong with a sweep."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import agvjax
from agvjax import Fault
from agvjax.metric_table import metrics_of

from ..compute.memory import too_much
from ..config import ends, rules
from ..config.ends import LAW, Moving, element_of
from ..config.settings import Config
from ..ensemble.draws import Draw
from ..ensemble.rules import near, undrawable, uneven
from .design import SENSITIVITY, design

MOST_SCENARIOS = 10**9
FEW = 8  # samples of which sensitivities say something


def faults(config: Config) -> list[Fault]:
    """What is wrong with a configuration that is to be swept."""
    wrong = rules.faults(config) or [*_axes(config), *_design(config)]
    wrong = (
        wrong or _size(config) or rules.timing_faults(config, "sweep") or ends.faults(config, moving(config), ["sweep"])
    )
    known = metrics_of(config.scenario)
    asked = {"sweep.metrics": config.sweep.metrics, "sweep.fails": config.sweep.fails}
    wrong += [
        Fault(key, name, f"one of those known{near(name, known)}")
        for key, names in asked.items()
        for name in names
        if name not in known
    ]
    return rules.unique(wrong)


def _axes(config: Config) -> Iterator[Fault]:
    """Axes that cannot be swept."""
    sweep, seen = config.sweep, []
    for table in sweep.over:
        points = {name: span.points for name, span in table.items()}
        if len(set(points.values())) != 1:
            yield Fault(
                "sweep.over", points, "the same number of points for every leaf of one table: they move together"
            )
        for name, span in table.items():
            yield from _axis(config, name, span.draw)
            leaf, element = element_of(name)
            if any(leaf == other and (None in (element, part) or element == part) for other, part in seen):
                yield Fault("sweep.over", name, "named once")
            seen.append((leaf, element))
    if sweep.ensemble:
        draws = config.ensemble.draws
        yield from undrawable(config.scenario, draws)
    elif not sweep.over:
        yield Fault("sweep.over", "[]", "at least one leaf, or ensemble = true")


def _design(config: Config) -> Iterator[Fault]:
    """Axes and numbers of samples that a method of sensitivity cannot do with."""
    sweep, saltelli = config.sweep, config.sweep.design == "saltelli"
    if sweep.design not in SENSITIVITY:
        return
    if sweep.ensemble and config.ensemble.correlation is not None:
        rule = "random, sobol or latin: this method needs independent leaves, and ensemble.correlation ties them"
        yield Fault("sweep.design", sweep.design, rule)
    gridded = any(span.points for table in sweep.over for span in table.values())
    if gridded or not (sweep.ensemble or sweep.over):
        rule = f"random, sobol or latin where there is a grid: {sweep.design} needs every leaf without points"
        yield Fault("sweep.design", sweep.design, rule)
    if sweep.samples < FEW or (saltelli and sweep.samples & (sweep.samples - 1)):
        rule = f"at least {FEW}" + (" and a power of two" if saltelli else "")
        yield Fault("sweep.samples", sweep.samples, f"{rule}, for {sweep.design}")


def _size(config: Config) -> list[Fault]:
    plan, sweep = design(config), config.sweep
    if plan.size > MOST_SCENARIOS:
        return [Fault("sweep", plan.size, f"at most {MOST_SCENARIOS:g} scenarios in all")]
    numbers = (1 + len(sweep.metrics) + len(sweep.fails)) * (1 + len(sweep.controllers))
    numbers += sum(plan.nominal(leaf).size for leaf in plan.names)
    numbers += 3 * len(plan.sampled) * (sweep.design not in ("random", "sobol"))  # a design that is made as a whole
    if not (much := too_much(plan.size * numbers * config.precision / 8)):
        return []
    key, value = ("sweep.samples", sweep.samples) if plan.sampled else ("sweep.over", f"{plan.size} points")
    return [Fault(key, value, f"fewer: the results of {plan.size} scenarios take {much}")]


def _axis(config: Config, name: str, draw: Draw) -> list[Fault]:
    """What is wrong with one leaf of an axis."""
    leaf, element = element_of(name)
    lawful = leaf.startswith(LAW)
    tree, inner = (config.controller, leaf.removeprefix(LAW)) if lawful else (config.scenario, leaf)
    known = agvjax.leaves(tree)
    if inner not in known:
        every = [*agvjax.leaves(config.scenario), *(LAW + gain for gain in agvjax.leaves(config.controller))]
        return [Fault("sweep.over", name, f"a leaf of the scenario, or controller. and a gain{near(leaf, every)}")]
    nominal = np.asarray(known[inner], float)
    if element is not None and (nominal.ndim != 1 or element >= nominal.size):
        return [Fault("sweep.over", name, f"an element of {leaf}, which has the shape {nominal.shape}")]
    wrong = uneven(f"sweep.over.{name}", draw, nominal.shape if element is None else ())
    return [] if wrong is None else [wrong]


def moving(config: Config) -> list[Moving]:
    """What is swept, and what is drawn besides."""
    axes = [Moving("sweep.over", table) for table in config.sweep.over]
    swept = {element_of(name)[0] for axis in axes for name in axis.spans}
    draws = config.ensemble.draws if config.sweep.ensemble else {}
    return axes + Moving.drawn({name: draw for name, draw in draws.items() if name not in swept})
