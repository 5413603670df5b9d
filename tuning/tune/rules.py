"""What is wrong with a tuning problem."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

import agvjax
from agvjax.leaves import element
from agvjax.linear import instants
from agvjax.metric_table import METRICS, metrics_of

from ..config import ends, rules
from ..config.ends import Moving
from ..config.settings import GAINS, Config, Tune
from ..ensemble.rules import undrawable
from .gains import names_of, sets_period
from .methods import method
from .methods.objective import STATISTICS

LEAST_LIMIT = 1e-9


def faults(config: Config) -> list[agvjax.Fault]:
    """What is wrong with a configuration that is to be tuned."""
    found, word = rules.faults(config), config.tune.gains
    if isinstance(word, str):
        found += _word(config.tune)
        if found:
            return rules.unique(found)
        config = dataclasses.replace(config, tune=dataclasses.replace(config.tune, gains=names_of(config)))
    found += _names(config)
    if not found:
        found = rules.timing_faults(config, "tune") + _boxes(config)
    return rules.unique(found)


def _word(tune: Tune) -> list[agvjax.Fault]:
    """A word for gains that means nothing, or that its method cannot do."""
    if tune.gains not in GAINS:
        return [agvjax.Fault("tune.gains", tune.gains, f"a list of names, or one of {', '.join(GAINS)}")]
    if tune.gains == "sensitive" and not method(tune.optimizer).jacobian:
        rule = "names, or all: only tune.optimizer = sqp can predict the benefit of each gain"
        return [agvjax.Fault("tune.gains", tune.gains, rule)]
    return []


def moving(config: Config) -> list[Moving]:
    """What is drawn."""
    return Moving.drawn(config.ensemble.draws)


def _names(config: Config) -> list[agvjax.Fault]:
    """Names in the tuning problem that name nothing, and limits that limit nothing."""
    tune, gains = config.tune, agvjax.leaves(config.controller)
    rule = f"leaves of the controller: {', '.join(gains)}"
    found = [agvjax.Fault("tune.gains", name, rule) for name in tune.gains if element(name)[0] not in gains]
    if not tune.gains:
        rule = "names of gains: this law names none to tune by gradient; tune the law inside it"
        found.append(agvjax.Fault("tune.gains", [], rule))
    if len(set(tune.gains)) < len(tune.gains):
        found.append(agvjax.Fault("tune.gains", list(tune.gains), "distinct names"))
    tuned = (*tune.gains, *tune.tied)
    rule = f"of a gain that is tuned or tied: {', '.join(tuned)}"
    idle = [name for name in tune.bounds if name not in tuned]
    found += [agvjax.Fault(f"tune.bounds.{name}", list(tune.bounds[name]), rule) for name in idle]
    found += _tied(tune, gains) + _requirements(config) + undrawable(config.scenario, config.ensemble.draws)
    if tune.search.scouts < tune.search.starts:
        rule = f"at least tune.search.starts, {tune.search.starts}"
        found.append(agvjax.Fault("tune.search.scouts", tune.search.scouts, rule))
    if config.pareto.low > config.pareto.high:
        found.append(agvjax.Fault("pareto.low", config.pareto.low, f"at most pareto.high, {config.pareto.high:g}"))
    if config.ensemble.fresh and tune.search.rounds:
        found.append(agvjax.Fault("tune.search.rounds", tune.search.rounds, "0 where ensemble.fresh is true"))
    return found + method(tune.optimizer).faults(config)


def _tied(tune: Tune, gains: Any) -> list[agvjax.Fault]:
    """Gains tied to what is not tuned, or tuned themselves."""
    found = []
    for name, which in tune.tied.items():
        if name not in gains or name in tune.gains or np.ndim(gains.get(name, 0.0)):
            found.append(agvjax.Fault(f"tune.tied.{name}", which, "under a single gain of the law that is not tuned"))
        elif which not in tune.gains or not float(gains[which]) > 0 or not float(gains[name]) > 0:
            rule = "the name of a tuned gain, both > 0: the ratio they start with is kept"
            found.append(agvjax.Fault(f"tune.tied.{name}", which, rule))
    return found


def _requirements(config: Config) -> list[agvjax.Fault]:
    """Goals that ask nothing, and limits that nothing can keep."""
    tune, found = config.tune, []
    if not any(weight != 0 for weights in tune.goals.values() for weight in vars(weights).values()):
        found.append(agvjax.Fault("tune.goals", "{}", "at least one statistic of a metric with a weight > 0"))
    asked = [*tune.goals.values(), *(limit for limit in tune.limits.values() if np.isfinite(limit.worst))]
    if tune.search.rounds and not any(part.worst for part in asked):
        rule = "0 if no goal and no limit is on a worst: that is where the scenarios of a round count"
        found.append(agvjax.Fault("tune.search.rounds", tune.search.rounds, rule))
    known = metrics_of(config.scenario, loop=True)
    for key, names in (("goals", tune.goals), ("limits", tune.limits)):
        found += [
            agvjax.Fault(f"tune.{key}.{name}", "asked for", f"absent: {_why_not(name)}")
            for name in names
            if name not in known
        ]
    found += _margins(config)
    for name, limit in tune.limits.items():
        bad = {s: getattr(limit, s) for s in STATISTICS if not getattr(limit, s) >= LEAST_LIMIT}
        for statistic, value in bad.items():
            key = f"tune.limits.{name}" + ("" if len(bad) > 1 and len(set(bad.values())) == 1 else f".{statistic}")
            rule = f">= {LEAST_LIMIT:g}, a ratio to the starting gains or with absolute = true the value; inf for none"
            found.append(agvjax.Fault(key, value, rule))
    return found


def _margins(config: Config) -> list[agvjax.Fault]:
    """Margins of the loop where they mean nothing, or of a run that is too short for them."""
    tune, found = config.tune, []
    rule = "no goal: the distance of a loop from instability can be a limit, in tune.limits"
    found += [agvjax.Fault(f"tune.goals.{name}", "asked for", rule) for name in tune.goals if METRICS[name].loop]
    asked = [name for name in tune.limits if METRICS[name].loop]
    for name in asked:
        if METRICS[name].large and not tune.limits[name].least:
            found.append(agvjax.Fault(f"tune.limits.{name}.least", False, "true: a margin is to be large"))
    if asked and not method(tune.optimizer).jacobian:
        rule = f"sqp: {asked[0]} is not a metric of a run, and other optimizers use only these"
        found.append(agvjax.Fault("tune.optimizer", tune.optimizer, rule))
    if asked:
        try:
            instants(config.controller, config.timing("tune"), config.criteria.late, config.margins.instants)
        except ValueError as error:
            rule = f"fewer, or a longer simulate.horizon: {error}"
            found.append(agvjax.Fault("margins.instants", config.margins.instants, rule))
    return found


def margin_faults(tune: Tune) -> list[agvjax.Fault]:
    """Limits on margins of the loop, for commands that look at runs alone."""
    rule = "a metric of a run: no loop is linearised here"
    return [agvjax.Fault(f"tune.limits.{name}", "asked for", rule) for name in tune.limits if METRICS[name].loop]


def _why_not(metric: str) -> str:
    """Why a scenario does not have a metric."""
    if METRICS[metric].route:
        return rules.NO_ROUTE
    return "this plant's heading cannot be commanded"


def _boxes(config: Config) -> list[agvjax.Fault]:
    """Draws that can draw what their leaf may not hold, and gains that are no single number."""
    found = ends.faults(config, moving(config), ["tune", "simulate"])
    leaves = agvjax.leaves(config.controller)
    several = [name for name in config.tune.gains if not _single(leaves, name)]
    clock = [name for name in config.tune.gains if name not in several and sets_period(config.controller, name)]
    rule = "a gain: control instants, and with them the period, must stay whole multiples of the step"
    found += [agvjax.Fault("tune.gains", name, rule) for name in clock]
    return found + [agvjax.Fault("tune.gains", name, "a single number") for name in several]


def _single(leaves: Mapping[str, Any], name: str) -> bool:
    """Whether a name is that of one number: a leaf, or an element of one that is several."""
    leaf, place = element(name)
    shape = np.shape(leaves[leaf])
    return not shape if place is None else len(shape) == 1 and place < shape[0]
