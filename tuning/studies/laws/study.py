"""Which law is better? Every law tuned by the same tuner, on the same scenarios, to the same command budget."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

import agvjax
from agvjax.metric_table import AXES

from ...compute.pairs import in_pairs
from ...config.settings import Config, Tune
from ...ensemble.draws import sample
from ...io.kept import Kept
from ...tune.gains import Gains
from ...tune.methods.objective import within
from ...tune.problem import requirements
from ...tune.screen import Screen
from ...tune.tuner import Tuner
from ..paper.cases import matched

PEAKS = ("peak_command_x", "peak_command_y", "peak_heading")
BUDGET = (*(f"rms_command_{axis}" for axis in AXES), *PEAKS, *(f"chatter_{axis}" for axis in AXES))
ITERATIONS = 60  # of the tuner, from each start
STARTS = (10.0, 20.0)  # 1/s, bandwidths to start from besides the law's own gains
PLACES = 4  # best places of the screening to start from besides: where a law chatters, gradients at some are of no use


class Tuned(NamedTuple):
    """One law: its gains before and after, and what each is worth on unseen scenarios."""

    start: Any
    controller: agvjax.Law
    cost: float  # on the tuning scenarios
    excess: float  # of the budget there, as a ratio; 0 if it is kept
    looks: int  # Jacobians taken, over all starts
    refused: int  # of them, those of no use
    left_out: int  # starts outside the bounds of the tuning step or the stability conditions
    metrics: agvjax.Metrics  # of the tuned law on the validation scenarios
    metrics_before: agvjax.Metrics


def laws(proposed: Any) -> dict[str, Any]:
    """The laws that are tuned, with their own gains, those that take longest first."""
    return {
        "fractional": agvjax.FractionalBackstepping(inner=proposed),
        "proposed": proposed,
        "osfc": agvjax.OSFC(),
        "asmc": agvjax.ASMC(),
        "dfc": agvjax.DFC(),
        "ftsmc": agvjax.FTSMC(),
        "super_twisting": agvjax.SuperTwistingFTSMC(),
    }


def starts(name: str, law: agvjax.Law) -> list[Any]:
    """Where the tuner starts from: the law's own gains, and those of some bandwidths where that is defined."""
    try:
        return [law, *(matched(name, p, law) for p in STARTS)]
    except KeyError:
        return [law]


class Searched(NamedTuple):
    """What the searches for one law found; as in `Tuned`."""

    z: tuple[float, ...]  # coordinates of the gains
    cost: float
    excess: float
    looks: int
    refused: int


class Comparison:
    """The tuning and validation scenarios and the budget: what the proposed law needs with the configured gains."""

    def __init__(self, config: Config):
        draws, sizes = config.ensemble.draws, config.ensemble
        self.config = config
        self.seen = sample(config.scenario, draws, sizes.size, config.seed)
        self.unseen = sample(config.scenario, draws, sizes.validation_size, config.seed + 1)
        limits = within(dict.fromkeys(BUDGET, 1.0))
        self.objective = requirements(config.tune, config.judged())._replace(limits=limits, penalty=10.0)

    @functools.cached_property
    def budget(self) -> np.ndarray:
        """(3, M): statistics of the goals and of each command metric, of the configured law on the tuning set."""
        metrics = self._evaluated(self.config.controller, self.seen, "tune")
        return self.objective.baseline_of(metrics)

    def of(self, metric: str) -> list[float]:
        """Mean and worst that the budget allows of a command metric."""
        return self.budget[:2, self.objective.names.index(metric)].tolist()

    def judge(self, law: agvjax.Law) -> agvjax.Metrics:
        """Metrics on the validation scenarios."""
        return jax.tree.map(np.asarray, self._evaluated(law, self.unseen, "simulate"))

    def _evaluated(self, law: agvjax.Law, batch: agvjax.Batch, section: str) -> agvjax.Metrics:
        timing = self.config.timing(section)
        return agvjax.evaluate(agvjax.check(law), batch, criteria=self.objective.criteria, **timing)

    def tune(self, name: str, law: agvjax.Law, kept: Kept[Searched]) -> Tuned:
        """The best of all starts, and of all gain sets looked at: the budget kept first, then the cost."""
        config, settings = self.config, Tune(gains=law.gains_to_tune(), iterations=ITERATIONS)
        timed = dataclasses.replace(settings, dt=config.tune.dt, integrator=config.tune.integrator)
        gains = Gains.of(dataclasses.replace(config, controller=law, tune=timed))
        tuner = Tuner(agvjax.check(law), self.seen, gains, self.objective, settings, config.timing("tune"), self.budget)
        inside = [start for start in starts(name, law) if not gains.faults(start)]
        left_out = len(starts(name, law)) - len(inside)
        if not inside:
            raise ValueError(f"no start of {name} lies inside its bounds")
        made = kept.once(name, lambda: self._searched(tuner, inside))
        found = gains.controller(jax.numpy.asarray(made.z), tuner.controller)
        before, after = self.judge(law), self.judge(found)
        return Tuned(law, found, made.cost, made.excess, made.looks, made.refused, left_out, after, before)

    def _searched(self, tuner: Tuner, inside: list[Any]) -> Searched:
        """Gain sets are looked at first, then searched from the best of them and from `inside`.

        A gradient of a law that chatters is the sensitivity of its chatter, and where searches by it end depends on the
        last bit of a gain.
        """
        middle = dataclasses.replace(tuner, controller=agvjax.check(inside[0]))
        seen = Screen(middle, self.seen.size, self.config.seed).look()
        excess, goal = (float(x) for x in seen.ranks[0])
        best, z, looks, refused = (excess, goal), jax.numpy.asarray(seen.places[0]), 0, 0
        for place in [*map(tuner.gains.coordinates, inside), *seen.apart(PLACES)]:
            progress = tuner.begin(place)
            while not tuner.finished(progress):
                progress = tuner.advance(progress)
            looks, refused = looks + progress.iteration, refused + progress.backed_out
            best, z = min((best, z), (progress.best, progress.best_z), key=lambda found: found[0])
        return Searched(tuple(np.asarray(z).tolist()), float(best[1]), float(best[0]), looks, refused)


def compare(config: Config, kept: Kept[Searched], done: Callable[[str], None]) -> tuple[Comparison, dict[str, Tuned]]:
    """Tune and judge every law, two at a time; `done(name)` is called as each is ready, `kept` is what was found."""
    comparison = Comparison(config)
    _ = comparison.budget

    def one(item: tuple[str, Any]) -> tuple[str, Tuned]:
        found = comparison.tune(*item, kept)
        done(item[0])
        return item[0], found

    found = dict(in_pairs(one, laws(config.controller).items()))
    proposed = found["proposed"]
    start, held = (agvjax.EventTriggered(inner=law) for law in (config.controller, proposed.controller))
    found["event"] = proposed._replace(  # tuned through its continuous law, judged held
        start=start,
        controller=held,
        metrics=comparison.judge(held),
        metrics_before=comparison.judge(start),
        looks=0,
        refused=0,
        left_out=0,
    )
    done("event")
    return comparison, found
