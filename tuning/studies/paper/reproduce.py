"""All of the reproduction: run, judge, draw, write."""

from __future__ import annotations

import functools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import jax
import numpy as np

import agvjax
from agvjax.leaves import cast

from ...compute.pairs import WORKERS
from ...config.settings import Config
from ...ensemble.draws import sample
from ...io.files import Json
from ..captions import CAPTIONS
from . import bounds, cases, facts, tables
from . import proof as lyapunov
from .bounds import Proof
from .cases import Run

SAMPLED = 64  # scenarios on which bounds are compared with what is observed
EXTRAS = ("super_twisting", "fractional", "event", "no_network", "no_integral", "no_filter", "known_slopes")


class Reproduction:
    """Everything that was computed, by what it is about."""

    def __init__(self, config: Config, progress: Callable[[str], None]):
        self.config, self.law, self.timing = config, cases.papers_law(config), config.timing()
        self.groups = cases.groups(self.law, config.scenario)
        self.judged: dict[str, Run] = {}
        names = sorted(self.groups, key=_longest_first)
        with ThreadPoolExecutor(WORKERS) as pool:
            rolled, sampled = pool.map(self._roll, names), pool.submit(self._bounds)
            for name, runs in zip(names, rolled, strict=True):
                self.judged |= runs
                progress(name)
            self.bounds = sampled.result()
            progress("bounds on sampled scenarios")
        if not self.bounds or not self.judged["proposed"].trajectory.ok:
            raise RuntimeError("the proposed law diverges with these settings: there is nothing to compare with")
        self.trajectories = {name: run.trajectory for name, run in self.judged.items()}
        self.tables = {name: tables.table(self.judged, printed) for name, printed in tables.PRINTED.items()}
        self.extras = tables.table(self.judged, {}, EXTRAS)
        self.readings = {"default": self.judged["proposed"], "R1 literal": self.judged["R1 literal"]}
        self.readings |= {name: self.judged[name] for name in cases.readings(self.law, config.scenario)}
        self.lyapunov = self._functions()
        progress("Lyapunov functions")
        self.network = facts.network(self.judged, self.groups)
        self.bandwidth = facts.bandwidth(self.judged)
        self.updates = facts.updates(self.trajectories["event"])
        self.zeno = facts.zeno(self.groups["event"]["event"], self.timing)
        progress("intervals of the event trigger")
        weights = {"1": self.law}
        weights |= {str(n): self.groups[f"weights_{n}"][f"weights_{n}"].controller for n in (5, 50)}
        self.cost = facts.cost(weights, config.scenario, self.timing)  # alone, or it would measure the others
        progress("cost of a step")

    def _roll(self, name: str) -> dict[str, Run]:
        finer = cases.FINER.get(name, 1)
        dt, n_steps = self.timing.dt / finer, self.timing.n_steps * finer
        return cases.roll(self.groups[name], {**self.timing, "dt": dt, "n_steps": n_steps, "save_every": finer})

    def _bounds(self) -> list[bounds.Report]:
        """Bounds and observed errors on scenarios of the tuning ensemble, the proposed law."""
        config, law = self.config, agvjax.check(self.law)
        batch = sample(config.scenario, config.ensemble.draws, SAMPLED, config.seed)
        stepped = {**self.timing, "save_every": 10 if self.timing["n_steps"] % 10 == 0 else 1}
        roll = jax.jit(jax.vmap(functools.partial(agvjax.simulate, **stepped), in_axes=(None, batch.axes)))
        trajectories = roll(law, cast(batch.scenario, jax.numpy.result_type(float)))
        return [
            bounds.report(law, batch[i], jax.tree.map(lambda x, i=i: x[i], trajectories))
            for i in range(batch.size)
            if bool(trajectories.ok[i])
        ]

    def _functions(self) -> Proof:
        law, scenario = agvjax.check(self.law), self.config.scenario
        trajectory = jax.tree.map(jax.numpy.asarray, self.trajectories["proposed"])
        constants = lyapunov.constants(law, scenario, trajectory)
        sensitivity, xi2 = lyapunov.compensation(law, scenario, trajectory)
        functions = lyapunov.functions(law, scenario, trajectory, constants)
        report, margins = bounds.report(law, scenario, trajectory), lyapunov.margins(law, scenario)
        return Proof(constants, functions, report, margins, float(sensitivity), float(xi2))


def _longest_first(name: str) -> tuple[int, str]:
    order = ("proposed", "known b1", "b1", "fractional", "weights_50", "no_filter", "event")
    return (order.index(name) if name in order else len(order), name)


def steps(config: Config) -> int:
    """How often `Reproduction` and `report.write` report progress."""
    groups = len(cases.groups(cases.papers_law(config), config.scenario))
    return groups + 4 + (len(CAPTIONS) - 1) + 1


def faults(config: Config) -> list[agvjax.Fault]:
    """What the reproduction needs beyond a good configuration."""
    found = cases.faults(config.controller, config.scenario)
    if config.simulate.horizon <= bounds.LATE:
        rule = f"more than {bounds.LATE:g} s, from when on bounds are compared with errors"
        found.append(agvjax.Fault("simulate.horizon", config.simulate.horizon, rule))
    law = config.controller
    if isinstance(law, agvjax.NeuroBackstepping) and any(
        isinstance(belief, agvjax.readings.KnownSlopes) for belief in (law.Pi_hat, law.Pi_psi_hat)
    ):
        rule = "a number: the law with known slopes is one of the ablations"
        found.append(agvjax.Fault("controller.Pi_hat, controller.Pi_psi_hat", "KnownSlopes", rule))
    return found


def sampled_bounds(found: Reproduction) -> Json:
    """Bound over observed on the sampled scenarios: median, smallest and largest, position then heading."""
    rows: Json = {"scenarios": len(found.bounds)}
    for name in ("printed", "corrected"):
        ratios = np.array([getattr(r, name) / r.observed for r in found.bounds])
        rows[name] = {
            "median": np.median(ratios, 0).tolist(),
            "smallest": ratios.min(0).tolist(),
            "largest": ratios.max(0).tolist(),
            "vacuous": (ratios > bounds.VACUOUS).sum(0).tolist(),
            "violated": (ratios < 1).sum(0).tolist(),
        }
    return rows
