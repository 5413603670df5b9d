"""Laws that know numbers of the very vehicle that they drive, tuned and judged over an ensemble."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array

import agvjax

from ...tune.methods.method import Scenarios
from ...tune.tuner import Tuner
from .remedies import Known

LAW = "law."  # before the names of a law's own leaves, where they go with those of the vehicles


def values_of(known: Mapping[str, Known], drawn: Scenarios) -> dict[str, np.ndarray]:
    """By leaf of the law its value (B,) for each vehicle; a number that is not drawn is the same for all."""
    size = len(next(iter(drawn.values())))
    return {
        leaf: own.factor * (np.asarray(drawn[own.leaf], float) if own.leaf in drawn else np.full(size, own.value))
        for leaf, own in known.items()
    }


def knowing(law: agvjax.Law | agvjax.Batch, values: Mapping[str, ArrayLike]) -> agvjax.Law | agvjax.Batch:
    """The law for each vehicle, with these `values` (B,) of its leaves."""
    if not values:
        return law
    if isinstance(law, agvjax.Batch):
        return agvjax.batch(law.scenario, {**law.values, **values})
    return agvjax.batch(law, values)


@dataclasses.dataclass(frozen=True)
class Knowing(Tuner):
    """A search for the gains of a law that knows numbers of each vehicle.

    Attributes:
        known: by leaf of the law the leaf of the scenario.
    """

    known: Mapping[str, Known] = dataclasses.field(default_factory=dict)

    def scenarios(self, iteration: int | None = None) -> Scenarios:
        """The leaves that vary, those of the law among them."""
        drawn = super().scenarios(iteration)
        return {**drawn, **{LAW + n: x for n, x in values_of(self.known, drawn).items()}}

    def law_at(self, z: Array, scenarios: Scenarios) -> agvjax.Law | agvjax.Batch:
        """The law for each vehicle at z (K,), or (B, K)."""
        return knowing(super().law_at(z, scenarios), {name: scenarios[LAW + name] for name in self.known})
