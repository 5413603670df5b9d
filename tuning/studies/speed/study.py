"""The highest speed at which the worst vehicle stays near its route: gains tuned at one speed after another.

A speed is a factor: it multiplies the speed of the route, and its square the lateral acceleration that the route's
limits allow; what it may speed up and slow down with stays. Only numbers of route and law change with it, so the
gradient is compiled once for all speeds.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

import agvjax
from agvjax.leaves import cast, swap

from ...compute.compiled import Ahead, meanwhile
from ...config import dump
from ...config.routes import faster
from ...config.rules import timing_faults
from ...config.settings import Config
from ...io.kept import Kept
from ...tune.finer import validation
from ...tune.methods.method import Progress
from ...tune.problem import TuningProblem, in_units_of, pose, starts
from ...tune.tuner import Tuner
from .tried import Tried, answer

LONGER = 1.25  # times what the profile takes for the route: laws slow down in turns that they steer
WITHIN_PIECE = (0.02, 0.5, 0.98)  # shares of a piece at which a profile is looked at: its curvature may jump at knots


def at(config: Config, factor: float) -> Config:
    """The configuration at a speed: another profile over the same route, and a law that wants it."""
    route: Any = config.scenario.path
    scenario = dataclasses.replace(config.scenario, path=faster(route, factor))
    return dataclasses.replace(config, scenario=scenario, controller=config.controller.faster(factor))


def late(config: Config, factor: float) -> float:
    """From when on [s] distances count: the start is over after the same way at every speed."""
    return config.speed.after / factor


def long_enough(config: Config) -> Config:
    """The configuration with runs that at the slowest speed see the whole route after the start."""
    slowest: Any = at(config, config.speed.low).scenario.path
    need = LONGER * float(np.asarray(slowest.instants)[-1]) + late(config, config.speed.low)
    given = config.simulate.horizon
    for unit in (1.0, given):  # a multiple of what was given suits every step
        horizon = max(given, unit * math.ceil(need / unit))
        longer = dataclasses.replace(config, simulate=dataclasses.replace(config.simulate, horizon=horizon))
        if not any(timing_faults(longer, name) for name in ("tune", "simulate")):
            return longer
    return config


def fastest(route: agvjax.Route) -> tuple[float, float]:
    """The highest speed [m/s] of a route's profile, and the largest lateral acceleration [m/s^2]."""
    begins, pace, first, _, _ = (np.asarray(row) for row in route.legs)
    piece = np.repeat(np.arange(route.squares.shape[1]), len(WITHIN_PIECE))
    leg = np.searchsorted(first, piece, side="right") - 1
    share = np.tile(WITHIN_PIECE, route.squares.shape[1])
    arc = begins[leg] + (piece - first[leg] + share) / pace[leg]
    place = _places(dataclasses.replace(route, made=""), arc, leg.astype(arc.dtype))
    squares = np.asarray(place.speed) ** 2
    top = np.asarray(route.squares).sum(axis=0).max(), np.asarray(route.squares)[0].max()
    return float(np.sqrt(max(top))), float(np.max(squares * np.abs(np.asarray(place.curvature))))


@jax.jit
def _places(route: agvjax.Route, arc: Array, leg: Array) -> Any:
    return jax.vmap(route.at)(arc, leg)


