"""What can only be said of a configuration as a whole: names that name nothing, steps that do not fit, empty wishes."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any

import numpy as np

import agvjax

from .ensemble import Draw, box
from .first_order import find_optimizer
from .objective import STATISTICS, metrics_of
from .optimise import SEQUENTIAL
from .settings import EXPORTS, Config, Tune
from .sweep.design import LAW, SENSITIVITY, design, element_of

UNTUNED = ("simulate", "identify", "export")  # commands without a tuning problem
MOST_STEPS = 1e8
LEAST_LIMIT = 1e-9
MOST_SCENARIOS = 10**9
FEW = 8  # samples of which sensitivities say something


def problems(config: Config, command: str) -> list[agvjax.Problem]:
    """What can only be said of the whole; what only ensembles and tuning need is not asked for "simulate"."""
    found = agvjax.problems(config)
    if config.precision not in (32, 64):
        found.append(agvjax.Problem("precision", config.precision, "32 or 64"))
    if isinstance(config.scenario.heading, agvjax.Bearing) and not hasattr(config.scenario.path, "bearing"):
        rule = "tangent or a raw bearing: this path has no smooth bearing"
        found.append(agvjax.Problem("scenario.heading", "bearing", rule, "reading R8"))
    found += _computer(config)
    if not found:
        found += _timing(config, "simulate", config.simulate)
    if command == "sweep":
        found += _swept(config) if not found else []
        found += _timing(config, "sweep", config.sweep) if not found else []
        found += _wished(config)
    elif command not in UNTUNED:
        found += _names(config)
        if not found:
            found += _timing(config, "tune", config.tune) + _boxes(config)
    return list({str(problem): problem for problem in found}.values())


def _computer(config: Config) -> list[agvjax.Problem]:
    """A law on a computer of its own that takes the vehicle for another kind."""
    law, plant, found = config.controller, config.scenario.plant, []
    if not hasattr(law, "vehicle"):
        return found
    if law.vehicle.actuators != plant.actuators:
        rule = f"a vehicle with the actuators of scenario.plant, {', '.join(plant.actuators)}"
        found.append(agvjax.Problem("controller.vehicle", type(law.vehicle).__name__, rule))
    limits = getattr(law.anti_windup, "limits", None)
    if limits is not None and np.size(limits) != len(law.vehicle.actuators):
        rule = f"one for each of {', '.join(law.vehicle.actuators)}"
        found.append(agvjax.Problem("controller.anti_windup.limits", np.asarray(limits).tolist(), rule))
    if config.simulate.control_every != 1:
        rule = "1: a sampled law has a period of its own"
        found.append(agvjax.Problem("simulate.control_every", config.simulate.control_every, rule))
    return found


def _timing(config: Config, label: str, section: Any) -> list[agvjax.Problem]:
    horizon, dt = config.simulate.horizon, section.dt
    method = agvjax.INTEGRATORS[section.integrator]
    found = agvjax.step_problems(config.controller, dt, horizon, method, config.scenario)
    if found:
        keys = {"horizon": "simulate.horizon", "dt": f"{label}.dt"}
        return [p._replace(key=keys.get(p.key, f"scenario.{p.key}")) for p in found]
    count = horizon / dt
    if count > MOST_STEPS:
        return [
            agvjax.Problem(f"{label}.dt", dt, f"at least {horizon / MOST_STEPS:.3g} s: at most {MOST_STEPS:.0g} steps")
        ]
    if abs(count - round(count)) > 1e-6 * count:
        return [agvjax.Problem(f"{label}.dt", dt, f"a whole fraction of the horizon, {horizon:g} s")]
    if label == "simulate" and round(count) % config.simulate.save_every:
        rule = f"a divisor of the number of steps, {round(count)}"
        return [agvjax.Problem("simulate.save_every", config.simulate.save_every, rule)]
    return []


def _names(config: Config) -> list[agvjax.Problem]:
    """Names in the tuning problem that name nothing, and limits that limit nothing."""
    tune, found = config.tune, []
    gains = agvjax.leaves(config.controller)
    for name in tune.gains:
        if name not in gains:
            found.append(agvjax.Problem("tune.gains", name, f"leaves of the controller: {', '.join(gains)}"))
    if not tune.gains:
        rule = "names of gains: this law names none to tune by gradient; tune the law inside it"
        found.append(agvjax.Problem("tune.gains", [], rule))
    if len(set(tune.gains)) < len(tune.gains):
        found.append(agvjax.Problem("tune.gains", list(tune.gains), "names that differ"))
    for name, pair in tune.bounds.items():
        if name not in tune.gains:
            found.append(agvjax.Problem(f"tune.bounds.{name}", list(pair), "of a tuned gain, one of tune.gains"))
    found += _tied(tune, gains) + _requirements(config) + _draws(config)
    if tune.search.scouts < tune.search.starts:
        rule = f"at least tune.search.starts, {tune.search.starts}"
        found.append(agvjax.Problem("tune.search.scouts", tune.search.scouts, rule))
    if config.pareto.low > config.pareto.high:
        found.append(agvjax.Problem("pareto.low", config.pareto.low, f"at most pareto.high, {config.pareto.high:g}"))
    if config.ensemble.fresh and tune.search.rounds:
        found.append(agvjax.Problem("tune.search.rounds", tune.search.rounds, "0 where ensemble.fresh is true"))
    for name in tune.choices:
        if not name.startswith("controller"):
            found.append(agvjax.Problem(f"tune.choices.{name}", tune.choices[name], "of a key of the controller"))
    if tune.choices and tune.search.rounds:
        found.append(agvjax.Problem("tune.search.rounds", tune.search.rounds, "0 where tune.choices are given"))
    if tune.optimizer == SEQUENTIAL:
        if tune.gradient == "reverse":
            found.append(
                agvjax.Problem("tune.gradient", tune.gradient, f"forward: {SEQUENTIAL} needs the whole Jacobian")
            )
        if tune.options:
            found.append(agvjax.Problem("tune.options", dict(tune.options), f"empty: {SEQUENTIAL} has none"))
        if config.ensemble.fresh:
            rule = f"false: {SEQUENTIAL} needs the same scenarios every iteration; an optimiser of optax does not"
            found.append(agvjax.Problem("ensemble.fresh", "true", rule))
        return found
    try:
        find_optimizer(tune.optimizer)(1.0, **tune.options)
    except Exception as error:  # optax and its optimisers raise whatever they meet
        rule = f"{SEQUENTIAL}, or an optimiser of optax that takes a learning rate, and options it knows ({error})"
        found.append(agvjax.Problem("tune.optimizer", tune.optimizer, rule))
    return found


def _draws(config: Config) -> list[agvjax.Problem]:
    """Draws of what is no leaf of the scenario."""
    leaves = agvjax.leaves(config.scenario)
    found = [
        agvjax.Problem("ensemble.draws", name, f"a leaf of the scenario{_near(name, leaves)}")
        for name in config.ensemble.draws
        if name not in leaves
    ]
    if not config.ensemble.draws:
        found.append(agvjax.Problem("ensemble.draws", "{}", "at least one leaf of the scenario"))
    return found


def _near(name: str, known: Iterable[str]) -> str:
    """A hint after a rule."""
    near = difflib.get_close_matches(name, list(known), 1, 0.5)
    return f"; did you mean {near[0]}?" if near else f": {', '.join(known)}"


def _tied(tune: Tune, gains: Any) -> list[agvjax.Problem]:
    """Gains tied to what is not tuned, or tuned themselves."""
    found = []
    for name, which in tune.tied.items():
        if name not in gains or name in tune.gains or np.ndim(gains.get(name, 0.0)):
            found.append(agvjax.Problem(f"tune.tied.{name}", which, "under a single gain of the law that is not tuned"))
        elif which not in tune.gains or not float(gains[which]) > 0 or not float(gains[name]) > 0:
            rule = "the name of a tuned gain, both > 0: the ratio they start with is kept"
            found.append(agvjax.Problem(f"tune.tied.{name}", which, rule))
    return found


def _requirements(config: Config) -> list[agvjax.Problem]:
    """Goals that ask nothing, and limits that nothing can keep."""
    tune, found = config.tune, []
    if not any(weight != 0 for weights in tune.goals.values() for weight in vars(weights).values()):
        found.append(agvjax.Problem("tune.goals", "{}", "at least one statistic of a metric with a weight > 0"))
    asked = [*tune.goals.values(), *(limit for limit in tune.limits.values() if np.isfinite(limit.worst))]
    if tune.search.rounds and not any(part.worst for part in asked):
        rule = "0 where no goal and no limit is on a worst: what a round adds counts there"
        found.append(agvjax.Problem("tune.search.rounds", tune.search.rounds, rule))
    known = metrics_of(config.scenario.plant)
    for key, names in (("goals", tune.goals), ("limits", tune.limits)):
        found += [
            agvjax.Problem(f"tune.{key}.{name}", "asked for", "absent: this plant's heading cannot be commanded")
            for name in names
            if name not in known
        ]
    for name, limit in tune.limits.items():
        bad = {s: getattr(limit, s) for s in STATISTICS if not getattr(limit, s) >= LEAST_LIMIT}
        for statistic, value in bad.items():
            key = f"tune.limits.{name}" + ("" if len(bad) > 1 and len(set(bad.values())) == 1 else f".{statistic}")
            rule = f">= {LEAST_LIMIT:g}, a ratio to the starting gains or with absolute = true the value; inf for none"
            found.append(agvjax.Problem(key, value, rule))
    return found


def _boxes(config: Config) -> list[agvjax.Problem]:
    """Draws that can draw what their leaf may not hold, and gains that are no single number."""
    found = _drawn_ends(config)
    for name in config.tune.gains:
        if np.ndim(agvjax.leaves(config.controller)[name]):
            found.append(agvjax.Problem("tune.gains", name, "a single number"))
    return found


def _drawn_ends(config: Config) -> list[agvjax.Problem]:
    """Ends of the draws that their leaf may not hold."""
    found = []
    for name, draw in config.ensemble.draws.items():
        nominal = np.asarray(agvjax.leaves(config.scenario)[name], float)
        found += _ends(config.scenario, name, box(draw, nominal), f"ensemble.draws.{name}")
    return found


def _ends(tree: Any, name: str, ends: Iterable[Any], key: str) -> list[agvjax.Problem]:
    """Values that a leaf may not hold."""
    bad = [p for end in ends for p in agvjax.problems(agvjax.replace(tree, {name: end})) if p.key == name]
    return [p._replace(key=key) for p in bad]


def _swept(config: Config) -> list[agvjax.Problem]:
    """Axes that cannot be swept, and wishes that name nothing."""
    sweep, found, seen = config.sweep, [], []
    if sweep.ensemble and config.ensemble.correlation is not None and sweep.design in SENSITIVITY:
        rule = "random, sobol or latin: this method takes leaves for independent that ensemble.correlation ties"
        found.append(agvjax.Problem("sweep.design", sweep.design, rule))
    for table in sweep.over:
        if len({span.points for span in table.values()}) != 1:
            shown = {name: span.points for name, span in table.items()}
            found.append(
                agvjax.Problem("sweep.over", shown, "as many points for every leaf of one table: they move as one")
            )
        for name, span in table.items():
            leaf, element = element_of(name)
            found += _axis(config, name, span.draw)
            if any(
                leaf == other and None in (element, which) or (leaf, element) == (other, which) for other, which in seen
            ):
                found.append(agvjax.Problem("sweep.over", name, "named once"))
            seen.append((leaf, element))
    grid = [table for table in sweep.over if next(iter(table.values())).points]
    if sweep.ensemble:
        unknown = _draws(config)
        found += unknown or _drawn_ends(config)
    elif not sweep.over:
        found.append(agvjax.Problem("sweep.over", "[]", "at least one leaf, or ensemble = true"))
    if sweep.design in SENSITIVITY and (grid or not (sweep.ensemble or sweep.over)):
        rule = f"random, sobol or latin where there is a grid: {sweep.design} needs every leaf without points"
        found.append(agvjax.Problem("sweep.design", sweep.design, rule))
    if sweep.design in SENSITIVITY:
        few, even = sweep.samples < FEW, sweep.samples & (sweep.samples - 1)
        if few or (even and sweep.design == "saltelli"):
            rule = f"at least {FEW}" + (" and a power of two" if sweep.design == "saltelli" else "")
            found.append(agvjax.Problem("sweep.samples", sweep.samples, f"{rule}, for {sweep.design}"))
    if not found and design(config).size > MOST_SCENARIOS:
        found.append(agvjax.Problem("sweep", design(config).size, f"at most {MOST_SCENARIOS:g} scenarios in all"))
    return found


def _wished(config: Config) -> list[agvjax.Problem]:
    """Names that a sweep asks for and nobody knows."""
    sweep, found, metrics = config.sweep, [], metrics_of(config.scenario.plant)
    for key, given, known in (
        ("metrics", sweep.metrics, metrics),
        ("fails", tuple(sweep.fails), metrics),
        ("export", sweep.export, EXPORTS),
    ):
        found += [
            agvjax.Problem(f"sweep.{key}", x, f"one of those known{_near(x, known)}") for x in given if x not in known
        ]
    return found


def _axis(config: Config, name: str, draw: Draw) -> list[agvjax.Problem]:
    """What is wrong with one leaf of an axis."""
    leaf, element = element_of(name)
    lawful = leaf.startswith(LAW)
    tree, inner = (config.controller, leaf.removeprefix(LAW)) if lawful else (config.scenario, leaf)
    known = agvjax.leaves(tree)
    if inner not in known:
        every = [*agvjax.leaves(config.scenario), *(LAW + gain for gain in agvjax.leaves(config.controller))]
        return [
            agvjax.Problem("sweep.over", name, f"a leaf of the scenario, or controller. and a gain{_near(leaf, every)}")
        ]
    nominal = np.asarray(known[inner], float)
    if element is not None and (nominal.ndim != 1 or element >= nominal.size):
        return [agvjax.Problem("sweep.over", name, f"an element of {leaf}, which has the shape {nominal.shape}")]
    part = nominal if element is None else nominal[element]
    ends = box(draw, part)
    if element is not None:
        ends = tuple(np.where(np.arange(nominal.size) == element, end, nominal) for end in ends)
    found = _ends(tree, inner, ends, f"sweep.over.{name}")
    if found or not lawful:
        return found
    step, method = config.sweep.dt, agvjax.INTEGRATORS[config.sweep.integrator]
    for end in ends:
        moved = agvjax.replace(tree, {inner: end})
        found += agvjax.step_problems(moved, step, config.simulate.horizon, method)
    return [p._replace(key=f"sweep.dt, with {name} at an end of its axis") for p in found[:1]]
