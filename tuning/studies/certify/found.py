"""What a search finds: the largest share of the box in which gradient ascent meets no violation of the bounds."""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple, cast

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import agvjax
from agvjax._pytree import Real, number, pytree
from agvjax.engine.loop import Sample
from agvjax.engine.rollout import Meter
from agvjax.metrics import tracking_error
from agvjax.protocols import Law

from ...config.settings import Config
from ...ensemble.draws import Between
from ...ensemble.worst import Adversary
from .problem import box, nominal

BLOCK, CLOSE, MOST = 64, 0.01, 4.0  # scenarios together; the bisection's end; boxes beyond the one asked about
STARTS = "start.position[0]", "start.position[1]", "start.velocity[0]", "start.velocity[1]"


def scenarios(scenario: agvjax.Scenario, values: dict[str, Array]) -> dict[str, Array]:
    """Leaves of scenarios from the unknowns of a certificate, each (B,): elements of a start are put together."""
    leaves = {name: value for name, value in values.items() if name not in STARTS}
    for leaf in ("start.position", "start.velocity"):
        leaves[leaf] = jnp.stack([values[f"{leaf}[0]"], values[f"{leaf}[1]"]], axis=1)
    return leaves


@pytree
class LargestLate(Meter):
    """The largest error of each channel from `late` on, accumulated over a run."""

    late: Real = number(4.0, "s")

    def weights(self, t: Array, left: Array, right: Array, end: Array) -> Array:
        """1 where an instant counts."""
        return (t >= self.late - 1e-9).astype(t.dtype)

    def start(self, sample: Sample) -> Array:
        """Nothing yet."""
        return jnp.zeros_like(tracking_error(sample))

    def update(self, tally: Array, sample: Sample, weights: Array) -> Array:
        """With one more sample."""
        return jnp.maximum(tally, weights * jnp.abs(tracking_error(sample)))

    def finish(self, tally: Array, ok: Array, horizon: Array) -> tuple[Array, Array]:
        """The errors, and whether the run has gone well."""
        return tally, ok


def late_errors(
    law: Law, scenario: agvjax.Scenario, leaves: dict[str, Array], late: float, **timing: Any
) -> tuple[Float[Array, "3 B"], Float[Array, " B"]]:
    """Largest errors in x, y [m] and heading [rad] from `late` on, and whether each run has gone well."""
    meter = cast(agvjax.Criteria, LargestLate(late=late))  # whose metrics are what it finishes with
    worst, ok = agvjax.evaluate(law, agvjax.batch(scenario, leaves), criteria=meter, **timing)
    return worst.T, ok


def nominal_error(config: Config) -> float:
    """The largest error over its bound in the configured scenario; infinite where the run has not gone well."""
    leaves = scenarios(config.scenario, {name: jnp.asarray([value]) for name, value in nominal(config).items()})
    timing = config.timing("sweep")
    errors, ok = late_errors(config.controller, config.scenario, leaves, config.criteria.late, **timing)
    limits = np.array([config.certify.within, config.certify.within, config.certify.within_heading])
    return float(np.max(np.asarray(errors)[:, 0] / limits)) if bool(ok[0]) else float("inf")


class Seeker(NamedTuple):
    """The adversary of `agvjax sweep`, for the bounds of a certificate."""

    adversary: Adversary
    law: Law
    names: tuple[str, ...]  # of the sides that have a length
    ends: np.ndarray  # (sides, 3): low, nominal, high

    @classmethod
    def of(cls, config: Config) -> Seeker:
        """Of a configuration."""
        whole, middle = box(config), nominal(config)
        names = tuple(name for name, (low, high) in whole.items() if high > low)
        ends = np.array([[whole[name][0], middle[name], whole[name][1]] for name in names]).reshape(-1, 3)
        labels = [f"side{i}" for i in range(len(names))]
        limits = jnp.asarray([config.certify.within, config.certify.within, config.certify.within_heading])

        def rollout(z: tuple[Law, Array], moves: dict[str, Array]) -> tuple[Array, Array]:
            law, share = z
            given = jnp.stack([moves[label] for label in labels])
            low, centre, high = (jnp.asarray(x, given.dtype)[:, None] for x in ends.T)
            given = given * share
            moved = centre + jnp.maximum(given, 0) * (high - centre) + jnp.minimum(given, 0) * (centre - low)
            moved = jnp.where(low >= 0, jnp.maximum(moved, 1e-3 * centre), moved)  # slopes and thresholds end at 0
            values = {name: jnp.full(given.shape[1:], value, given.dtype) for name, value in middle.items()}
            values |= dict(zip(names, moved, strict=True))
            leaves = scenarios(config.scenario, values)
            worst, ok = late_errors(law, config.scenario, leaves, config.criteria.late, **config.timing("sweep"))
            return jnp.max(worst / limits.astype(worst.dtype)[:, None], axis=0)[None], ok

        adversary = Adversary(
            rollout=rollout,
            names=("error",),
            scenario=dict.fromkeys(labels, 0.0),
            draws=dict.fromkeys(labels, Between(-1.0, 1.0)),
            metrics=("error",),
            settings=dataclasses.replace(config.tune.search, checks=0, scouts=min(config.tune.search.scouts, 128)),
            seed=config.seed,
        )
        return cls(adversary, agvjax.check(config.controller), names, ends)

    def worst(self, share: float, round_: int = 0) -> tuple[float, dict[str, np.ndarray]]:
        """The largest error over its bound that is found in a share of the box, and where."""
        found = self.adversary.search((self.law, jnp.asarray(share, jnp.result_type(float))), round_)[0]
        return found.value, found.scenario

    def share(self) -> float:
        """The largest share of the box in which nothing is found, up to `MOST`; by bisection.

        0 where something is found in the smallest share that is tried; `MOST` for a box without sides.
        """
        if not self.names:
            return MOST
        low, high, round_ = 0.0, MOST, 0
        for share in (1.0, 2.0, MOST):
            value, _ = self.worst(share, round_)
            round_ += 1
            if not value <= 1:
                high = share
                break
            low = share
        while low < high and high - low > CLOSE * max(high, CLOSE):
            middle = (low + high) / 2
            value, _ = self.worst(middle, round_)
            round_ += 1
            low, high = (middle, high) if value <= 1 else (low, middle)
        return low

    def steepest(self, share: float) -> dict[str, float]:
        """The gradient of the worst error at the worst scenario that is found, over the whole of every side."""
        if not self.names:
            return {}
        _, where = self.worst(share)
        z = (self.law, jnp.asarray(share, jnp.result_type(float)))
        shares = jnp.asarray(self.adversary.box.shares({name: x[None] for name, x in where.items()}))
        _, _, slopes = self.adversary.climb(z, shares)
        order = [self.names[int(label.removeprefix("side"))] for label in self.adversary.box.names]
        return dict(zip(order, np.asarray(slopes)[:, 0, 0].tolist(), strict=True))
