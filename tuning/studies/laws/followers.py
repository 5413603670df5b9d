"""Which law follows a route best? Each in the same computer, tuned on the same vehicles within the same limits.

Limits and goals are multiples of what one law, the configured one, achieves with its starting gains: so every law may
vary its command and take its time by as much as every other.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

import agvjax

from ...compute.compiled import traced
from ...compute.pairs import in_pairs
from ...config import dump
from ...config.settings import Config
from ...io.kept import Kept
from ...tune.caveats import excesses
from ...tune.finer import judged, validation
from ...tune.problem import TuningProblem, pose
from .study import PLACES

LABELS = {
    "regulated_pure_pursuit": "regulated pure pursuit",
    "path_pid": "PID",
    "stanley": "Stanley",
    "path_lqr": "LQR",
    "velocity_reference": "the paper's law, by a velocity reference",
}


class Searched(NamedTuple):
    """What searches found; the fields are those of `Tuned`."""

    z: tuple[float, ...]  # coordinates of the gains
    excess: float
    searches: int
    jacobians: int
    rollouts: int


class Tuned(NamedTuple):
    """One law before and after."""

    start: agvjax.Law
    controller: agvjax.Law
    gains: tuple[str, ...]
    excess: float  # sum of what limits are exceeded by, on the tuning scenarios; 0: all are met
    searches: int
    jacobians: int
    rollouts: int  # of the whole ensemble, the look at many gain sets among them
    over: list[str]  # limits that are exceeded on scenarios that no law was tuned on, each with by how much
    before: agvjax.Metrics  # on these
    after: agvjax.Metrics


def faults(config: Config) -> list[agvjax.Fault]:
    """What the comparison needs of a configuration whose law follows a route."""
    if not isinstance(config.controller, agvjax.Sampled):
        rule = "sampled: laws that follow a route are compared in the same computer"
        return [agvjax.Fault("controller", type(config.controller).__name__, rule)]
    found = []
    if isinstance(config.tune.gains, str):
        found.append(
            agvjax.Fault("tune.gains", config.tune.gains, "names of gains, or left out: each law names its own")
        )
    if config.tune.search.rounds:
        rule = "0: here no worst scenario is searched for"
        found.append(agvjax.Fault("tune.search.rounds", config.tune.search.rounds, rule))
    return found


def laws(config: Config) -> dict[str, agvjax.Sampled]:
    """The laws that are compared, in the configured computer, those that take longest first."""
    given: Any = config.controller
    route: Any = config.scenario.path
    period, top = float(given.period), float(np.sqrt(np.asarray(route.squares).sum(axis=0).max()))
    inner = agvjax.NeuroBackstepping(k1=1.5, k2=3.0, Lam=1.0, omega_n=10.0)  # slow enough for 20 Hz and a delay
    kinds: dict[str, agvjax.Law] = {
        "velocity_reference": agvjax.VelocityReference(inner=inner),
        "regulated_pure_pursuit": agvjax.RegulatedPurePursuit(desired_linear_vel=top),
        "path_pid": agvjax.PathPID(),
        "path_lqr": agvjax.PathLQR.designed(period),
        "stanley": agvjax.Stanley(),
    }
    made = {name: dataclasses.replace(given, inner=law) for name, law in kinds.items()}
    return {name: given if type(law.inner) is type(given.inner) else law for name, law in made.items()}


class Comparison:
    """The problem of each law, with goals and limits in the same units."""

    def __init__(self, config: Config):
        self.config = config

    def posed(self, law: agvjax.Law) -> TuningProblem:
        """The tuning problem of a law, in units of its own starting gains."""
        own = law is self.config.controller
        tune, heading = self.config.tune, self.config.scenario.plant.commands_heading
        if not own:  # gains of another law have other names
            tune = dataclasses.replace(tune, gains=law.gains_to_tune(heading), tied={}, bounds={})
        return pose(dataclasses.replace(self.config, controller=law, tune=tune))

    @functools.cached_property
    def budget(self) -> np.ndarray:
        """(3, M): statistics of goals and limits with the configured law and its starting gains, when tuned on."""
        tuner = self.posed(self.config.controller).tuner
        return tuner.objective.baseline(*tuner.roll(tuner.gains.coordinates(tuner.controller), tuner.scenarios()))

    @functools.cached_property
    def unseen_budget(self) -> np.ndarray:
        """The same on the vehicles that no law is tuned on, at the finer step."""
        metrics = judged(self.config, self.config.controller, validation(self.config))
        objective = self.posed(self.config.controller).tuner.objective._replace(weights=None)
        return objective.baseline_of(metrics)

    def tune(self, name: str, law: agvjax.Law, kept: Kept[Searched]) -> Tuned:
        """The best of a look at many gain sets and of searches from the law's own and the best of those."""
        problem = self.posed(law)
        tuner, objective = problem.tuner, problem.tuner.objective._replace(weights=None)
        made = kept.once(name, lambda: search(problem, self.budget, PLACES))
        found = tuner.gains.controller(jax.numpy.asarray(made.z), tuner.controller).canonical()
        unseen = validation(self.config)
        before, after = (judged(self.config, one, unseen) for one in (law, found))
        over = excesses(objective, after, self.unseen_budget)
        return Tuned(law, found, tuner.gains.names, *made[1:], over, before, after)


