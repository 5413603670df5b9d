"""Is the robot of a log one of the vehicles that gains were tuned for? A rank test against logs simulated of these."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from agvjax import Fault, InputError
from agvjax.leaves import leaves

from ..config.settings import Config, Watch
from ..ensemble.draws import sample, uniform
from ..identify.fit import Fit, Task, fit
from ..identify.parameters import Parameter
from .residuals import simulated, slopes, steps
from .rules import watched

PART = 501  # of the random numbers: other vehicles than those of tuning and of `apply`
STARTS = 1  # of the fit: it begins where the gains were tuned
SURELY = 0.9  # share of the logs of a robot whose number has moved that must raise the alarm for the change to be seen
SCALED, OWN = 100, 0.1  # further simulated logs, by whose spread a distance is measured; the share of the formula in it
HALVINGS, WIDEST = 30, 1e3  # of the search for the least change that is seen; in multiples of what a number may move
LEARNT = 0.5  # share of what is known of a number that must come from the log, or the log says nothing of it
EDGES = (0.05, 0.95)  # quantiles of the vehicles that must lie where a number is looked for
BESIDE = 0.8  # of the best explanation, that another one is named beside it


class Number(NamedTuple):
    """One number that gains were tuned for, and what the log says of it."""

    name: str
    unit: str
    tuned: float
    seems: float  # where it would have to be, did it alone explain the log
    explains: float  # share of the distance between log and model that it alone explains
    seen: float  # the least change that this log would show
    wanted: float  # the change that it should show
    spread: float  # standard deviation over the vehicles that the gains were tuned for

    @property
    def told(self) -> bool:
        """Whether the log says anything of it."""
        return bool(self.seen <= self.wanted)


class Watched(NamedTuple):
    """What a log says."""

    fit: Fit
    rank: float  # share of the simulated logs, itself among them, that are as far from the model
    distance: float
    others: np.ndarray  # (n,), distances of the simulated logs
    alarm: bool
    numbers: tuple[Number, ...]
    steps: np.ndarray  # (C,), rms of the residuals one step ahead
    others_steps: np.ndarray  # (n, C)

    @property
    def told(self) -> bool:
        """Whether the log says anything: an alarm does."""
        return self.alarm or any(one.told for one in self.numbers)

    @property
    def moved(self) -> list[Number]:
        """The numbers that explain an alarm best, each alone, the best first."""
        order = sorted(self.numbers, key=lambda one: -one.explains)
        return [one for one in order if one.explains >= BESIDE * order[0].explains] if self.alarm else []


def asked(config: Config) -> Config:
    """The configuration whose fit has the numbers that are watched."""
    return dataclasses.replace(config, identify=dataclasses.replace(config.identify, fit=watched(config)))


def watch(config: Config, posed: Task, tick: Callable[[str], object] = lambda text: None) -> Watched:
    """Whether a log is of one of the vehicles that gains were tuned for.

    The statistic is how far the numbers seem to have moved, by the slopes of the likelihood, in units of how far they
    seem to in `SCALED` simulated logs. Its rank among others that are simulated of these vehicles, with the same
    commands and the noise that the log's best fit leaves, is the chance of a false alarm: were the robot one of them,
    and its noise as that which is simulated, every rank would be as likely. A number of which the log can say nothing,
    as of a threshold that no command goes beyond, is not watched, and told as such.

    Args:
        config: the scenario and the ensemble that the gains were tuned for.
        posed: the logs, read for `asked(config)`.
        tick: is told the name of each part of the work as it ends.

    Raises:
        agvjax.InputError: the commands do not explain the log, but would with another sign, unit or order.
    """
    vehicles = of_ensemble(config, posed.parameters)
    there = np.array([reached(config, q, own) for q, own in zip(posed.parameters, vehicles.T, strict=True)])
    _some(posed, there)
    found = fit(_only(posed, there), STARTS, config.identify.outlier, config.seed, tick)
    seen = slopes(found)
    tick("compared")
    vehicles = allowed(config, found.parameters, vehicles[:, there])
    residuals = simulated(found, seen, vehicles, np.random.default_rng([config.seed, PART]))
    tick("simulated")
    told = seen.told() > LEARNT
    there[np.flatnonzero(there)[~told]] = False
    _some(posed, there)
    own, others = seen.moved(seen.own[None])[0, told], seen.moved(residuals)[:, told]
    passed, vehicles, block = seen.passed()[np.ix_(told, told)], vehicles[:, told], np.ix_(told, told)
    spread = np.cov(vehicles.T).reshape(own.size, own.size)
    scaled = np.cov(others[:SCALED].T).reshape(own.size, own.size)  # none of those that the log is ranked among
    W = np.linalg.inv((1 - OWN) * scaled + OWN * (np.linalg.inv(seen.information)[block] + spread))
    ranked = Ranked(_only(posed, there).parameters, own, others[SCALED:], W, passed, spread)
    judged = _judged(config, found, ranked, residuals[SCALED:], seen.own[None])
    blind = [_blind(config, q) for q, known in zip(posed.parameters, there, strict=True) if not known]
    return judged._replace(numbers=(*judged.numbers, *blind))


class Ranked(NamedTuple):
    """How far numbers seem to have moved, in the log and in others.

    Attributes:
        parameters: the P numbers.
        own: in the log (P,).
        others: in n simulated logs (n, P).
        W: of the distance (P, P).
        passed: how much of a move of each number seems one, of which (P, P): a column for each.
        spread: covariance (P, P) over the vehicles that the gains were tuned for.
    """

    parameters: tuple[Parameter, ...]
    own: np.ndarray
    others: np.ndarray
    W: np.ndarray
    passed: np.ndarray
    spread: np.ndarray


def _some(posed: Task, there: np.ndarray) -> None:
    if not there.any():
        names = ", ".join(log.name for log in posed.logs)
        rule = "a log that says something of the numbers that are watched: commands beyond thresholds, turns, starts"
        raise InputError([Fault("LOG", names, rule)])


def of_ensemble(config: Config, parameters: Sequence[Parameter]) -> np.ndarray:
    """Vehicles (n, P) of the ensemble that the gains were tuned for."""
    count = SCALED + config.watch.logs
    batch = sample(config.scenario, config.ensemble.draws, count, config.seed, PART)
    own = [np.asarray(batch.values[q.name], float) if q.name in batch.names else _tuned(config, q) for q in parameters]
    return np.column_stack([np.broadcast_to(x, (count,)) for x in own])


def _tuned(config: Config, q: Parameter) -> float:
    """What the gains were tuned for; of an element that was added to be looked for, what it is there."""
    there = leaves(config.scenario)
    return float(there[q.name]) if q.name in there else q.nominal


def reached(config: Config, q: Parameter, own: np.ndarray) -> bool:
    """Whether a log can say of a number what it is: where it is looked for, the vehicles (n,) lie."""
    near = abs(q.nominal - _tuned(config, q)) <= q.floor + 1e-9 * abs(q.nominal)
    low, high = np.quantile(own, EDGES)
    return bool(near and q.low <= low and high <= q.high)


def _only(posed: Task, there: np.ndarray) -> Task:
    """The task with these parameters alone."""
    kept = np.flatnonzero(there)
    names, parameters = (tuple(x[i] for i in kept) for x in (posed.model.names, posed.parameters))
    return posed._replace(model=posed.model._replace(names=names), parameters=parameters)


def _blind(config: Config, q: Parameter) -> Number:
    tuned = _tuned(config, q)
    return Number(q.name, q.unit, tuned, tuned, 0.0, np.inf, config.watch.seen * max(abs(tuned), q.floor), 0.0)


def allowed(config: Config, parameters: Sequence[Parameter], vehicles: np.ndarray) -> np.ndarray:
    """The vehicles (n, P) with what is allowed about each; a number that cannot be below 0 stays there."""
    about = 2 * uniform(config.seed, "watch", *vehicles.shape) - 1
    low, high = np.array([(q.low, q.high) for q in parameters]).T
    return np.clip(vehicles + about * config.watch.allowed * sizes(parameters), low, high)


def sizes(parameters: Sequence[Parameter]) -> np.ndarray:
    """What changes are shares of (P,): the numbers, or of those near 0 what is negligible of their kind."""
    return np.array([max(abs(q.nominal), q.floor) for q in parameters])


def _judged(config: Config, found: Fit, ranked: Ranked, residuals: np.ndarray, seen: np.ndarray) -> Watched:
    distance, far = (distance_of(moved, ranked.W) for moved in (ranked.own[None], ranked.others))
    rank = (1 + np.sum(far >= distance[0])) / (1 + len(far))
    numbers = _numbers(ranked, config.watch)
    ahead, other_steps = (steps(r, found.segments.weight) for r in (seen, residuals))
    alarm = bool(rank <= config.watch.false_alarms + 1e-12)
    return Watched(found, float(rank), float(distance[0]), far, alarm, numbers, ahead[0], other_steps)


def distance_of(moved: np.ndarray, W: np.ndarray) -> np.ndarray:
    """Squared distances (n,) of moves (n, P) from none, in units of what noise and allowed vehicles do."""
    return np.einsum("np,pq,nq->n", moved, W, moved)


def _numbers(ranked: Ranked, settings: Watch) -> tuple[Number, ...]:
    parameters, own, others, W, passed, spread = ranked
    deviations = np.sqrt(np.diag(spread))
    limit = critical(distance_of(others, W), settings.false_alarms)
    pull, distance = W @ own, max(float(own @ W @ own), 1e-300)
    told = []
    for j, (q, wanted) in enumerate(zip(parameters, settings.seen * sizes(parameters), strict=True)):
        move, share = pull[j] / W[j, j], pull[j] ** 2 / W[j, j] / distance
        least = max(least_seen(others, W, passed[:, j], sign * wanted, limit) for sign in (1.0, -1.0))
        numbers = (q.nominal, q.nominal + move, share, least, wanted, deviations[j])
        told.append(Number(q.name, q.unit, *map(float, numbers)))
    return tuple(told)


def critical(distances: np.ndarray, false_alarms: float) -> float:
    """The distance from which on a log has a rank that raises the alarm."""
    place = int(np.floor(false_alarms * (len(distances) + 1) + 1e-9))
    return float(np.sort(distances)[::-1][place - 1])


def least_seen(others: np.ndarray, W: np.ndarray, passed: np.ndarray, unit: float, limit: float) -> float:
    """The least change of one number that raises the alarm in `SURELY` of the simulated logs; to one side.

    Args:
        others: (n, P), how far numbers seem to have moved in simulated logs.
        W: (P, P), of the distance.
        passed: how far numbers seem to move (P,) by a move of the number by 1.
        unit: the change that it should show, with its sign.
        limit: the distance that raises the alarm.
    """

    def raised(times: float) -> bool:
        return bool(np.mean(distance_of(others + times * unit * passed, W) > limit) >= SURELY)

    low, high = 0.0, 1.0
    while not raised(high):
        low, high = high, 2 * high
        if high > WIDEST:
            return np.inf
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if raised(middle) else (middle, high)
    return abs(unit) * high
