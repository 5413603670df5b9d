"""What the page shows, computed: programs compiled once, whose arguments are the numbers on the sliders."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import agvjax
from agvjax.draw.plot import shown
from agvjax.leaves import get, swap
from agvjax.metric_table import metrics_of

from ...compute.compiled import Ahead
from ...config import dump, mapped
from ...config.ends import LAW
from ...config.settings import Config
from ...ensemble.draws import sample
from ...io import curves
from .sliders import Movable

VEHICLES = 16  # of the ensemble, that a move is judged on
POINTS = 500  # of a curve, about as many as a screen has room for
Leaves = dict[str, Any]  # arrays of NumPy, or of JAX within a program


class Judged(NamedTuple):
    """What the table says for one place of all sliders.

    Attributes:
        ok: whether the run stayed within `scenario.limit`.
        metrics: of the run, by name, as `agvjax simulate` has them.
        mean: over the vehicles.
        worst: the largest of them.
        lost: how many of the vehicles diverged.
    """

    ok: bool
    metrics: dict[str, float]
    mean: dict[str, float]
    worst: dict[str, float]
    lost: int


class Rollouts:
    """The programs of a problem: the configured vehicle's run, its metrics, and those of an ensemble of others.

    They are compiled in the background when this is made. What they are given has the same shapes at every call, so
    that nothing is compiled again: a program that exists takes no other.
    """

    def __init__(self, config: Config, moving: Movable) -> None:
        self.config, self.moving = config, moving
        self.names = metrics_of(config.scenario)
        values = self._leaves(config)
        self._beside = ThreadPoolExecutor(1)
        settings = f"{dump(config)}{moving.leaves}{VEHICLES} {POINTS} explore"
        self._run = Ahead(self.run, f"{settings} run", values)
        self._one = Ahead(self.one, f"{settings} one", values)
        self._many = Ahead(self.many, f"{settings} many", values, self._drawn(config))

    def ready(self) -> None:
        """Wait until all are compiled."""
        for program in (self._run, self._one, self._many):
            program.ready.result()

    def curves(self, config: Config) -> dict[str, np.ndarray]:
        """The samples that are drawn, for a configuration that differs from the first in what moves alone.

        By name, as `io.curves.of_run` has them; NaN where a number cannot be drawn.
        """
        drawn, off = jax.device_get(self._run(self._leaves(config))), mapped.origin(config.scenario)
        drawn |= {name: np.asarray(drawn[name], float) + off for name in ("path", "position")} if off.any() else {}
        return {name: shown(x) for name, x in drawn.items()}

    def judging(self, config: Config) -> Future[Judged]:
        """What `judged` returns, computed in another thread."""
        return self._beside.submit(self.judged, config)

    def judged(self, config: Config) -> Judged:
        """What the table says of such a configuration."""
        values = self._leaves(config)
        every, fine = jax.device_get(self._many(values, self._drawn(config)))
        numbers, ok = jax.device_get(self._one(values))
        with np.errstate(invalid="ignore"):
            mean = every.mean(axis=1)
        return Judged(
            ok=bool(ok),
            metrics=dict(zip(self.names, numbers.tolist(), strict=True)),
            mean=dict(zip(self.names, mean.tolist(), strict=True)),
            worst=dict(zip(self.names, every.max(axis=1).tolist(), strict=True)),
            lost=int(np.sum(~fine)),
        )

    def run(self, values: Leaves) -> Leaves:
        """One vehicle: the samples that are drawn."""
        timing = self.config.timing()
        law, scenario = self._trees(values)
        run = agvjax.simulate(law, scenario, save_every=_apart(timing.n_steps), **timing)
        some = np.unique(np.linspace(0, len(run.t) - 1, 2 * POINTS).round().astype(int))
        return {name: x[some] for name, x in curves.of_run(run).items()}

    def one(self, values: Leaves) -> tuple[Array, Array]:
        """The same vehicle: its metrics (M,), of every step, and whether it did not diverge."""
        law, scenario = self._trees(values)
        criteria = self.config.judged(delivered=True)
        metrics = agvjax.evaluate(law, scenario, criteria=criteria, **self.config.timing())
        return self._stacked(metrics), metrics.ok

    def many(self, values: Leaves, drawn: Leaves) -> tuple[Array, Array]:
        """The ensemble: metrics (M, vehicles), and which runs did not diverge (vehicles,)."""
        law, scenario = self._trees(values)
        batch = agvjax.Batch(scenario=swap(scenario, drawn), names=tuple(sorted(drawn)))
        criteria = self.config.judged(delivered=True)
        metrics = agvjax.evaluate(law, batch, criteria=criteria, devices=1, **self.config.timing("tune"))
        return self._stacked(metrics), metrics.ok

    def _stacked(self, metrics: agvjax.Metrics) -> Array:
        return jnp.stack([metrics[name] for name in self.names])

    def _trees(self, values: Leaves) -> tuple[agvjax.Law, agvjax.Scenario]:
        of_law = {name.removeprefix(LAW): x for name, x in values.items() if name.startswith(LAW)}
        others = {name: x for name, x in values.items() if not name.startswith(LAW)}
        return swap(self.config.controller, of_law), swap(self.config.scenario, others)

    def _leaves(self, config: Config) -> Leaves:
        """The leaves that move, in the run's precision."""
        dtype, leaves = jnp.result_type(float), {}
        for name in self.moving.leaves:
            tree = config.controller if name.startswith(LAW) else config.scenario
            leaves[name] = np.asarray(get(tree, name.removeprefix(LAW)), dtype)
        return leaves

    def _drawn(self, config: Config) -> Leaves:
        """The leaves that vary over the vehicles, drawn about where the sliders stand as `agvjax tune` draws them."""
        dtype = jnp.result_type(float)
        batch = sample(config.scenario, config.ensemble.draws, VEHICLES, config.seed)
        return {name: np.asarray(x, dtype) for name, x in batch.values.items()}


def _apart(n_steps: int) -> int:
    """Steps between samples that are drawn: a divisor of their number, for at least `POINTS` of them."""
    most = max(1, n_steps // POINTS)
    return next(k for k in range(most, 0, -1) if n_steps % k == 0)
