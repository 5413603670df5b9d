"""The margins of a loop along its run, over vehicles that were not tuned on."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import control
import numpy as np

import agvjax
from agvjax.leaves import get
from agvjax.linear import Loops, linearised, steady
from agvjax.margins import Matrices, growth, whole

from ...config.settings import Config
from ...ensemble.draws import sample
from .loops import Margins, margins, spaces


class Found(NamedTuple):
    """Margins of V vehicles, the configured one first, at K instants and m inputs."""

    period: float  # s
    t: np.ndarray  # (K,), s
    margins: list[list[list[Margins]]]  # V of K of m
    left_out: np.ndarray  # (V, K): a limit, a jump of what is asked for, or slopes that are not finite
    ok: np.ndarray  # (V,), whether the run stayed within the limit
    loops: Loops  # of the vehicles

    def values(self, name: str) -> np.ndarray:
        """One number of all of them, (V, K, m); of an instant that is left out, and of a run that diverged, NaN."""
        found = np.array([[[m._asdict()[name] for m in now] for now in vehicle] for vehicle in self.margins], float)
        found[self.left_out | ~self.ok[:, None]] = np.nan
        return found

    def spaces(self, vehicle: int, instant: int) -> list[control.StateSpace]:
        """The loops of a vehicle at an instant, cut at one input each."""
        return spaces(*matrices(self.loops, vehicle, instant), self.period)


def matrices(loops: Loops, *place: int) -> Matrices:
    """A, B, C and D of an instant with the inputs under way as states."""
    parts = (np.asarray(x)[place][None] for x in (loops.A, loops.B, loops.C, loops.D))
    A, B, C, D = (x[0] for x in whole(*parts))
    return A, B, C, D


def study(config: Config, tick: Callable[[str], object] = lambda text: None) -> Found:
    """Linearise along the run of the configured vehicle and of others, and look at every loop."""
    settings, timing, first = config.margins, config.timing("tune"), config.criteria.late
    tick("runs")
    loops = linearised(config.controller, vehicles(config), timing=timing, first=first, count=settings.instants)
    loops = Loops(*(np.asarray(x) for x in loops))
    period = float(loops.period[0])
    tick("margins")
    found = [
        [_at(matrices(loops, v, k), period, loops.changing[v, k]) for k in range(settings.instants)]
        for v in range(len(loops.t))
    ]
    return Found(period, loops.t[0], found, ~np.asarray(steady(loops)), loops.ok, loops)


def vehicles(config: Config) -> agvjax.Batch:
    """The configured one, and others that were not tuned on."""
    draws = config.ensemble.draws
    if not draws or not config.margins.vehicles:
        return agvjax.batch(config.scenario, {"limit": np.asarray([config.scenario.limit], float)})
    others = sample(config.scenario, draws, config.margins.vehicles, config.seed + 1).values
    return agvjax.batch(
        config.scenario, {n: np.concatenate([np.asarray(get(config.scenario, n))[None], x]) for n, x in others.items()}
    )


def _at(parts: Matrices, period: float, changing: float) -> list[Margins]:
    if not all(np.isfinite(x).all() for x in parts):
        return [Margins(*[np.nan] * len(Margins._fields))] * parts[-1].shape[0]
    fastest = float(growth(period, *parts))
    return [margins(space, period, fastest, changing) for space in spaces(*parts, period)]