def search(problem: TuningProblem, budget: np.ndarray, places: int, key: str = "") -> Searched:
    """The best of a look at many gain sets and of searches from the law's own and so many of the best of those.

    Args:
        problem: whose goals and limits are multiples of `budget`.
        budget: (3, M), statistics of goals and limits.
        places: to search from besides the law's own gains.
        key: what of the tuner's runs its configuration does not say.
    """
    tuner = dataclasses.replace(problem.tuner, budget=budget)
    settings = dump(dataclasses.replace(problem.config, seed=0)) + key
    z = tuner.gains.coordinates(tuner.controller)
    if tuner.forward:
        tuner = dataclasses.replace(tuner, compiled=traced(tuner.jacobian, settings, z, tuner.scenarios()))
    begun, best, rollouts = [z], ((np.inf, np.inf), z), 0
    if problem.screen is not None:
        screen = dataclasses.replace(problem.screen, tuner=tuner)
        compiled = traced(tuner.values, settings + "screen", *screen.example())
        seen = dataclasses.replace(screen, compiled=compiled).look()
        excess, goal = (float(x) for x in seen.ranks[0])
        best, rollouts = ((excess, goal), jax.numpy.asarray(seen.places[0])), seen.rollouts
        begun += [jax.numpy.asarray(place) for place in seen.apart(places)]
    jacobians = 0
    for place in begun:
        progress = tuner.begin(place)
        while not tuner.finished(progress):
            progress = tuner.advance(progress)
        jacobians, rollouts = jacobians + progress.iteration, rollouts + progress.rollouts
        best = min(best, (progress.best, progress.best_z), key=lambda found: found[0])
    (excess, _), z = best
    return Searched(tuple(np.asarray(z).tolist()), float(excess), len(begun), jacobians, rollouts)


def compare(config: Config, kept: Kept[Searched], done: Callable[[str], None]) -> tuple[Comparison, dict[str, Tuned]]:
    """Tune and judge every law, two at a time; `done(name)` is called as each is ready, `kept` is what was found."""
    comparison, chosen = Comparison(config), laws(config)
    _ = comparison.budget, comparison.unseen_budget  # before there are threads
    done("the configured law's budget")

    def one(item: tuple[str, agvjax.Law]) -> tuple[str, Tuned]:
        found = comparison.tune(*item, kept)
        done(item[0])
        return item[0], found

    return comparison, dict(in_pairs(one, chosen.items()))
