"""Limits on margins of the linearised loop: columns beside the metrics of runs, their slopes by differences.

The loops come from JAX, their margins from LAPACK, so that they are taken outside of what is compiled.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import agvjax
from agvjax.leaves import swap
from agvjax.linear import Loops, linearised
from agvjax.margins import at_instants, tightest
from agvjax.metric_table import METRICS, LoopMargins

from .methods.method import Model, Scenarios

if TYPE_CHECKING:
    from .tuner import Tuner


def values(tuner: Tuner, z: Array, scenarios: Scenarios) -> np.ndarray:
    """The columns of the objective that are of the loop, (L, B), at z (K,) or at one for each scenario (B, K)."""
    return _columns(tuner, at_instants(_loops(tuner, z, scenarios)))


def beside(tuner: Tuner, model: Model, z: Array, scenarios: Scenarios) -> Model:
    """What `Tuner.jacobian` has of runs, with the loop's columns behind.

    The slopes are differences to either side, at the instants that are the tightest of their run at z.
    """
    of_runs, ok, steep = model
    point, found = np.asarray(z), at_instants(_loops(tuner, z, scenarios))
    which, step = _tightest_instants(found), float(np.finfo(point.dtype).eps) ** (1 / 3)

    def there(z: np.ndarray) -> np.ndarray:
        return _columns(tuner, at_instants(_loops(tuner, z, scenarios), which))

    slopes = [(there(point + row) - there(point - row)) / (2 * step) for row in step * np.eye(point.size)]
    more = np.where(np.asarray(ok), np.stack(slopes), 0.0)
    whole = jnp.concatenate([of_runs, jnp.asarray(_columns(tuner, found), of_runs.dtype)])
    return whole, ok, jnp.concatenate([steep, jnp.asarray(more, steep.dtype)], axis=1)


def _loops(tuner: Tuner, z: Any, scenarios: Scenarios) -> Loops:
    judged, varied = tuner.objective.judged, {name: scenarios[name] for name in tuner.batch.names}
    batch = agvjax.Batch(scenario=swap(tuner.batch.scenario, varied), names=tuner.batch.names)
    law = tuner.law_at(z, scenarios)
    return linearised(law, batch, timing=tuner.timing, first=float(judged.late), count=judged.instants)


def _columns(tuner: Tuner, found: LoopMargins) -> np.ndarray:
    """As the objective has them, (L, B)."""
    least = tightest(found)
    signs = {r.column: (r.sign, r.metric) for r in tuner.objective.requirements if METRICS[r.metric].loop}
    return np.stack([sign * getattr(least, name) for sign, name in signs.values()])


def _tightest_instants(found: LoopMargins) -> np.ndarray:
    """Which instants (B, K) are the tightest of their run, of any of the margins."""
    which = np.zeros(found.delay_margin.shape, bool)
    for name, x in vars(found).items():
        turned = -x if name == "sensitivity" else x
        known = ~np.isnan(turned).all(axis=1)
        which[known, np.nanargmin(turned[known], axis=1)] = True
    return which
