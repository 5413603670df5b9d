"""All of the reproduction: run, judge, draw, write."""

from __future__ import annotations

import functools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import jax
import numpy as np

import agvjax
from agvjax.leaves import cast

from ...config.settings import Config
from ...ensemble.draws import sample
from ...io import files
from ...io.pages import html
from . import bounds, cases, facts, figures, page, tables
from . import proof as lyapunov

SAMPLED = 64  # scenarios on which bounds are compared with what is observed
EXTRAS = ("super_twisting", "fractional", "event", "no_network", "no_integral", "no_filter", "known_slopes")


class Reproduction:
    """Everything that was computed, by what it is about; `page` turns it into a report."""

    def __init__(self, config: Config, progress: Callable[[str], None]):
        self.config, self.timing = config, config.timing()
        self.groups = cases.groups(config.controller, config.scenario)
        self.judged: dict[str, Any] = {}
        jobs: list[tuple[str, Callable[[], Any]]] = [
            (name, functools.partial(self._roll, name)) for name in sorted(self.groups, key=_longest_first)
        ]
        jobs += [("bounds on sampled scenarios", self._bounds)]
        with ThreadPoolExecutor(cases.WORKERS) as pool:
            for name, found in zip([n for n, _ in jobs], pool.map(lambda job: job[1](), jobs), strict=True):
                if name in self.groups:
                    self.judged |= found
                else:
                    self.bounds = found
                progress(name)
        if not self.bounds or not self.judged["proposed"][0].ok:
            raise RuntimeError("the proposed law diverges with these settings: there is nothing to compare with")
        self.trajectories = {name: run[0] for name, run in self.judged.items()}
        self.tables = {name: tables.table(self.judged, printed) for name, printed in tables.PRINTED.items()}
        self.extras = tables.table(self.judged, {}, EXTRAS)
        self.readings = {"default": self.judged["proposed"], "R1 literal": self.judged["R1 literal"]}
        self.readings |= {name: self.judged[name] for name in cases.readings(config.controller, config.scenario)}
        self.lyapunov = self._functions()
        progress("Lyapunov functions")
        self.network = facts.network(self.judged, self.groups)
        self.bandwidth = facts.bandwidth(self.judged)
        self.updates = facts.updates(self.trajectories["event"])
        self.zeno = facts.zeno(self.groups["event"]["event"], self.timing)
        progress("intervals of the event trigger")
        weights = {"1": config.controller}
        weights |= {str(n): self.groups[f"weights_{n}"][f"weights_{n}"].controller for n in (5, 50)}
        self.cost = facts.cost(weights, config.scenario, self.timing)  # alone, or it would measure the others
        progress("cost of a step")

    def _roll(self, name: str) -> dict[str, Any]:
        finer = cases.FINER.get(name, 1)
        dt, n_steps = self.timing.dt / finer, self.timing.n_steps * finer
        return cases.roll(self.groups[name], {**self.timing, "dt": dt, "n_steps": n_steps, "save_every": finer})

    def _bounds(self) -> list[bounds.Report]:
        """Bounds and observed errors on scenarios of the tuning ensemble, the proposed law."""
        config, law = self.config, agvjax.check(self.config.controller)
        batch = sample(config.scenario, config.ensemble.draws, SAMPLED, config.seed)
        stepped = {**self.timing, "save_every": 10 if self.timing["n_steps"] % 10 == 0 else 1}
        roll = jax.jit(jax.vmap(functools.partial(agvjax.simulate, **stepped), in_axes=(None, batch.axes)))
        trajectories = roll(law, cast(batch.scenario, jax.numpy.result_type(float)))
        return [
            bounds.report(law, batch[i], jax.tree.map(lambda x, i=i: x[i], trajectories))
            for i in range(batch.size)
            if bool(trajectories.ok[i])
        ]

    def _functions(self) -> dict[str, Any]:
        law, scenario = agvjax.check(self.config.controller), self.config.scenario
        trajectory = jax.tree.map(jax.numpy.asarray, self.trajectories["proposed"])
        found = lyapunov.constants(law, scenario, trajectory)
        sensitivity, xi2 = lyapunov.compensation(law, scenario, trajectory)
        return {
            "constants": found,
            "functions": lyapunov.functions(law, scenario, trajectory, found),
            "report": bounds.report(law, scenario, trajectory),
            "margins": lyapunov.margins(law, scenario),
            "sensitivity": float(sensitivity),
            "xi2": float(xi2),
        }


def _longest_first(name: str) -> tuple[int, str]:
    order = ("proposed", "known b1", "b1", "fractional", "weights_50", "no_filter", "event")
    return (order.index(name) if name in order else len(order), name)


def write(found: Reproduction, out: Path, command: str, pdf: bool, progress: Callable[[str], None]) -> dict[str, Any]:
    """Tables, figures and pages into a folder; returns `tables.json`'s content."""
    drawn = figures.paper({name: found.trajectories[name] for name in (*figures.ACTUATED, *figures.UNPREPARED)})
    drawn |= {
        "b1": figures.b1(found.network, float(np.asarray(found.config.controller.k2))),
        "bandwidth": figures.bandwidth(found.judged),
        "readings": figures.readings({name: run[0] for name, run in found.readings.items()}),
        "lyapunov": figures.lyapunov(found.trajectories["proposed"], found.lyapunov),
        "vacuity": figures.vacuity(found.bounds),
        "event": figures.event(found.trajectories["event"], found.trajectories["proposed"]),
        "fractional": figures.fractional(found.judged),
    }
    for name, figure in drawn.items():
        figures.caption(name, figure, command)
        files.write_figure(out / f"{name}.png", figure)
        if pdf:
            files.write_figure(out / f"{name}.pdf", figure)
        progress(f"{name}.png")
    content = {name: tables.plain(made) for name, made in found.tables.items()} | page.data(found)
    for name, made in (*found.tables.items(), ("extras", found.extras)):
        files.write(out / f"{name}.md", tables.markdown(made) + "\n\n" + tables.reasons(made) + "\n")
        files.write_csv(out / f"{name}.csv", tables.COLUMNS, tables.rows(made))
    files.write_json(out / "tables.json", content)
    text = page.markdown(found, command)
    files.write(out / "report.md", text)
    files.write(out / "report.html", html(text, out, "Does the paper hold?"))
    progress("report")
    return content


def steps(config: Config) -> int:
    """How often `Reproduction` and `write` report progress."""
    groups = len(cases.groups(config.controller, config.scenario))
    return groups + 4 + (len(figures.CAPTIONS) - 1) + 1


def faults(config: Config) -> list[agvjax.Fault]:
    """What the reproduction needs beyond a good configuration."""
    found = cases.faults(config.controller, config.scenario)
    if config.simulate.horizon <= bounds.LATE:
        rule = f"more than {bounds.LATE:g} s, from when on bounds are compared with errors"
        found.append(agvjax.Fault("simulate.horizon", config.simulate.horizon, rule))
    if not found and any(
        isinstance(b, agvjax.readings.KnownSlopes) for b in (config.controller.Pi_hat, config.controller.Pi_psi_hat)
    ):
        rule = "a number: the law with known slopes is one of the ablations"
        found.append(agvjax.Fault("controller.Pi_hat, controller.Pi_psi_hat", "KnownSlopes", rule))
    return found