class Study:
    """The tuning problem at any speed, compiled once."""

    def __init__(self, config: Config):
        self.config, problem = config, pose(config)
        self.names = problem.tuner.gains.names
        tuner, settings = problem.tuner, dump(dataclasses.replace(config, seed=0))
        numbers, self.structure = jax.tree.flatten(_moved(tuner))

        def changed(numbers: list[Array]) -> Tuner:
            return _changed(tuner, *jax.tree.unflatten(self.structure, numbers))

        z = tuner.gains.coordinates(tuner.controller)
        self.jacobian = self.values = None
        if tuner.forward:
            example = (numbers, z, tuner.scenarios())
            self.jacobian = Ahead(lambda n, z, s: changed(n).jacobian(z, s), settings + "speed", *example)
        if problem.screen is not None:
            looked = problem.screen.example()
            self.values = Ahead(lambda n, z, s: changed(n).values(z, s), settings + "speeds", numbers, *looked)
        meanwhile(self.judged, config, 1.0, tuner.controller)

    def problem(self, factor: float) -> TuningProblem:
        """The tuning problem at a speed: its goals and limits are multiples of what the configured gains do there."""
        problem = pose(at(self.config, factor))
        tuner = problem.tuner
        numbers, structure = jax.tree.flatten(_moved(tuner))
        if structure != self.structure:
            raise RuntimeError("the route has other pieces at this speed")
        if self.jacobian is not None:
            tuner = dataclasses.replace(tuner, compiled=partial(self.jacobian, numbers))
        screen = problem.screen
        if screen is not None and self.values is not None:
            screen = dataclasses.replace(screen, tuner=tuner, compiled=partial(self.values, numbers))
        return problem._replace(tuner=tuner, screen=screen)

    def judged(self, config: Config, factor: float, law: agvjax.Law) -> agvjax.Metrics:
        """Metrics of the vehicles not tuned on, at the step of `simulate`."""
        plain, criteria = _plain(config), agvjax.Criteria(late=late(config, factor))
        found = agvjax.evaluate(agvjax.check(law), validation(plain), criteria=criteria, **config.timing())
        return jax.tree.map(np.asarray, found)

    def tune(self, factor: float, near: Tried | None) -> Tried:
        """A speed tried: tuned from what a look at many gain sets finds best and from the gains of a speed nearby."""
        try:
            problem = self.problem(factor)
            problem, found, iterations = _tuned(problem, near)
            if np.isinf(found.best[1]):
                raise RuntimeError("no gradient was usable")
        except jax.errors.JaxRuntimeError:
            raise
        except RuntimeError as error:
            return _lost(at(self.config, factor), factor, str(error))
        return self._judge(problem, factor, found, iterations)

    def _judge(self, problem: TuningProblem, factor: float, found: Progress, iterations: int) -> Tried:
        config, tuner = problem.config, problem.tuner
        route: Any = config.scenario.path
        before, after = (self.judged(config, factor, law) for law in (tuner.controller, tuner.best(found)))
        ok = np.asarray(after.ok)
        away, outside = (np.asarray(after[name]) for name in ("cross_track_peak_late", "corridor_excess_late"))
        (speed, lateral), horizon, length = fastest(route), config.simulate.horizon, float(route.length)
        pace, done = (np.asarray(after[name])[ok] for name in ("pace", "time_to_finish"))
        seen = length * pace <= horizon if route.closed else np.isfinite(done)
        driven = np.where(np.isfinite(done), length / done, 1 / pace)  # at its end a vehicle stands
        return Tried(
            factor=factor,
            speed=speed,
            lateral=lateral,
            driven=float(np.mean(driven)) if ok.any() else 0.0,
            worst=float(away.max()),
            mean=float(away.mean()),
            outside=float(outside.max()),
            start=float(np.max(before["cross_track_peak_late"])),
            diverged=int(np.sum(~ok)),
            short=int(np.sum(~seen)),
            excess=found.best[0],
            iterations=iterations,
            vehicle=int(np.argmax(outside if outside.max() > 0 and not config.speed.within else away)),
            z=tuple(np.asarray(found.best_z, float).tolist()),
            gains=tuple(tuner.gains.values(found.best_z, tuner.controller)),
        )

    def law(self, tried: Tried) -> agvjax.Law:
        """The tuned law at a speed."""
        tuner = self.problem(tried.factor).tuner
        return tuner.gains.controller(jnp.asarray(tried.z), tuner.controller)

    def drive(self, tried: Tried) -> agvjax.Trajectory:
        """The run of the vehicle that binds at a speed, every step of it."""
        config = _plain(at(self.config, tried.factor))
        vehicle = validation(config)[tried.vehicle]
        law = agvjax.check(self.law(tried))
        return agvjax.simulate(law, cast(vehicle, jnp.result_type(float)), **config.timing())


def search(study: Study, kept: Kept[Tried], begin: Callable[[float], None]) -> list[Tried]:
    """All speeds tried: a grid, outward from the configured speed, then halves of the gap in which the answer lies.

    Args:
        study: the problem.
        kept: what was tried before, which grows.
        begin: called with every factor before it is tried.
    """
    settings, tried = study.config.speed, []

    def look(factor: float) -> None:
        begin(factor)
        sound = [t for t in tried if not t.why]
        near = min(sound, key=lambda t: abs(np.log(t.factor / factor)), default=None)
        tried.append(kept.once(f"{factor:.6f}", lambda: study.tune(factor, near)))

    for factor in sorted(np.geomspace(settings.low, settings.high, settings.points).tolist(), key=_away):
        look(factor)
    for _ in range(settings.halvings):
        best, above = answer(tried, settings.within)
        if best is None or above is None:
            break
        look(math.sqrt(best.factor * above.factor))
    return sorted(tried)


def _away(factor: float) -> float:
    return abs(math.log(factor))


def _tuned(problem: TuningProblem, near: Tried | None) -> tuple[TuningProblem, Progress, int]:
    """The problem, its goals and limits in units that are finite, the best search, and iterations in all."""
    tuner, places, seen = problem.tuner, [np.asarray(z) for z in starts(problem)], None
    if problem.screen is not None:
        seen = problem.screen.look()
        places = list(seen.apart(problem.config.tune.starts))
        problem = in_units_of(problem, seen.unit)
        tuner = problem.tuner
    if near is not None:
        places.append(np.asarray(near.z))
    done = []
    for place in places:
        progress = tuner.begin(jnp.asarray(place, jnp.result_type(float)))
        while not tuner.finished(progress):
            progress = tuner.advance(progress)
        done.append(progress)
    best, iterations = min(done, key=lambda p: p.best), sum(p.iteration for p in done)
    if seen is not None and np.isinf(best.best[1]):  # no gradient was usable
        excess, goal = (float(x) for x in seen.ranks[0])
        best = best._replace(best_z=jnp.asarray(seen.places[0]), best=(excess, goal))
    return problem, best, iterations


def _lost(config: Config, factor: float, why: str) -> Tried:
    """A speed at which nothing can be tuned."""
    route: Any = config.scenario.path
    infinite = dict.fromkeys(("worst", "mean", "outside", "start", "excess"), math.inf)
    counts = dict.fromkeys(("diverged", "short"), config.ensemble.validation_size) | {"iterations": 0, "vehicle": 0}
    speed, lateral = fastest(route)
    return Tried(factor, speed, lateral, 0.0, **infinite, **counts, z=(), gains=(), why=why)


def _plain(config: Config) -> Config:
    """The configuration without the table that its route was laid of, which JAX takes for a part of the program."""
    route: Any = config.scenario.path
    scenario = dataclasses.replace(config.scenario, path=dataclasses.replace(route, made=""))
    return dataclasses.replace(config, scenario=scenario)


def _moved(tuner: Tuner) -> tuple[PyTree, PyTree]:
    """Law and route: what differs from speed to speed."""
    route = dataclasses.replace(tuner.batch.scenario.path, made="")
    return cast((tuner.controller, route), jnp.result_type(float))


def _changed(tuner: Tuner, law: PyTree, route: PyTree) -> Tuner:
    """The tuner with another law and route."""
    scenario = swap(tuner.batch.scenario, {"path": route})
    return dataclasses.replace(tuner, controller=law, batch=dataclasses.replace(tuner.batch, scenario=scenario))
